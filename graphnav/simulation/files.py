"""Writing a simulated run: the directory appears whole or not at all."""

import gzip
import json
import shutil
from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.csv

from graphnav.common import replacing
from graphnav.common.errors import InputError
from graphnav.simulation.recording import Recording

OURS = ("run.csv.gz", "truth.csv.gz", "vehicle.toml", "truth_calibration.json")
MARK = "truth_calibration.json"  # by its presence a directory is known to be ours


def write(recording: Recording, out: Path) -> Path:
    """run.csv.gz, truth.csv.gz, vehicle.toml and truth_calibration.json into `out`.

    An earlier simulation in `out` is replaced, other files in it are kept beside it. Raises
    InputError where `out` is anything else, or cannot be written.
    """
    check(out)
    out = out.resolve()
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        for path in replacing.left_by_the_dead(out):
            _clear(path, out)
        fresh = replacing.made_aside(out, "part")
    except OSError as error:
        raise _unwritable(out.parent, error) from None
    try:
        _table(recording.run, fresh / "run.csv.gz")
        _table(recording.truth, fresh / "truth.csv.gz")
        (fresh / "vehicle.toml").write_text(recording.vehicle)
        (fresh / MARK).write_text(json.dumps(recording.calibration, indent=1) + "\n")
        old = replacing.put(fresh, out)
        if old is not None:
            _clear(old, out)
    except OSError as error:
        raise _unwritable(out, error) from None
    finally:
        replacing.clear(fresh, out, _foreign(fresh))  # what was written, or what stood there before
    return out


def kept_aside(out: Path) -> str | None:
    """What of `out` will be kept beside it when it is replaced, in words."""
    foreign = _foreign(out)
    if not foreign:
        return None
    kept = replacing.kept_beside(out.resolve(), foreign).name
    return f"{replacing.named(foreign)} in {out} are no simulation's: kept in {kept}"


def _foreign(directory: Path) -> list[Path]:
    return [name for name in replacing.files(directory) if str(name) not in OURS]


def _clear(old: Path, out: Path) -> None:
    """Remove what was or would have been `out`, but for what is not a simulation's."""
    if (old / MARK).exists():
        if not out.exists():  # a kill between two renames
            old.rename(out)
            return
        replacing.clear(old, out, _foreign(old))
    else:
        shutil.rmtree(old, ignore_errors=True)


def _unwritable(path: Path, error: OSError) -> InputError:
    what = error.strerror or str(error)
    return InputError(f"{path}: cannot be written ({what}): make room or choose --out elsewhere")


def check(out: Path) -> None:
    """InputError unless `out` is free, empty or an earlier simulation."""
    if not out.exists():
        return
    if not out.is_dir():
        raise InputError(f"{out} is a file: choose a directory for --out")
    if any(out.iterdir()) and not (out / MARK).exists():
        raise InputError(
            f"{out} is not empty and not a simulation of graphnav: choose another --out"
        )


def _table(frame: pd.DataFrame, path: Path) -> None:
    """CSV, gzipped, blank where a sensor has no sample; the same numbers give the same bytes."""
    table = pa.Table.from_pandas(frame, preserve_index=False)  # NaN becomes null
    header = ",".join(table.column_names) + "\n"
    options = pa.csv.WriteOptions(include_header=False, quoting_style="none")
    # no name and no time in the archive, and the fastest level: five times faster, 10 % larger
    with path.open("wb") as raw, gzip.GzipFile("", "wb", 1, raw, mtime=0) as sink:
        sink.write(header.encode())
        pa.csv.write_csv(table, sink, options)
