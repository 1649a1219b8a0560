"""What is being done now, and what each stage took."""

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Self

if TYPE_CHECKING:
    from rich.console import Console
    from rich.status import Status

Progress = Callable[[str], None]  # hears the name of each stage as it begins
STATUS = Path("/proc/self/status")


def unheard(_: str) -> None:
    """Progress that nobody follows."""


class Stages:
    """Call it with the name of each stage as it begins; its seconds are kept by name.

    On a terminal (stderr) the running stage is shown and finished ones stay with their seconds; in
    a pipe nothing is printed. A stage called twice adds up. Use as a context, or call `done`.
    """

    def __init__(self, show: bool | None = None) -> None:
        self.seconds: dict[str, float] = {}
        self._beside_mb = 0.0
        self._name: str | None = None
        self._since = 0.0
        self._console: Console | None = None
        self._status: Status | None = None
        if sys.stderr.isatty() if show is None else show:
            import rich.console

            self._console = rich.console.Console(stderr=True, highlight=False)

    def __call__(self, name: str) -> None:
        """Stage `name` begins; the one before it, if any, has ended."""
        self._close()
        self._name, self._since = name, time.perf_counter()
        if self._console is not None:
            self._status = self._console.status(f"[bold]{name}")
            self._status.start()

    def beside(self, *mb: float) -> None:
        """Other processes worked beside this one, all at a time, and needed so much memory each."""
        self._beside_mb = max(self._beside_mb, sum(mb))

    def done(self) -> None:
        """The last stage has ended."""
        self._close()
        self._name = None

    @property
    def peak_memory_mb(self) -> float:
        """The most that this process and those beside it needed so far, each at its own peak."""
        return peak_memory_mb() + self._beside_mb

    def __enter__(self) -> Self:
        return self

    def __exit__(self, failed: object, *_: object) -> None:
        if failed is None:
            self.done()
        elif self._status is not None:  # an error is told without a tick before it
            self._status.stop()

    def _close(self) -> None:
        if self._name is None:
            return
        took = time.perf_counter() - self._since
        self.seconds[self._name] = self.seconds.get(self._name, 0.0) + took
        if self._status is not None and self._console is not None:
            self._status.stop()
            self._console.print(f"[green]✓[/] {self._name:<32} [dim]{took:6.2f} s")


def peak_memory_mb() -> float:
    """Most resident memory of this process so far.

    From /proc where there is one: `getrusage` counts what the parent had when it started the
    process too (788 MB for one of 9 MB, started by one of 800).
    """
    try:
        line = next(x for x in STATUS.read_text().splitlines() if x.startswith("VmHWM"))
        return float(line.split()[1]) / 1024
    except (OSError, StopIteration, ValueError):
        try:
            import resource
        except ImportError:  # Windows
            return 0.0
        unit = 1 if sys.platform == "darwin" else 1024
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1024**2
