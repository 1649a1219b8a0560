"""graphnav: post-mission trajectories of land vehicles that drive without satellites.

Frames, said once: **n** is east-north-up, fixed to the Earth at the run's origin; **b** is the IMU,
x right, y forward, z up; **m** is the vehicle, same axes, a small mounting rotation away from b;
**e** is ECEF. Suffixes name frames and neighbouring letters cancel: `v_n = R_nb @ v_b`. Inside
everything is SI, radians and seconds from the run's start; degrees appear only at the edges and
then in the name (`heading_deg`).
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from graphnav.stream.smoother import Smoother

__version__ = "0.1.0"
__all__ = ["Smoother", "__version__"]


def __getattr__(name: str) -> Any:
    """`graphnav.Smoother` on first use: importing graphnav stays fast."""
    if name == "Smoother":
        from graphnav.stream.smoother import Smoother

        return Smoother
    raise AttributeError(f"module 'graphnav' has no attribute '{name}'")
