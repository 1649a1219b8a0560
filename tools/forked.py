"""The `graphnav` command in a forked process: all imported once, so that thousands of calls pay.

What fails, hangs or is killed there leaves the caller alone.
"""

import os
import resource
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from graphnav.cli.cli import cli
from graphnav.cli.command import report_failures

STEP_S = 0.005  # between two looks at a child


@dataclass(frozen=True)
class Ended:
    """How a call ended."""

    status: int  # exit status; minus the signal that ended it
    error: str  # stderr
    seconds: float
    memory_mb: float  # at its peak
    timed_out: bool


@dataclass(frozen=True)
class Child:
    """A call under way."""

    pid: int
    error: Path
    since: float

    def ended(self, wait_s: float = 60.0) -> Ended:
        """Wait, and kill what takes longer."""
        late = False
        while True:
            pid, status, usage = os.wait4(self.pid, os.WNOHANG)
            if pid:
                break
            if time.monotonic() - self.since > wait_s and not late:
                late = True
                self.kill()
            time.sleep(STEP_S)
        text = self.error.read_text(encoding="utf-8", errors="replace")
        self.error.unlink(missing_ok=True)
        code = os.waitstatus_to_exitcode(status)
        took = time.monotonic() - self.since
        return Ended(code, text, took, usage.ru_maxrss / 1024, late)

    def kill(self) -> None:
        """kill -9."""
        os.kill(self.pid, signal.SIGKILL)


def start(
    arguments: Sequence[str | Path],
    first: Callable[[], None] | None = None,
    memory_mb: float | None = None,
) -> Child:
    """`graphnav ARGUMENTS` in a child of this process; `first` is called in the child before.

    `memory_mb` is what it may take beyond what this process has.
    """
    number, name = tempfile.mkstemp(prefix="graphnav-forked-")
    sys.stdout.flush()
    since = time.monotonic()
    pid = os.fork()
    if pid:
        os.close(number)
        return Child(pid, Path(name), since)
    status = 99  # an exception that the command let through
    try:
        _quiet(number)
        if memory_mb is not None:
            _limit(memory_mb)
        if first is not None:
            first()
        status = report_failures(cli, [str(a) for a in arguments])
    except SystemExit as ended:
        status = ended.code if isinstance(ended.code, int) else 98
    except BaseException:
        sys.excepthook(*sys.exc_info())
    finally:
        sys.stderr.flush()
        os._exit(status)


def warm() -> None:
    """Import what the command imports when it works; start no threads: they do not survive."""
    import gtsam  # noqa: F401
    import matplotlib.pyplot  # noqa: F401
    import pandas  # noqa: F401
    import pyarrow.parquet  # noqa: F401
    import scipy.signal  # noqa: F401

    import graphnav.batch.judgement
    import graphnav.batch.smoother
    import graphnav.pipeline
    import graphnav.result.compare
    import graphnav.rover.result
    import graphnav.stream.replay  # noqa: F401


def _quiet(error: int) -> None:
    nothing = os.open(os.devnull, os.O_RDWR)
    os.dup2(nothing, 0)
    os.dup2(nothing, 1)
    os.dup2(error, 2)
    sys.stdout = open(1, "w", closefd=False)  # noqa: SIM115
    sys.stderr = open(2, "w", closefd=False, errors="backslashreplace")  # noqa: SIM115


def _limit(memory_mb: float) -> None:
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    most = pages * resource.getpagesize() + int(memory_mb * 1e6)
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
