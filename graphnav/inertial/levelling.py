"""Which way is up at the start, and what the accelerometers say of the gyro's bias."""

import numpy as np

from factors import so3
from factors.preintegration import Increments, since_node
from graphnav.common.angles import rotation_of_angles
from graphnav.common.run import Array

LEVELLING_S = 20.0
SLOT_S = 2.0  # over which the direction of gravity is averaged
FEWEST_SLOTS = 5
SIGNIFICANT = 3.0  # sigma that a bias must differ from none, to be taken from a drive


def mean_rate(inc: Increments, until: float) -> Array:
    """Mean angular rate of the initial standstill, (3,) rad/s."""
    on = inc.edge[1:] <= until + 1e-9
    return np.asarray(inc.rotation[on].sum(0) / np.diff(inc.edge)[on].sum())


def levelled(inc: Increments, speed: Array | None, standstill_until: float, bias: Array) -> Array:
    """Attitude with heading zero from the mean specific force at the start, (3, 3).

    On the move the force is turned back to the start with the gyro less its `bias` (3,) rad/s, and
    what the `speed` (M + 1,) m/s at the edges says of forward and centripetal acceleration is taken
    off.
    """
    until = standstill_until if standstill_until > 0 else inc.edge[0] + LEVELLING_S
    on = int((inc.edge[1:] <= until + 1e-9).sum())
    dt = np.diff(inc.edge)[:on]
    force = inc.velocity[:on] / dt[:, None]
    if standstill_until <= 0:
        force = driving_removed(inc, speed)[:on]
        rotation = inc.rotation[:on] - bias * dt[:, None]
        force = so3.mv(since_node(rotation, np.array([0, on])), force)
    up = (force * dt[:, None]).sum(0)
    up /= np.linalg.norm(up)
    pitch, roll = np.arcsin(np.clip(up[1], -1, 1)), np.arctan2(-up[0], up[2])
    return rotation_of_angles(roll, pitch, 0.0)


def driving_removed(inc: Increments, speed: Array | None) -> Array:
    """Specific force (M, 3) less the forward and centripetal acceleration of a speed (M + 1,)."""
    dt = np.diff(inc.edge)
    force = inc.velocity / dt[:, None]
    if speed is not None:
        force[:, 1] -= np.diff(speed) / dt
        force[:, 0] += speed[1:] * inc.rotation[:, 2] / dt
    return force


def tilting_bias(inc: Increments, speed: Array | None, bias_sd: float) -> Array:
    """Gyro bias about the level axes of a drive, from gravity staying where it is, (3,) rad/s.

    From slot to slot gravity turns in the body as the gyro says, `w = dR^T u`, but for its bias:
    `u' = w + T b x w`. Zero where the bias found is within `SIGNIFICANT` sigma of none, or
    no `speed` tells the centripetal force, or an axis was not recorded; about the vertical gravity
    tells nothing.
    """
    recorded = bool((np.ptp(inc.rotation, axis=0) > 0).all())
    if speed is None or not recorded:
        return np.zeros(3)
    edges = np.searchsorted(inc.edge, np.arange(inc.edge[0], inc.edge[-1], SLOT_S))
    edges = np.unique(edges)
    if len(edges) < FEWEST_SLOTS:
        return np.zeros(3)
    last = int(edges[-1])
    rotation = inc.rotation[:last]
    C = since_node(rotation, edges)
    u = np.add.reduceat(so3.mv(C, driving_removed(inc, speed)[:last]), edges[:-1], axis=0)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    ends = edges[1:] - 1
    w = so3.mtv(C[ends] @ so3.exp(rotation[ends]), u)[:-1]
    T = np.diff(inc.edge[edges])[:-1, None]
    error = u[1:] - w
    J = -so3.skew(w) * T[:, :, None]
    up = w.mean(0) / np.linalg.norm(w.mean(0))
    held = up * float(np.abs(J).sum())  # no bias about the vertical
    found, *_ = np.linalg.lstsq(
        np.concatenate([*J, held[None]]), np.append(error.ravel(), 0.0), rcond=None
    )
    # the errors of neighbouring slots cancel: what remains is that of the first and the last
    sd = float(np.std(error - so3.mv(J, np.broadcast_to(found, error.shape)))) / float(T.sum())
    size = float(np.linalg.norm(found))
    return found if size > SIGNIFICANT * np.hypot(bias_sd, sd) else np.zeros(3)
