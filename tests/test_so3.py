"""Rotations against scipy and against their own group laws."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from factors import so3
from factors.so3 import Array

# lengths from the Taylor branch over its border up to nearly half a turn
vectors = arrays(np.float64, 3, elements=st.floats(-1, 1)).filter(
    lambda v: bool(np.linalg.norm(v) > 1e-3)
)
angles = st.one_of(
    st.floats(0, np.pi - 1e-3), st.sampled_from([0.0, 1e-12, 9e-5, 1.1e-4, 9e-4, 1.1e-3])
)
rotation_vectors = st.builds(lambda v, a: v / np.linalg.norm(v) * a, vectors, angles)


@given(rotation_vectors)
def test_exp_is_the_matrix_exponential(theta: Array) -> None:
    np.testing.assert_allclose(so3.exp(theta), expm(so3.skew(theta)), atol=1e-14)


@given(rotation_vectors)
def test_log_undoes_exp(theta: Array) -> None:
    np.testing.assert_allclose(so3.log(so3.exp(theta)), theta, atol=1e-12)


@given(vectors)
def test_log_of_half_a_turn(axis: Array) -> None:
    axis = axis / np.linalg.norm(axis)
    found = so3.log(so3.exp(np.pi * axis))
    np.testing.assert_allclose(np.abs(found @ axis), np.pi, atol=1e-7)


@given(rotation_vectors)
def test_quaternion_is_scipys(theta: Array) -> None:
    theirs = Rotation.from_rotvec(theta).as_quat()
    theirs = theirs if theirs[3] >= 0 else -theirs
    np.testing.assert_allclose(so3.quaternion(so3.exp(theta)), theirs, atol=1e-9)


@given(rotation_vectors, vectors)
def test_right_jacobian_is_the_derivative_of_exp(theta: Array, direction: Array) -> None:
    d = 1e-6 * direction
    there = so3.log(so3.exp(theta - d).T @ so3.exp(theta + d)) / 2
    np.testing.assert_allclose(there, so3.right_jacobian(theta) @ d, atol=1e-13)


@given(rotation_vectors)
def test_inverse_jacobian(theta: Array) -> None:
    product = so3.right_jacobian(theta) @ so3.right_jacobian_inverse(theta)
    np.testing.assert_allclose(product, np.eye(3), atol=1e-9)


@given(rotation_vectors)
def test_left_jacobian_is_the_mean_rotation(theta: Array) -> None:
    s, weight = np.polynomial.legendre.leggauss(12)
    mean = np.einsum("k,kij->ij", weight / 2, so3.exp((s[:, None] + 1) / 2 * theta))
    np.testing.assert_allclose(so3.left_jacobian(theta), mean, atol=1e-9)


@given(vectors, vectors)
def test_skew_is_the_cross_product(a: Array, b: Array) -> None:
    np.testing.assert_allclose(so3.skew(a) @ b, np.cross(a, b), atol=1e-15)


@given(rotation_vectors, arrays(np.float64, (3, 3), elements=st.floats(-1e-5, 1e-5)))
def test_orthonormalised_is_a_rotation_near_by(theta: Array, error: Array) -> None:
    R = so3.exp(theta)
    found = so3.orthonormalised(R + error)
    np.testing.assert_allclose(found @ found.T, np.eye(3), atol=1e-8)
    np.testing.assert_allclose(found, R, atol=1e-4)


def test_every_function_takes_batches() -> None:
    theta = np.random.default_rng(1).normal(size=(4, 5, 3))
    R = so3.exp(theta)
    for function in (so3.exp, so3.right_jacobian, so3.right_jacobian_inverse, so3.left_jacobian):
        assert function(theta).shape == (4, 5, 3, 3)
        np.testing.assert_allclose(function(theta)[2, 3], function(theta[2, 3]))
    assert so3.log(R).shape == (4, 5, 3)
    assert so3.quaternion(R).shape == (4, 5, 4)
    np.testing.assert_allclose(so3.mtv(R, so3.mv(R, theta)), theta, atol=1e-14)
