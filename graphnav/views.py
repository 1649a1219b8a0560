"""run.rrd and report.html, each made from the result files by a process of its own.

What they need takes long to import: the processes do that while the run is being solved. They are
started as `python -m graphnav.views KIND` and told the directory when its files are complete.
"""

import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Self

from graphnav.errors import GraphnavError, SolutionError
from graphnav.progress import Stages, peak_memory_mb

if TYPE_CHECKING:
    from graphnav.results import Results

MADE = {"recording": "run.rrd", "report": "report.html"}
TOLD = 3  # exit status: the last line of stderr is for the user as it stands


class Views:
    """Processes that wait for the results; use as a context: none outlives it."""

    def __init__(self, kinds: Sequence[str]) -> None:
        """`kinds` of `MADE`."""
        command = [sys.executable, "-m", "graphnav.views"]
        pipe = subprocess.PIPE
        self._makers = {
            kind: subprocess.Popen(
                [*command, kind], stdin=pipe, stdout=pipe, stderr=pipe, text=True
            )
            for kind in kinds
        }

    def make(self, directory: Path, told: Stages) -> None:
        """Make all views of a directory at once; SolutionError says why one could not be made."""
        for maker in self._makers.values():
            if maker.stdin is not None and maker.poll() is None:
                maker.stdin.write(f"{directory}\n")
                maker.stdin.flush()
        for kind, maker in self._makers.items():
            told(kind)
            said, failed = maker.communicate()
            if maker.returncode:
                why = failed.strip().splitlines() or [f"ended with status {maker.returncode}"]
                told_as = why[-1] if maker.returncode == TOLD else f"{kind} failed: {why[-1]}"
                raise SolutionError(told_as)
            told.beside(float(said))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for maker in self._makers.values():
            if maker.poll() is None:
                maker.kill()
                maker.communicate()


def main(kind: str) -> int:
    """Import, wait for a directory on stdin, make its view and tell the peak memory, MB."""
    from graphnav import results

    make = _maker(kind)
    directory = sys.stdin.readline().rstrip("\n")
    if not directory:
        return 0
    try:
        make(results.load(Path(directory)), Path(directory) / MADE[kind])
    except GraphnavError as error:
        print(error, file=sys.stderr)
        return TOLD
    print(peak_memory_mb())
    return 0


def _maker(kind: str) -> Callable[["Results", Path], None]:
    """What makes a view, with all it needs imported."""
    import pandas  # noqa: F401
    import pyarrow.parquet  # noqa: F401

    if kind == "recording":
        import rerun  # noqa: F401

        from graphnav import recording

        return recording.write
    import jinja2  # noqa: F401
    import matplotlib.pyplot  # noqa: F401

    from graphnav import report

    return report.write


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
