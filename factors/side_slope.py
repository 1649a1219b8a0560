"""Drift down a side slope: what pulls a vehicle sideways without a bend.

Tyres, tracks and soil hold a side force by a slip angle that is small and proportional to it. On
ground that falls to one side by the angle `phi` the force is the weight's part along the lateral
axis, so that over a way `d`, or at a speed, the vehicle slides

    x = c d sin(phi),    sin(phi) = e_down . R_nb R_bm e_x

downhill, forwards and backwards alike (Source: Wong 2008, Theory of Ground Vehicles, 1.4 and 6.4).
"""

from dataclasses import dataclass

from factors import so3
from factors.block import ROTATION, Array
from factors.calibration import MOUNTING, SLOPE_DRIFT, Layout
from factors.mounting import E_X, Mounting


@dataclass(frozen=True)
class Attitude:
    """How n vehicles lie: the body's attitude and the vehicle's axes in it."""

    R_nb: Array  # (n, 3, 3)
    mount: Mounting

    @property
    def fall(self) -> Array:
        """(n,) `sin(phi)`: how much of the way to the right leads down."""
        return -so3.mv(self.R_nb, self.mount.R_bm @ E_X)[:, 2]

    @property
    def by_rotation(self) -> Array:
        """Its derivative (n, 3) by the right perturbation of `R_nb`."""
        return so3.cross(self.R_nb[:, 2], self.mount.R_bm @ E_X)

    @property
    def by_mounting(self) -> Array:
        """Its derivative (n, 2) by pitch and heading of the mounting."""
        up = so3.mtv(self.mount.R_bm, self.R_nb[:, 2])
        return so3.mtv(self.mount.jacobian, so3.cross(up, E_X))


def slide_downhill(
    layout: Layout, c: Array, way: Array, at: Attitude, out: tuple[Array, Array, Array]
) -> None:
    """Take the drift over ways (n,) m, or at speeds m/s, off lateral residuals, in place.

    Args: `c` (n, dim) in force; `out` residuals (n, 3), their Jacobians (n, 3, .) by the node of
    `at` and by the calibrations.
    """
    if (column := layout.find(SLOPE_DRIFT)) is None:
        return
    r, J_x, J_c = out
    slides = c[:, column] * way
    r[:, 0] -= slides * at.fall
    J_c[:, 0, column] -= way * at.fall
    J_x[:, 0, ROTATION] -= slides[:, None] * at.by_rotation
    J_c[:, 0, layout.slices[MOUNTING]] -= slides[:, None] * at.by_mounting
