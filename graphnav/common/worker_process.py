"""A function of graphnav at work in another process, which may import long before it is called.

Started as `python -m graphnav.common.worker_process MODULE:FUNCTION IMPORT...`; arguments and
result are pickled through its pipes. Unlike `multiprocessing` it asks nothing of the caller's main
module.
"""

import pickle
import subprocess
import sys
import tempfile
import traceback
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from threading import Thread
from typing import Any, Self

from graphnav.common.errors import SolutionError
from graphnav.common.progress import peak_memory_mb


class WorkerProcess:
    """One call in another process; as a context it leaves no process behind."""

    def __init__(self, function: str, imports: Sequence[str] = ()) -> None:
        """`function` "module:name"; `imports` modules it will need."""
        self.name = function.partition(":")[2]
        # -P: what lies in the user's directory is not ours to import
        command = [sys.executable, "-P", "-m", "graphnav.common.worker_process", function, *imports]
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115  # a pipe would fill
        pipe = subprocess.PIPE
        self._process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=self._errors)
        self._answer = b""
        self._unsent: Exception | None = None
        self._talk: Thread | None = None
        self.peak_memory_mb = 0.0

    def call(self, *arguments: object) -> None:
        """Let it begin; `result` waits for the end."""
        self._talk = Thread(target=self._converse, args=(arguments,), daemon=True)
        self._talk.start()

    def result(self) -> Any:
        """What the function returned; what it raised is raised here."""
        assert self._talk is not None, "call first"
        self._talk.join()
        if self._unsent is not None:
            raise self._unsent
        if not self._answer:
            raise SolutionError(f"{self.name}: {self._end()}")
        result, self.peak_memory_mb = pickle.loads(self._answer)
        if isinstance(result, Exception):
            raise result
        return result

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._process.poll() is None:
            self._process.kill()
        if self._talk is not None:
            self._talk.join()
        for stream in (self._process.stdin, self._process.stdout, self._errors):
            if stream is not None:
                with suppress(OSError):
                    stream.close()
        self._process.wait()

    def _converse(self, arguments: tuple[object, ...]) -> None:
        assert self._process.stdin is not None and self._process.stdout is not None
        try:
            with suppress(OSError), self._process.stdin as into:  # it may have died: see its answer
                pickle.dump(arguments, into, pickle.HIGHEST_PROTOCOL)
        except Exception as error:
            self._unsent = error
        self._answer = self._process.stdout.read()
        self._process.wait()

    def _end(self) -> str:
        """How the process ended without an answer."""
        status = self._process.returncode
        if status < 0:
            return f"its process was ended by signal {-status} (out of memory?)"
        self._errors.seek(0)
        lines = self._errors.read().decode(errors="replace").strip().splitlines()
        return f"its process ended with status {status}: {lines[-1] if lines else 'no word'}"


def main(function: str, imports: Sequence[str]) -> None:
    """The other process: import, wait for arguments on stdin, answer on stdout."""
    answer, sys.stdout = sys.stdout, sys.stderr  # whatever prints must not garble the answer
    module, _, name = function.partition(":")
    for needed in (module, *imports):
        import_module(needed)
    try:
        arguments = pickle.load(sys.stdin.buffer)
    except EOFError:
        return  # nobody called
    try:
        result = getattr(import_module(module), name)(*arguments)
    except Exception as error:
        error.add_note(traceback.format_exc())
        result = error
    pickle.dump((result, peak_memory_mb()), answer.buffer, pickle.HIGHEST_PROTOCOL)
    answer.flush()


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
