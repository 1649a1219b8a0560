"""Weight functions by factor kind: convex at first, redescending once the trajectory is near."""

from collections.abc import Mapping

from factors.weights import Robust

Weights = Mapping[str, Robust]
FIRST = {
    "displacement": Robust("cauchy", 3.0),
    "velocity": Robust("cauchy", 3.0),
    "gnss": Robust("cauchy", 3.0),
    "heading": Robust("cauchy", 3.0),
}
FINAL = {
    "displacement": Robust("igg3", 2.5, 8.0),
    "velocity": Robust("igg3", 2.5, 8.0),
    "gnss": Robust("igg3", 2.0, 6.0),
    "heading": Robust("igg3", 2.0, 6.0),
    "scale_walk": Robust("cauchy", 3.0),
}
