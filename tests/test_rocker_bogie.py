"""Rocker-bogie kinematics against finite differences, rigid-body identities and bad wheels."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from factors import rocker_bogie as rb

LINKAGE = rb.Linkage(
    l_m1=0.32, l_m2=0.55, l_r1=0.29, l_r2=0.27, d_a1=0.34, d_a2=0.21, d_a3=0.22, d_r=0.12,
    l_x=0.08, l_z=0.05, l_d=0.52, wheel_radius=0.15,
)  # fmt: skip
N = 40


def random_joints(rng: np.random.Generator, n: int = N) -> rb.Joints:
    return rb.Joints(
        steer=rng.uniform(-0.6, 0.6, (n, 6)),
        rocker=rng.uniform(-0.3, 0.3, n),
        bogie=rng.uniform(-0.4, 0.4, (n, 2)),
    )


def level(n: int = N) -> rb.Joints:
    return rb.Joints(steer=np.zeros((n, 6)), rocker=np.zeros(n), bogie=np.zeros((n, 2)))


def driven(v_b: np.ndarray, w_z: np.ndarray) -> tuple[np.ndarray, rb.Joints]:
    """Wheel rates and steering that carry the centroid at (v_x, v_y), turning at w_z, flat."""
    p = rb.wheel_positions(LINKAGE, level(len(w_z)))
    arm = p - p.mean(axis=1, keepdims=True)
    v = v_b[:, None, :2] + w_z[:, None, None] * np.stack([-arm[..., 1], arm[..., 0]], -1)
    forward = np.where(v[..., 1] < 0, -1.0, 1.0)
    steer = np.arctan2(forward * v[..., 0], forward * v[..., 1])
    wheel = forward * np.linalg.norm(v, axis=-1) / LINKAGE.wheel_radius
    n = len(w_z)
    return wheel, rb.Joints(steer=steer, rocker=np.zeros(n), bogie=np.zeros((n, 2)))


def random_drive(seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    v_b = np.stack([rng.uniform(-0.02, 0.02, N), rng.uniform(0.05, 0.2, N), np.zeros(N)], -1)
    return v_b, rng.uniform(-0.08, 0.08, N)


def test_signs() -> None:
    joints = rb.Joints(steer=np.full((1, 6), 0.1), rocker=np.array([0.2]), bogie=np.zeros((1, 2)))
    flat, flexed = (rb.wheel_positions(LINKAGE, j)[0] for j in (level(1), joints))
    assert np.all(flat[[0, 2, 4], 0] < 0) and np.all(flat[[1, 3, 5], 0] > 0)  # odd left, even right
    assert flat[0, 1] > flat[2, 1] > flat[4, 1]  # front, middle, rear
    assert flexed[0, 2] > flat[0, 2] and flexed[1, 2] < flat[1, 2]  # beta_1 > 0 lifts wheel 1
    u = rb.rolling_direction(joints)[0]
    assert np.all(u[:, 0] > 0)  # steering right positive
    assert u[0, 2] > 0 > u[1, 2]
    bogie = rb.Joints(steer=np.zeros((1, 6)), rocker=np.zeros(1), bogie=np.array([[0.2, 0.0]]))
    moved = rb.wheel_positions(LINKAGE, bogie)[0] - flat
    assert moved[2, 2] > 0 > moved[4, 2] and np.all(moved[[0, 1, 3, 5]] == 0)


def test_jacobian_is_the_derivative_of_the_rolling_rim() -> None:
    """Forward kinematics of the point of the rim on the ground, turned by the wheel angle."""
    joints = random_joints(np.random.default_rng(1))

    def rim(theta: float) -> np.ndarray:
        """(N, 6, 3): rim point that is lowest at theta = 0, link and steering axes composed."""
        s, c = np.sin(joints.steer), np.cos(joints.steer)
        ahead, down = -np.sin(theta), np.cos(theta)  # rolls backwards under the body
        in_link = LINKAGE.wheel_radius * np.stack([s * ahead, c * ahead, -down + 0 * s], -1)
        cp, sp = np.cos(rb.link_pitch(joints)), np.sin(rb.link_pitch(joints))
        y, z = in_link[..., 1], in_link[..., 2]
        turned = np.stack([in_link[..., 0], cp * y - sp * z, sp * y + cp * z], -1)
        return np.asarray(rb.wheel_positions(LINKAGE, joints) + turned)

    h = 1e-6
    numeric = -(rim(h) - rim(-h)) / (2 * h)  # the rim stands, so the body moves the other way
    np.testing.assert_allclose(rb.wheel_jacobians(LINKAGE, joints), numeric, atol=1e-9)


def test_position_rates_are_the_derivative_of_positions() -> None:
    rng = np.random.default_rng(2)
    joints, rates = random_joints(rng), random_joints(rng)
    h = 1e-6

    def moved(t: float) -> np.ndarray:
        return rb.wheel_positions(
            LINKAGE,
            rb.Joints(
                joints.steer, joints.rocker + t * rates.rocker, joints.bogie + t * rates.bogie
            ),
        )

    numeric = (moved(h) - moved(-h)) / (2 * h)
    np.testing.assert_allclose(
        rb.wheel_position_rates(LINKAGE, joints, rates), numeric, rtol=0, atol=1e-9
    )


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10**6))
def test_flat_ground_without_slip_is_exact(seed: int) -> None:
    v_b, w_z = random_drive(seed)
    wheel, joints = driven(v_b, w_z)
    motion = rb.body_motion(LINKAGE, wheel, joints)
    np.testing.assert_allclose(motion.v_b, v_b, atol=1e-9)
    np.testing.assert_allclose(motion.w_z, w_z, atol=1e-9)
    assert np.all(motion.weight_roll == 1) and np.all(motion.weight_side == 1)
    mean_v, mean_w = rb.mean_motion(LINKAGE, wheel, joints)
    np.testing.assert_allclose(mean_v, v_b, atol=1e-9)
    np.testing.assert_allclose(mean_w, w_z, atol=1e-9)


@pytest.mark.parametrize("fault", [0.0, 2.5, -1.0, np.nan])
@pytest.mark.parametrize("i", range(6))
def test_a_wheel_that_disagrees_has_no_say(i: int, fault: float) -> None:
    """Blocked, spinning, turning backwards or silent: the other five decide, exactly."""
    v_b, w_z = random_drive(3)
    wheel, joints = driven(v_b, w_z)
    wheel[:, i] *= fault
    motion = rb.body_motion(LINKAGE, wheel, joints)
    np.testing.assert_allclose(motion.v_b, v_b, atol=1e-9)
    np.testing.assert_allclose(motion.w_z, w_z, atol=1e-9)
    assert np.all(motion.weight_roll[:, i] == 0)
    assert np.all(np.delete(motion.weight_roll, i, axis=1) == 1)
    if np.isfinite(fault):
        mean_w = rb.mean_motion(LINKAGE, wheel, joints)[1]
        assert np.abs(mean_w - w_z).max() > 0.01  # the plain mean is led astray


def test_two_spinning_wheels_are_still_outvoted() -> None:
    v_b, w_z = random_drive(4)
    wheel, joints = driven(v_b, w_z)
    wheel[:, [0, 5]] *= 1.8
    motion = rb.body_motion(LINKAGE, wheel, joints)
    np.testing.assert_allclose(motion.v_b, v_b, atol=1e-9)


def test_flexing_linkage_on_a_straight_drive_is_no_yaw_rate() -> None:
    """Body level and driving straight, rockers swinging: wheels follow the exact kinematics."""
    rng = np.random.default_rng(5)
    joints = rb.Joints(
        steer=np.zeros((N, 6)),
        rocker=rng.uniform(-0.3, 0.3, N),
        bogie=rng.uniform(-0.3, 0.3, (N, 2)),
    )
    rates = rb.Joints(
        steer=np.zeros((N, 6)),
        rocker=rng.uniform(-0.2, 0.2, N),
        bogie=rng.uniform(-0.2, 0.2, (N, 2)),
    )
    v_ground = rb.wheel_position_rates(LINKAGE, joints, rates) + np.array([0.0, 0.1, 0.0])
    u = rb.rolling_direction(joints)
    rolling = v_ground[..., 1] / u[..., 1] / LINKAGE.wheel_radius
    wheel = rolling + rb.link_pitch(rates)
    motion = rb.body_motion(LINKAGE, wheel, joints, rates)
    np.testing.assert_allclose(motion.w_z, 0.0, atol=1e-9)
    np.testing.assert_allclose(motion.v_b[:, 1], v_ground[..., 1].mean(axis=1), atol=1e-9)
    assert np.abs(rb.body_motion(LINKAGE, wheel, joints).w_z).max() > 0.01


def test_too_few_wheels_give_nan() -> None:
    v_b, w_z = random_drive(6)
    wheel, joints = driven(v_b, w_z)
    wheel[0, :] = np.nan
    motion = rb.body_motion(LINKAGE, wheel, joints)
    assert np.isnan(motion.v_b[0]).all() and np.isfinite(motion.w_z[1:]).all()
