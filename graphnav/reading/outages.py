"""Spans in which fixes are withheld: how good would it have been without them?"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from graphnav.common.run import Gnss, Run
from graphnav.reading.vehicle import Vehicle

Outages = Sequence[tuple[float, float]]  # on the file's clock, s


def withheld(run: Run, outages: Outages) -> NDArray[np.bool_]:
    """Which fixes each outage takes away, (len(outages), F)."""
    clock = np.zeros(0) if run.gnss is None else run.gnss.time + run.clock_start
    start, end = np.array(outages, dtype=np.float64).reshape(-1, 2, 1).transpose(1, 0, 2)
    return np.asarray((clock >= start) & (clock <= end))


def in_use(run: Run, vehicle: Vehicle, use_gnss: bool, outages: Outages) -> Gnss | None:
    """The fixes that are used, outside the outages; None when none is left."""
    gnss = run.gnss
    if gnss is None or not (use_gnss and vehicle.gnss.use):
        return None
    keep = ~withheld(run, outages).any(axis=0)
    return Gnss(*(getattr(gnss, f)[keep] for f in vars(gnss))) if keep.any() else None


def described(run: Run, outages: Outages) -> list[str]:
    """What every outage took away, in words: a mistyped one takes nothing."""
    counts = withheld(run, outages).sum(axis=1).tolist()
    return [
        f"outage {start:g}:{end:g} withholds {count or 'no'} fix{'es' * (count != 1)}"
        for (start, end), count in zip(outages, counts, strict=True)
    ]
