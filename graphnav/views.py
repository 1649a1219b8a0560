"""run.rrd and report.html, each made from the result files by a process of its own.

What they need takes long to import: the processes do that while the run is being solved.
"""

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Self

from graphnav.aside import Aside
from graphnav.progress import Stages

TABLES = ("pandas", "pyarrow.parquet", "graphnav.results")
IMPORTS = {
    "recording": (*TABLES, "rerun", "graphnav.recording"),
    "report": (*TABLES, "matplotlib.pyplot", "jinja2", "graphnav.report"),
}


class Views:
    """Views that will be made of results to come; use as a context."""

    def __init__(self, kinds: Sequence[str]) -> None:
        """`kinds`: recording, report."""
        self._kinds, self._makers, self._stack = kinds, dict[str, Aside](), ExitStack()

    def make(self, directory: Path, told: Stages) -> None:
        """Make all views of a directory, side by side; SolutionError says what kept one."""
        for maker in self._makers.values():
            maker.call(directory)
        for kind, maker in self._makers.items():
            told(kind)
            maker.result()
            told.beside(maker.peak_memory_mb)

    def __enter__(self) -> Self:
        for kind in self._kinds:
            maker = Aside(f"{__name__}:{kind}", IMPORTS[kind])
            self._makers[kind] = self._stack.enter_context(maker)
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()


def recording(directory: Path) -> None:
    """run.rrd of a result directory."""
    from graphnav import recording, results

    recording.write(results.load(directory), directory / "run.rrd")


def report(directory: Path) -> None:
    """report.html of a result directory."""
    from graphnav import report, results

    report.write(results.load(directory), directory / "report.html")
