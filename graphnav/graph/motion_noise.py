"""What the errors of the running gear's factors are sums of, before the run has shown how much.

Beside what a motion state leaves unexplained anyhow (`recognition/corrections.py`), a bend adds to
the lateral error, a change of speed to the forward one and the ground to the vertical one. Each
part's size is found in the residuals (`noise.py`); what gaps, counters and changes of state may
hide is fixed.
"""

import numpy as np

from factors import kinds, so3
from factors.block import Index
from factors.displacement import OdometerSums
from factors.odometer_model import AXES
from factors.preintegration import doubt_of
from graphnav.common.run import Array
from graphnav.graph.noise import Parts, States, parts
from graphnav.graph.preparation import Setup
from graphnav.graph.round import Round
from graphnav.inertial.odometer_steps import speed_at
from graphnav.inertial.standstill_evidence import Mask

# What the noise begins with: found anew in the residuals (`noise.py`), so orders of magnitude only,
# as the recorded cars and robots of ../shared/data show them
VERTICAL = 0.05  # m/sqrt(s), suspension and bumps
BEND_S = 0.01  # s sqrt(s), of the centripetal acceleration: slip angles beyond the linear tyre
CHANGE_S = 0.03  # s, of the change of speed: stamps, wheel slip, the inertia of the running gear
STAMP_S = 0.002  # s, of the speed: when a count was read
BUMP = 0.003  # sqrt(s), of the speed: the ground's profile
YAW_FLOOR = 0.02  # m/sqrt(s), of the sides' difference
YAW_SHARE = 0.1  # sqrt(s), of that in a skidding turn
# not found in the residuals
BOUNDARY_S = 0.3  # by which a change of state is misplaced: three samples of its recognition
LEAST_FORWARD = 3e-3  # m/sqrt(s): no wheel rolls truer, whatever a counter shows
ALONE_S = 1.0  # s over which errors of the velocity last: bumps and swerves
DROPPED = 1e6  # sigma of a row that says nothing


def displacement_noise(
    round_: Round, on: Index, names: States, sums: OdometerSums, factor: Array
) -> Parts:
    """Errors (n, 3) m of the displacements over intervals `on` in states `names`, whose odometer
    is read with `factor` (n,).
    """
    nodes, odometer = round_.nodes, round_.prep.sensed.run.odometer
    assert odometer is not None
    T = np.diff(nodes.time)[on]
    turn = np.linalg.norm(so3.log(sums.R_mid), axis=1) * 2
    speed = sums.way / T
    ends = speed_at(odometer, nodes.time)
    change = np.abs(ends[on + 1] - ends[on])
    usual = _usual(round_.prep.setup, names)
    assumed = {
        "usual": np.where(usual < DROPPED, usual, 0.0) * np.sqrt(T)[:, None],
        "bend": _by_axis(BEND_S * speed * turn / np.sqrt(T), 0, 0),
        "change": _by_axis(0, CHANGE_S * change, 0),
        "stamps": _by_axis(0, STAMP_S * speed, 0),
        "bumps": _by_axis(0, 0, BUMP * speed * np.sqrt(T)),
    }
    # across a gap of the IMU nobody knows where the odometer's way led; pulses come late by up to
    # one: while the vehicle turns that is a step aside
    astray = speed * T * np.minimum(doubt_of(round_.prep.sensed.inc, nodes.edge)[on, 0], 1.0)
    late = odometer.pulse / np.sqrt(12) * turn
    misplaced = np.hypot(BOUNDARY_S * speed * _change(factor), LEAST_FORWARD * np.sqrt(T))
    hidden = np.hypot(_by_axis(late, misplaced, 0), astray[:, None])
    fixed = np.where(usual < DROPPED, hidden, DROPPED)
    return parts(kinds.DISPLACEMENT, names, AXES, assumed, round_.scales, fixed=fixed)


def velocity_noise(
    round_: Round, ending: Index, names: States, yaw_rate: Array, heard: Mask
) -> Parts:
    """Errors (n, 3) m/s of velocities at the ends of intervals (n,), turning by `yaw_rate` (n,)
    rad/s; `heard` (n,) whether there is an odometer to tell the forward one.

    What is white over an interval T is a velocity off by `sigma / sqrt(T)`; a sample that stands
    alone for longer than `ALONE_S` knows no more for that.
    """
    usual = _usual(round_.prep.setup, names)
    usual[:, 1] = np.where(heard, usual[:, 1], DROPPED)
    pace = np.linalg.norm(round_.at.v_n[ending + 1], axis=1)
    root = np.sqrt(np.minimum(round_.pre.T[ending], ALONE_S))[:, None]
    assumed = {
        "usual": np.where(usual < DROPPED, usual, 0.0) / root,
        "bend": _by_axis(BEND_S * pace * np.abs(yaw_rate), 0, 0) / root,
        "bumps": _by_axis(0, 0, BUMP * pace) / root,
    }
    fixed = np.where(usual < DROPPED, 0.0, DROPPED)
    return parts(kinds.VELOCITY, names, AXES, assumed, round_.scales, fixed=fixed)


def track_width_noise(round_: Round, on: Index) -> Parts:
    """Errors (n, 1) m of the sides' difference over intervals `on`; slip as the gyro turns: what
    the sides themselves show would weigh down those that slip most.
    """
    root = np.sqrt(round_.pre.T[on])[:, None]
    rate = so3.log(round_.pre.dR[on])[:, 2:] / root**2
    assumed = {
        "usual": YAW_FLOOR * root,
        "slip": YAW_SHARE * round_.prep.setup.vehicle.body.track_gauge * np.abs(rate) * root,
    }
    state = np.full(len(on), "")
    return parts(kinds.TRACK_WIDTH, state, ("yaw",), assumed, round_.scales)


def _by_axis(lateral: Array | float, forward: Array | float, vertical: Array | float) -> Array:
    """(n, 3) from what holds for each axis, (n,) or a number."""
    return np.stack(np.broadcast_arrays(lateral, forward, vertical), axis=-1).astype(np.float64)


def _change(factor: Array) -> Array:
    """How much the odometer's meaning changes at either end of each interval, (n,)."""
    step = np.abs(np.diff(factor, prepend=factor[:1], append=factor[-1:]))
    return np.maximum(step[1:], step[:-1])


def _usual(setup: Setup, names: States) -> Array:
    """White error of each interval's velocity by axis, (n, 3) m/sqrt(s); rows that the table
    discards are dropped.
    """
    by_state = {
        state: (row.sigma_lateral, row.sigma_forward if row.use_odometer else DROPPED, VERTICAL)
        for state, row in setup.table.items()
    }
    return np.array([by_state[str(s)] for s in names], dtype=np.float64).reshape(-1, 3)
