"""`run.rrd`: a result directory as a recording for the rerun viewer, layout included.

The recording is a view of the results, not an archive: long runs are thinned to what a screen can
show (`entry.SERIES_LIMIT`, `entry.STRIP_LIMIT`); Parquet keeps the full record. Positions are local
ENU metres, since rerun stores them in single precision.
"""

import os
import re
from pathlib import Path

from graphnav.common.errors import SolutionError
from graphnav.common.replacing import whole
from graphnav.result.result_directory import Results
from graphnav.views.recording import curves, map, notes, paths, scalars, timeline
from graphnav.views.recording.blueprint import layout
from graphnav.views.recording.entry import Entry, send


def entries(results: Results) -> list[Entry]:
    """All that the recording holds, before anything is written."""
    parts = (paths, map, scalars, curves, timeline, notes)
    return [entry for part in parts for entry in part.entries(results)]


def application_id(results: Results) -> str:
    """One id per run: a running viewer keeps a layout per id. Only characters rerun accepts."""
    return "graphnav " + re.sub(r"[^A-Za-z0-9_ -]", "-", results.title)


def write(results: Results, path: Path) -> None:
    """Write the recording; `path` is never half a file.

    Raises SolutionError when rerun writes nothing (environment variable RERUN=off), InputError when
    the disk is full.
    """
    os.environ.setdefault("RUST_LOG", "error")  # what is told is told in one line
    import rerun as rr

    content = entries(results)
    name = application_id(results)
    recording = rr.RecordingStream(name, recording_id=name, send_properties=False)
    recording.set_log_time_enabled(False)
    with whole(path) as part:
        try:
            with recording:
                recording.save(part, default_blueprint=layout(results, content))
                send(recording, content)
        except RuntimeError as error:
            raise OSError(str(error)) from None
        if not part.exists():
            raise SolutionError(f"{path}: rerun wrote nothing; unset the variable RERUN and repeat")
