"""What the odometer means in each motion state: the one table to hold beside the paper's.

A tracked vehicle's gearbox odometer shows `v_o`, the speed of its high-speed-side track (times the
gear ratio in low gear). Every state corrects it by the same two lines,

    v_y = factor * v_o - half_gauge * |phi_dot|          (forward)
    v_x = -kappa * contact_length * phi_dot              (lateral, A17)

and differs only in the numbers below, which are priors: the ground is learnt in the graph.
Signs: v_x right, v_y forward, phi_dot up (left turn positive); for v_o < 0 (reverse) the forward
line is mirrored.
"""

from dataclasses import dataclass, replace

import numpy as np

from graphnav.common.run import Array

ARC_FACTOR = 0.8688  # A20, concrete
PIVOT_FACTOR = 0.5  # one track held: the centre moves at half the speed of the other
KAPPA, KAPPA_SD = 0.10, 0.15
SKID_SD = 0.05  # of the mean of two sides in a turn


@dataclass(frozen=True)
class VehicleParams:
    """What recognition and correction must know of the vehicle.

    `low_gear_ratio` of 1 means a vehicle without the low gear: its low states do not exist.
    """

    kind: str  # tracked | wheeled | rover
    track_gauge: float = 2.80  # B, m
    contact_length: float = 3.84  # L, m
    low_gear_ratio: float = 1.42
    max_turn: float = 0.6  # delta_phi_max of A16, rad in 1 s; a pivot turns 0.4
    two_sided: bool = False  # both sides measured: the odometer is their mean (skid steer)

    @property
    def has_low_gear(self) -> bool:
        """Whether the ratio tells low states from high ones."""
        return self.kind == "tracked" and self.low_gear_ratio > 1.1


@dataclass(frozen=True)
class Correction:
    """One state's row: priors of its ground constants and how far they are to be trusted."""

    state: str
    factor: float  # prior of v_y / v_o, low gear included
    factor_sd: float  # 1 sigma of that prior; ground off by 5-15 %
    half_gauge: float  # m, multiplies |phi_dot|: B/2 where A23 applies, else 0
    kappa: float  # prior of the turning centre's offset over L
    kappa_sd: float
    use_odometer: bool  # False: the forward speed is left to the inertial sensors
    low_gear: bool  # v_o carries the low gear ratio
    sigma_forward: float  # m/sqrt(s), white: what the row leaves unexplained of the way along y
    sigma_lateral: float  # m/sqrt(s), the same along x
    source: str  # tag of methods.md

    def forward(self, v_o: Array, yaw_rate: Array) -> Array:
        """Forward speed of the vehicle point, m/s, from odometer m/s and yaw rate rad/s (N,)."""
        return self.factor * v_o - np.sign(v_o) * self.half_gauge * np.abs(yaw_rate)

    def lateral(self, yaw_rate: Array, contact_length: float) -> Array:
        """Lateral speed (right positive) of the vehicle point, m/s. Source: A17."""
        return -self.kappa * contact_length * yaw_rate


def correction_table(vehicle: VehicleParams) -> dict[str, Correction]:
    """State name -> its row; the nine states of a tracked vehicle, or stop and moving.

    A23 `v_y = rho / (rho + B/2) v_o` needs no radius: put `rho = v_y / |phi_dot|` and it reads
    `v_y + |phi_dot| B/2 = v_o`, the rigid body seen from the faster track. So a separated turn has
    factor 1 and half_gauge B/2, exactly. In low gear the track runs at `v_o / 1.42`.

    The prior of kappa: balancing sideways track friction against the centripetal force puts the
    turning centre `L a_c / (2 mu g)` off the middle, so |kappa| = a_c / (2 mu g): 0.02 in a slow
    pivot, 0.1 at 1.4 m/s^2 on concrete, 1/2 at the sliding limit, where A17's L would need twice
    that. Its sign also depends on where the vehicle point sits; hence A17's sign with 0.10 +- 0.15.

    `straight_high` is the reference: its factor and the odometer's scale are one number to the
    data, so estimate one of them. Source: A6, A16-A23 (Wu & Yin 2019, table 1, eq. 6-7, 16-23).
    """
    ratio, half = vehicle.low_gear_ratio, vehicle.track_gauge / 2.0
    low, held = 1.0 / ratio, PIVOT_FACTOR
    k, k_sd = KAPPA, KAPPA_SD
    # fmt: off
    tracked = (
        # state, factor, sd, half_gauge, kappa, sd, use_odometer, low_gear, sigma y, x, source
        ("straight_high", 1.0, 0.03, 0.0, 0.0, 0.0, True, False, 0.03, 0.03, "A6"),
        ("straight_low", low, 0.04, 0.0, 0.0, 0.0, True, True, 0.03, 0.03, "A6, A7"),
        ("stop", 1.0, 0.0, 0.0, 0.0, 0.0, True, False, 0.01, 0.01, "table 1"),
        ("turn_arc", ARC_FACTOR, 0.08, 0.0, k, k_sd, True, False, 0.05, 0.05, "A17, A20"),
        ("turn_pivot", held, 0.15, 0.0, k, k_sd, False, False, 0.5, 0.1, "A8-A11"),
        ("turn_separated", 1.0, 0.06, half, k, k_sd, True, False, 0.05, 0.05, "A17, A23"),
        ("turn_separated_low", low, 0.05, half, k, k_sd, True, True, 0.05, 0.05, "A6, A17, A23"),
        ("turn_pivot_low", held * low, 0.1, 0.0, k, k_sd, False, True, 0.5, 0.1, "A6, A8-A11"),
        ("turn_large", 1.0, 0.3, 0.0, k, k_sd, False, False, 2.0, 0.3, "A16"),
    )
    other = (
        ("stop", 1.0, 0.0, 0.0, 0.0, 0.0, True, False, 0.01, 0.01, "zero velocity"),
        ("moving", 1.0, 0.02, 0.0, 0.0, 0.0, True, False, 0.05, 0.05, "D1"),
    )
    # fmt: on
    rows = [Correction(*row) for row in (tracked if vehicle.kind == "tracked" else other)]
    if vehicle.two_sided and vehicle.kind == "tracked":
        rows = [_mean_of_sides(row) for row in rows]
    return {row.state: row for row in rows}


def _mean_of_sides(row: Correction) -> Correction:
    """The row for an odometer that is the mean of both sides: v_y itself, but for skidding."""
    if not row.state.startswith("turn"):
        return row
    source = f"{row.source}; v_y = (l + r) / 2"
    return replace(
        row, factor=1.0, factor_sd=SKID_SD, half_gauge=0.0, kappa=0.0, use_odometer=True,
        sigma_forward=0.1, source=source,
    )  # fmt: skip
