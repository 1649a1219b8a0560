"""Weight functions by factor kind: convex at first, redescending once the trajectory is near."""

from collections.abc import Mapping

from factors import kinds
from factors.weights import Robust

Weights = Mapping[str, Robust]
FIRST = {
    kinds.DISPLACEMENT: Robust("cauchy", 3.0),
    kinds.VELOCITY: Robust("cauchy", 3.0),
    kinds.GNSS: Robust("cauchy", 3.0),
    kinds.HEADING: Robust("cauchy", 3.0),
    kinds.STANDSTILL: Robust("huber", 3.0),
    kinds.START_HEADING: Robust("cauchy", 3.0),
    kinds.STATED: Robust("cauchy", 3.0),
}
FINAL = {
    kinds.DISPLACEMENT: Robust("igg3", 2.5, 8.0),
    kinds.VELOCITY: Robust("igg3", 2.5, 8.0),
    kinds.GNSS: Robust("igg3", 2.0, 6.0),
    kinds.HEADING: Robust("igg3", 2.0, 6.0),
    kinds.STANDSTILL: Robust("igg3", 2.5, 8.0),
    kinds.START_HEADING: Robust("igg3", 2.5, 8.0),
    kinds.SCALE_WALK: Robust("cauchy", 3.0),
    kinds.STATED: Robust("cauchy", 3.0),
}
