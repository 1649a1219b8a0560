"""The result directory's tables, from a solved run; every time on the file's own clock."""

from typing import TYPE_CHECKING, Any

import numpy as np

from factors import kinds
from graphnav.common.run import Array
from graphnav.result.events import Event, events
from graphnav.result.solved import Solved
from graphnav.result.trajectory import VEHICLE_KINDS

if TYPE_CHECKING:
    from pandas import DataFrame

RECKONED_HZ = 2.0
NOT_MEASURED = (  # what ties states, said by no sensor
    kinds.PHASE,
    kinds.CALIBRATION_PRIOR,
    kinds.CALIBRATION_WALK,
    kinds.SCALE_WALK,
    kinds.START,
    kinds.START_HEADING,
)


def states(solved: Solved) -> "DataFrame":
    """states.csv."""
    import pandas as pd

    line, clock = solved.timeline, solved.run.clock_start
    return pd.DataFrame(
        {
            "start": np.round(line.start + clock, 6),
            "end": np.round(line.end + clock, 6),
            "state": line.state,
            "probability": np.round(line.probability, 4),
        }
    )


def residuals(solved: Solved) -> "DataFrame":
    """residuals.parquet: whitened residuals of every measured factor, long form."""
    import pandas as pd

    parts = []
    for block, weight in zip(solved.blocks, solved.weights, strict=True):
        if block.kind in NOT_MEASURED:
            continue
        for row, axis in enumerate(block.axes):
            parts.append(
                pd.DataFrame(
                    {
                        "time": block.time + solved.run.clock_start,
                        "kind": block.kind,
                        "axis": axis,
                        "value": block.residual[:, row],
                        "weight": weight[:, row],
                    }
                )
            )
    return pd.concat(parts, ignore_index=True)


def reckoned(solved: Solved) -> "DataFrame | None":
    """dead_reckoning.parquet."""
    import pandas as pd

    path = solved.reckoned
    if path is None:
        return None
    t = np.arange(path.time[0], path.time[-1], 1 / RECKONED_HZ)
    columns = {"time": t + solved.run.clock_start}
    for k, axis in enumerate(("e", "n", "u")):
        columns[axis] = np.interp(t, path.time, path.p_n[:, k])
    return pd.DataFrame(columns)


def odometer(solved: Solved) -> "DataFrame | None":
    """odometer.parquet: raw and corrected."""
    import pandas as pd

    o = solved.odometry
    if o is None:
        return None
    return pd.DataFrame(
        {
            "time": o.time + solved.run.clock_start,
            "raw_speed": o.raw_speed,
            "v_x": o.v_x,
            "v_y": o.v_y,
        }
    )


def fixes(solved: Solved) -> "DataFrame | None":
    """gnss.parquet: every fix with the weight it had (0 where withheld)."""
    import pandas as pd

    gnss = solved.run.gnss
    if gnss is None:
        return None
    weight = np.zeros(len(gnss.time))
    for block, w in zip(solved.blocks, solved.weights, strict=True):
        if block.kind == kinds.GNSS:
            at = np.searchsorted(gnss.time, block.time - 1e-6)
            weight[np.clip(at, 0, len(weight) - 1)] = w[:, :2].min(1)
    columns: dict[str, Array] = {"time": gnss.time + solved.run.clock_start}
    for k, axis in enumerate(("e", "n", "u")):
        columns[axis] = solved.fixes_n[:, k]
    for k, axis in enumerate(("e", "n", "u")):
        columns[f"sd_{axis}"] = gnss.sd_enu[:, k]
    return pd.DataFrame(columns | {"weight": weight})


def truth(solved: Solved, reference: "DataFrame") -> "DataFrame":
    """truth.parquet: the reference in the run's local frame."""
    import pandas as pd

    local = solved.origin.local(
        np.deg2rad(reference["lat"].to_numpy()),
        np.deg2rad(reference["lon"].to_numpy()),
        reference["height"].to_numpy(),
    )
    columns: dict[str, Any] = {"time": reference["time"].to_numpy()}
    columns |= dict(zip(("e", "n", "u"), local.T, strict=True))
    for name in ("heading_deg", "state"):
        if name in reference:
            columns[name] = reference[name].to_numpy()
    return pd.DataFrame(columns)


def slips(solved: Solved) -> list[Event]:
    """Episodes from the vehicle factors; not at the edges of stops and of motion states."""
    edges = np.concatenate([solved.standstills.ravel(), solved.timeline.boundaries])
    for block, weight in zip(solved.blocks, solved.weights, strict=True):
        if block.kind in VEHICLE_KINDS and block.sigma is not None and len(block.time):
            node = np.searchsorted(solved.node_time, block.time - 1e-6)
            duration = solved.node_time[node] - solved.node_time[np.maximum(node - 1, 0)]
            slip = block.residual * block.sigma
            if block.kind != kinds.VELOCITY:
                slip = slip / duration[:, None]
            slip[:, 1] *= -1  # the odometer ahead of the vehicle: wheel spin
            return events(block.time, weight, slip, duration, edges)
    return []


def event_table(found: list[Event], clock: float) -> "DataFrame":
    """events.csv."""
    import pandas as pd

    rows = [
        (
            round(e.start + clock, 3),
            round(e.end + clock, 3),
            e.kind,
            e.axis,
            round(e.peak_velocity, 3),
        )
        for e in found
    ]
    return pd.DataFrame(rows, columns=["start", "end", "kind", "axis", "peak_velocity"])
