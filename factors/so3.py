"""Rotations in batches: every function takes leading batch dimensions and broadcasts over them."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_SMALL = 1e-4  # rad; below it the Taylor series is exact to double precision
_LARGE = 0.04  # rad; beyond it `compound` and `rotated` leave their series


def skew(a: Array) -> Array:
    """Cross-product matrix `[a]x`, (..., 3) -> (..., 3, 3): `skew(a) @ b == cross(a, b)`."""
    out = np.zeros((*a.shape, 3))
    out[..., 0, 1], out[..., 0, 2] = -a[..., 2], a[..., 1]
    out[..., 1, 0], out[..., 1, 2] = a[..., 2], -a[..., 0]
    out[..., 2, 0], out[..., 2, 1] = -a[..., 1], a[..., 0]
    return out


def cross(a: Array, b: Array) -> Array:
    """Cross product over the last axis; three times as fast as `numpy.cross` on long arrays."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], -1)


def _series(theta: Array) -> tuple[Array, Array, Array]:
    """sin(t)/t, (1 - cos t)/t^2 and (t - sin t)/t^3 for rotation vectors (..., 3)."""
    t2 = np.einsum("...i,...i->...", theta, theta)
    t = np.sqrt(t2)
    small = t < _SMALL
    safe = np.where(small, 1.0, t)
    a = np.where(small, 1 - t2 / 6, np.sin(safe) / safe)
    half = np.sin(safe / 2) / (safe / 2)
    b = np.where(small, 0.5 - t2 / 24, 0.5 * half * half)
    c = np.where(small, 1 / 6 - t2 / 120, (safe - np.sin(safe)) / safe**3)
    return a, b, c


def exp(theta: Array) -> Array:
    """Rotation matrix of a rotation vector [rad], (..., 3) -> (..., 3, 3)."""
    a, b, _ = _series(theta)
    x, y, z = theta[..., 0], theta[..., 1], theta[..., 2]
    bx, by = b * x, b * y
    xy, xz, yz = bx * y, bx * z, by * z
    xx, yy, zz = bx * x, by * y, b * z * z
    ax, ay, az = a * x, a * y, a * z
    out = np.empty((*theta.shape, 3))
    out[..., 0, 0], out[..., 0, 1], out[..., 0, 2] = 1 - yy - zz, xy - az, xz + ay
    out[..., 1, 0], out[..., 1, 1], out[..., 1, 2] = xy + az, 1 - xx - zz, yz - ax
    out[..., 2, 0], out[..., 2, 1], out[..., 2, 2] = xz - ay, yz + ax, 1 - xx - yy
    return out


def compound(a: Array, b: Array) -> Array:
    """Rotation vector of `Exp(a) Exp(b)`, (n, 3); quick for small turns.

    Baker-Campbell-Hausdorff to fourth order: wrong by the fifth power of the angles, 1e-9 rad for
    turns of 0.02 rad. Larger turns go by their matrices.
    """
    ab = cross(a, b)
    aab = cross(a, ab)
    out = a + b + ab / 2 + (aab - cross(b, ab)) / 12 - cross(b, aab) / 24
    large = _large(np.abs(a) + np.abs(b))
    out[large] = log(exp(a[large]) @ exp(b[large]))
    return out


def rotated(a: Array, v: Array) -> Array:
    """`Exp(a) v`, (n, 3); to fourth order in the angle where it is small."""
    first = cross(a, v)
    second = cross(a, first)
    third = cross(a, second)
    out = v + first + second / 2 + third / 6 + cross(a, third) / 24
    large = _large(a)
    out[large] = mv(exp(a[large]), v[large])
    return out


def _large(theta: Array) -> NDArray[np.intp]:
    """Which turns (n, 3) are beyond the short series."""
    return np.flatnonzero(np.einsum("ni,ni->n", theta, theta) > _LARGE**2)


def log(R: Array) -> Array:
    """Rotation vector [rad] of a rotation matrix, (..., 3, 3) -> (..., 3), angle in [0, pi]."""
    q = quaternion(R)
    vector, w = q[..., :3], q[..., 3]
    sine = np.linalg.norm(vector, axis=-1)
    small = sine < 1e-9
    factor = np.where(small, 2.0, 2 * np.arctan2(sine, w) / np.where(small, 1.0, sine))
    return factor[..., None] * vector


def quaternion(R: Array) -> Array:
    """Unit quaternion x, y, z, w with w >= 0 of a rotation matrix, (..., 3, 3) -> (..., 4)."""
    xx, yy, zz = R[..., 0, 0], R[..., 1, 1], R[..., 2, 2]
    wx, wy, wz = (
        R[..., 2, 1] - R[..., 1, 2],
        R[..., 0, 2] - R[..., 2, 0],
        R[..., 1, 0] - R[..., 0, 1],
    )
    xy, xz, yz = (
        R[..., 0, 1] + R[..., 1, 0],
        R[..., 0, 2] + R[..., 2, 0],
        R[..., 1, 2] + R[..., 2, 1],
    )
    # four times the outer product q q^T: its largest column is the best conditioned
    outer = np.stack(
        [
            np.stack([1 + xx - yy - zz, xy, xz, wx], -1),
            np.stack([xy, 1 - xx + yy - zz, yz, wy], -1),
            np.stack([xz, yz, 1 - xx - yy + zz, wz], -1),
            np.stack([wx, wy, wz, 1 + xx + yy + zz], -1),
        ],
        -2,
    )
    best = np.argmax(np.einsum("...ii->...i", outer), -1)
    q = np.take_along_axis(outer, best[..., None, None], -2)[..., 0, :]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    return np.asarray(np.where(q[..., 3:] < 0, -q, q))


def right_jacobian(theta: Array) -> Array:
    """`Jr` with `Exp(theta + d) ~ Exp(theta) Exp(Jr d)`, (..., 3) -> (..., 3, 3)."""
    _, b, c = _series(theta)
    K = skew(theta)
    return np.asarray(np.eye(3) - b[..., None, None] * K + c[..., None, None] * (K @ K))


def right_jacobian_inverse(theta: Array) -> Array:
    """Inverse of `right_jacobian`, valid below a full turn."""
    t2 = np.einsum("...i,...i->...", theta, theta)
    t = np.sqrt(t2)
    small = t < 1e-3
    safe = np.where(small, 1.0, t)
    closed = 1 / safe**2 - (1 + np.cos(safe)) / (2 * safe * np.where(small, 1.0, np.sin(safe)))
    d = np.where(small, 1 / 12 + t2 / 720, closed)
    K = skew(theta)
    return np.asarray(np.eye(3) + 0.5 * K + d[..., None, None] * (K @ K))


def left_jacobian(theta: Array) -> Array:
    """`Jl(theta) = Jr(-theta)`: the mean of `Exp(s theta)` over s in 0..1."""
    return right_jacobian(-theta)


def orthonormalised(R: Array) -> Array:
    """The nearest rotations to slightly drifted matrices (one Newton step of the polar factor)."""
    return 1.5 * R - 0.5 * R @ np.swapaxes(R, -1, -2) @ R


def mv(R: Array, x: Array) -> Array:
    """Matrix times vector over batches, (..., 3, 3) and (..., 3) -> (..., 3)."""
    return np.asarray(np.einsum("...ij,...j->...i", R, x))


def mtv(R: Array, x: Array) -> Array:
    """Transposed matrix times vector over batches."""
    return np.asarray(np.einsum("...ji,...j->...i", R, x))


def transpose(R: Array) -> Array:
    """Swap the last two axes."""
    return np.swapaxes(R, -1, -2)
