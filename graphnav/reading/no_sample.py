"""Values that cannot be a sample: out of range, or a vector of which only some axes came."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from graphnav.common.errors import InputError
from graphnav.reading.columns import ACCEL, GNSS, GNSS_SD, GYRO, LINKS, SIDES, STEERS, WHEELS
from graphnav.reading.dialect import MOST_DAMAGED
from graphnav.reading.table_file import TableFile

Array = NDArray[np.float64]

SENTINEL = 1e9  # nothing a land vehicle measures is as large; receivers write -2e10, 1e38
FASTEST_WHEEL, WIDEST_JOINT = 1e3, 10.0  # rad/s, rad: rovers crawl, and their joints have stops
FEW = 3  # values a receiver may use to say "none"; more are another unit
# what a value can be, in the unit it is read in
RANGE: dict[str, tuple[float, float]] = {
    **dict.fromkeys((*GYRO, *ACCEL, *SIDES, "odo_speed"), (-SENTINEL, SENTINEL)),
    **dict.fromkeys(WHEELS, (-FASTEST_WHEEL, FASTEST_WHEEL)),
    **dict.fromkeys((*STEERS, *LINKS), (-WIDEST_JOINT, WIDEST_JOINT)),
    "gnss_lat": (-90.0, 90.0),
    "gnss_lon": (-360.0, 360.0),
    "gnss_height": (-2e4, 1e6),
    "heading_deg": (-360.0, 720.0),
    **dict.fromkeys(GNSS_SD, (np.nextafter(0.0, 1.0), SENTINEL)),
}  # fmt: skip
VECTORS = (GYRO, ACCEL, SIDES, GNSS[:2])


def without_impossible(
    file: TableFile, columns: Mapping[str, Array]
) -> tuple[dict[str, Array], list[str]]:
    """The columns with NaN where a value cannot be a sample, and what to say of it.

    Raises InputError where the values of a column are of another unit, or half of many samples is
    missing.
    """
    found = dict(columns)
    notes: list[str] = []
    for name in RANGE.keys() & columns.keys():
        notes += _within(file, found, name)
    for names in VECTORS:
        if all(name in columns for name in names):
            notes += _whole(file, found, names)
    return found, sorted(notes)


def _within(file: TableFile, columns: dict[str, Array], name: str) -> list[str]:
    """Blank what is out of range in column `name`."""
    low, high = RANGE[name]
    values = columns[name]
    if not (np.fmin.reduce(values) < low or np.fmax.reduce(values) > high):  # NaN passes
        return []
    wrong = (values < low) | (values > high)
    count, some = int(wrong.sum()), values[wrong]
    row = int(wrong.argmax())
    few = len(np.unique(some)) <= FEW or count <= MOST_DAMAGED * int(np.isfinite(values).sum())
    if name not in GNSS_SD and not few:
        raise InputError(
            f"{file.path}: {file.row(row)}: {name} is {some[0]:g}, and {count} values are out of "
            f"{low:g} to {high:g}: set its unit under [columns] in the vehicle file"
        )
    together = next((names for names in VECTORS if name in names), (name,))
    for other in columns.keys() & {*together}:
        columns[other] = np.where(wrong, np.nan, columns[other])
    return [
        f"{name} is {some[0]:g} at {columns['time'][row]:.15g} and out of range {count} times: "
        "taken as no sample"
    ]


def _whole(file: TableFile, columns: dict[str, Array], names: tuple[str, ...]) -> list[str]:
    """Blank samples of which an axis is missing, while they are few."""
    filled = np.sum([np.isfinite(columns[name]) for name in names], axis=0, dtype=np.uint8)
    half = (filled > 0) & (filled < len(names))
    if not half.any():
        return []
    row, count = int(half.argmax()), int(half.sum())
    blank = next(name for name in names if np.isnan(columns[name][row]))
    if count > MOST_DAMAGED * int((filled > 0).sum()):
        raise InputError(
            f"{file.path}: {file.row(row)} (time {columns['time'][row]:.15g}): {blank} is blank "
            f"where {names[names[0] == blank]} is not, in {count} rows: a sample needs "
            f"{', '.join(names)}; fill or blank all of them"
        )
    for name in names:
        columns[name] = np.where(half, np.nan, columns[name])
    at = f"{columns['time'][row]:.15g}"
    return [f"{count} samples of which {blank} or another axis is blank left out, first at {at}"]
