"""truth.csv (also .csv.gz, .parquet): reference positions and, where known, motion and states."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from graphnav.common.errors import InputError
from graphnav.reading.dialect import MOST_DAMAGED
from graphnav.reading.no_sample import RANGE
from graphnav.reading.row_order import in_order
from graphnav.reading.table_file import open_table, read_table
from graphnav.reading.vehicle_file import nearest

if TYPE_CHECKING:
    from pandas import DataFrame

NEEDED = ("time", "lat", "lon", "height")
FASTEST, WIDEST_DEG = 1e4, 1e4  # m/s, deg (headings may be counted on)
OPTIONAL = ("v_e", "v_n", "v_u", "roll_deg", "pitch_deg", "heading_deg")


def read_truth(path: Path) -> "DataFrame":
    """Columns of interface.md as far as the file has them; rows without a position are left out.

    Raises `InputError` when a needed column is missing, a cell is no number or time runs back.
    """
    import pandas as pd

    file = open_table(path)
    for name in NEEDED:
        if name not in file.header:
            raise InputError(
                f"{path}: no column '{name}' (truth needs {', '.join(NEEDED)}); "
                f"nearest is '{nearest(name, file.header)}'"
            )
    names = [name for name in (*NEEDED, *OPTIONAL) if name in file.header]
    words = [name for name in ("state",) if name in file.header]
    read = read_table(file, names, words)
    clock = in_order(read.file, read.columns)
    truth = pd.DataFrame(clock.columns)
    if words:
        truth["state"] = np.array(read.words["state"], object)[clock.rows]
    known = truth[list(NEEDED)].notna().all(axis=1)
    if not known.any():
        raise InputError(f"{path}: no row holds time, lat, lon and height")
    notes = [*read.notes, *clock.notes, *_without_absurd(truth)]
    on_earth = pd.concat([truth[n].between(*RANGE[f"gnss_{n}"]) for n in NEEDED[1:]], axis=1)
    wild = known & ~on_earth.all(axis=1)
    if wild.sum() > MOST_DAMAGED * known.sum():
        row = clock.file.row(int(wild.to_numpy().argmax()))
        raise InputError(f"{path}: {row}: no latitude, longitude in degrees and height in m")
    notes += [f"{wild.sum()} rows that are nowhere on Earth left out"] * bool(wild.any())
    known &= ~wild
    truth = truth[known].reset_index(drop=True)
    truth.attrs["notes"] = [f"{path.name}: {note}" for note in notes]
    return truth


def _without_absurd(truth: "DataFrame") -> list[str]:
    """Blank velocities and angles that are none, in place; what to say of it."""
    notes = []
    for name in truth.columns.intersection(OPTIONAL):
        absurd = truth[name].abs() > (FASTEST if name.startswith("v_") else WIDEST_DEG)
        if absurd.any():
            notes.append(f"{int(absurd.sum())} values of {name} are none: read as blank")
            truth.loc[absurd, name] = np.nan
    return notes


def read_trajectory(path: Path) -> "DataFrame":
    """The trajectory of a result directory, or a trajectory file (.parquet, .csv).

    Raises `InputError` when there is none, or when it lacks what a comparison needs.
    """
    import pandas as pd

    file = open_table(path / "trajectory.parquet" if path.is_dir() else path)
    for name in NEEDED:
        if name not in file.header:
            raise InputError(f"{file.path}: no column '{name}'; give a result of graphnav smooth")
    words = [name for name in file.header if name == "state"]
    read = read_table(file, [name for name in file.header if name not in words], words)
    return pd.DataFrame(read.columns).assign(**read.words)
