"""What an odometer's metre is worth: its scale, the motion state's factor, the way it points.

    v_m = [-kappa L psi_dot, f (1 + s) v_o - h |psi_dot| sign v_o, 0]

of a reading `v_o` [m/s] while the vehicle turns with `psi_dot`: the scale `s` of the whole
odometer, which drifts, and by motion state the factor `f` (A20), the half gauge `h` of tracks that
stand or reverse on one side (A23) and the lateral `kappa L` (A17). Displacements and velocities
read the odometer by it.
"""

from dataclasses import dataclass

from factors.block import Array, Index
from factors.calibration import SCALE, Layout
from factors.mounting import E_Y

AXES = ("lateral", "forward", "vertical")


@dataclass(frozen=True)
class Coefficient:
    """A coefficient of n factors: held, or calibrated in a column of the factor's own."""

    held: Array  # (n,) its value where it is not calibrated
    on: Index  # (m,) the factors that have it calibrated
    column: Index  # (m,) calibration column of each of these

    def value(self, c: Array) -> Array:
        """Of each factor with the calibrations `c` (n, dim) in force, (n,)."""
        out = self.held.copy()
        out[self.on] = c[self.on, self.column]
        return out

    def add_to(self, J_c: Array, derivative: Array) -> None:
        """Add the derivatives (n, 3) of the factors to the Jacobian (n, 3, dim)."""
        J_c[self.on, :, self.column] += derivative[self.on]


@dataclass(frozen=True)
class Gain:
    """Metres the vehicle point moves ahead for every metre of n readings."""

    factor: Array  # (n,) f, of the motion state
    scale: Array  # (n,) 1 + s, of the odometer

    @property
    def value(self) -> Array:
        """(n,) `f (1 + s)`"""
        return self.factor * self.scale


@dataclass(frozen=True)
class OdometerModel:
    """How n readings of an odometer are to be understood.

    The methods take the `layout` of the calibrations and those in force, `c` (n, dim).
    """

    forward: Coefficient  # f
    lateral: Coefficient  # kappa L [m]
    gauge: Array  # (n,) h [m]
    roll: float  # rad, of the mounting

    def gain(self, layout: Layout, c: Array) -> Gain:
        """Scale and factor of each reading."""
        return Gain(self.forward.value(c), 1 + c[:, layout.column(SCALE)])

    def in_odometer_units(
        self, layout: Layout, c: Array, r: Array, jacobians: tuple[Array, ...]
    ) -> None:
        """Divide the forward row by `f (1 + s)`, in place: its noise is the odometer's, so that a
        scale does not gain by shrinking it (errors in variables, as in `IntervalNoise.scaled`).

        Args: `r` (n, 3), `jacobians` (n, 3, .) of it, by calibrations the last.
        """
        gain = self.gain(layout, c)
        for part in (r[:, :, None], *jacobians):
            part[:, 1] /= gain.value[:, None]
        by_gain, J_c = -r[:, 1, None] * E_Y, jacobians[-1]
        J_c[:, :, layout.column(SCALE)] += by_gain / gain.scale[:, None]
        self.forward.add_to(J_c, by_gain / gain.factor[:, None])
