"""run.rrd and report.html, each made from the result files by a process of its own.

What they need takes long to import: the processes do that while the run is being solved.
"""

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Self

from graphnav.common.progress import Stages
from graphnav.common.worker_process import WorkerProcess

TABLES = ("pandas", "pyarrow.parquet", "graphnav.result.result_directory")
IMPORTS = {
    "recording": (*TABLES, "rerun", "graphnav.views.recording"),
    "report": (*TABLES, "matplotlib.pyplot", "jinja2", "graphnav.views.report"),
}


class Views:
    """Views that will be made of results to come; use as a context."""

    def __init__(self, kinds: Sequence[str]) -> None:
        """`kinds`: recording, report."""
        self._kinds, self._makers, self._stack = kinds, dict[str, WorkerProcess](), ExitStack()

    def make(self, directory: Path, progress: Stages) -> None:
        """Make all views of a directory, side by side; SolutionError says what kept one."""
        for maker in self._makers.values():
            maker.call(directory)
        for kind, maker in self._makers.items():
            progress(kind)
            maker.result()
        progress.beside(*(maker.peak_memory_mb for maker in self._makers.values()))

    def __enter__(self) -> Self:
        for kind in self._kinds:
            maker = WorkerProcess(f"{__name__}:{kind}", IMPORTS[kind])
            self._makers[kind] = self._stack.enter_context(maker)
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()


def recording(directory: Path) -> None:
    """run.rrd of a result directory."""
    from graphnav.result import result_directory as results
    from graphnav.views import recording

    recording.write(results.load(directory), directory / "run.rrd")


def report(directory: Path) -> None:
    """report.html of a result directory."""
    from graphnav.result import result_directory as results
    from graphnav.views import report

    report.write(results.load(directory), directory / "report.html")
