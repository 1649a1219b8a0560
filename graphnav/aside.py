"""A function of graphnav at work in another process, which may import long before it is called.

Started as `python -m graphnav.aside MODULE:FUNCTION IMPORT...`; arguments and result are pickled
through its pipes. Unlike `multiprocessing` it asks nothing of the caller's main module.
"""

import pickle
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from threading import Thread
from typing import Any, Self

from graphnav.errors import GraphnavError, SolutionError
from graphnav.progress import peak_memory_mb


class Aside:
    """One call in another process; as a context it leaves no process behind."""

    def __init__(self, function: str, imports: Sequence[str] = ()) -> None:
        """`function` "module:name"; `imports` modules it will need."""
        self.name = function.partition(":")[2]
        command = [sys.executable, "-m", "graphnav.aside", function, *imports]
        pipe = subprocess.PIPE
        self._process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe)
        assert self._process.stdin is not None
        self._into, self._process.stdin = self._process.stdin, None
        self._said = self._failed = b""
        self._talk: Thread | None = None
        self.peak_memory_mb = 0.0

    def call(self, *arguments: object) -> None:
        """Let it begin; `result` waits for the end."""
        self._talk = Thread(target=self._communicate, args=(arguments,), daemon=True)
        self._talk.start()

    def result(self) -> Any:
        """What the function returned. GraphnavErrors come as they are, others as SolutionError."""
        assert self._talk is not None, "call first"
        self._talk.join()
        if self._process.returncode:
            lines = self._failed.decode(errors="replace").strip().splitlines()
            why = lines[-1] if lines else f"ended with status {self._process.returncode}"
            raise SolutionError(f"{self.name}: {why}")
        result, self.peak_memory_mb = pickle.loads(self._said)
        if isinstance(result, GraphnavError):
            raise result
        return result

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._process.poll() is None:
            self._process.kill()
        if self._talk is None:
            self._into.close()
            self._process.communicate()
        else:
            self._talk.join()

    def _communicate(self, arguments: tuple[object, ...]) -> None:
        with suppress(BrokenPipeError), self._into as into:  # `communicate` would dribble
            pickle.dump(arguments, into, pickle.HIGHEST_PROTOCOL)
        self._said, self._failed = self._process.communicate()


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
    except GraphnavError as error:
        result = error
    pickle.dump((result, peak_memory_mb()), answer.buffer, pickle.HIGHEST_PROTOCOL)
    answer.flush()


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
