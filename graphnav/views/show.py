"""Open a result directory in the rerun viewer, or say how where there is no screen."""

import os
import subprocess
import sys
from pathlib import Path

from graphnav.result import result_directory as results
from graphnav.result.writing import adopt
from graphnav.views import recording


def rebuild(directory: Path) -> Path:
    """Write `run.rrd` anew from the results beside it; the path written.

    Raises InputError when `directory` is no result directory.
    """
    path = directory / "run.rrd"
    recording.write(results.load(directory), path)
    adopt(directory, path)
    return path


def open_viewer(directory: Path) -> str:
    """Open `run.rrd` (made first when absent) in the native viewer; one line for the user.

    Without a display nothing is started and the line says how to look at it elsewhere.
    """
    path = directory / "run.rrd"
    if not path.exists():
        rebuild(directory)
    if not has_display():
        return (
            f"no display here: copy {path} to a machine with a screen and run `rerun run.rrd`, or "
            f"run `rerun --serve-web --bind 127.0.0.1 {path}` and forward ports 9090 and 9876 with "
            "ssh -L (the web viewer, unlike the native one, cannot be kept from calling its makers)"
        )
    subprocess.Popen([_viewer(), str(path)], start_new_session=True)
    return f"opened {path} in the rerun viewer (`rerun analytics disable` keeps it quiet)"


def has_display() -> bool:
    """Whether a window can be opened: always tried on Windows and macOS."""
    if sys.platform in ("win32", "darwin"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _viewer() -> str:
    """The viewer that came with the SDK: the same version, whatever is on PATH."""
    from importlib.util import find_spec

    found = find_spec("rerun_cli")
    if found is None or found.origin is None:
        return "rerun"
    suffix = ".exe" if sys.platform == "win32" else ""
    return str(Path(found.origin).parent / f"rerun{suffix}")
