"""The chain of calibrations: priors, walks and processes with memory."""

import numpy as np
from factor_check import assert_jacobian, dense_jacobian, random_estimate

from factors.calibration import Component, Layout, walk
from factors.calibration import prior as calibration_prior
from factors.estimate import Estimate


def test_calibration_chain() -> None:
    rng = np.random.default_rng(1)
    layout = Layout(
        (
            Component("gyro_bias", np.zeros(3), np.full(3, 0.1), 0.01),
            Component("scale", np.ones(1), np.full(1, 0.02), 1e-3),
            Component("lever", np.zeros(2), np.ones(2)),
            Component("gnss_offset", np.ones(2), np.full(2, 0.5), memory=30.0),
        )
    )
    assert layout.dim == 8
    assert layout.column("scale") == 3 and layout.find("delay") is None
    x = random_estimate(rng, 2, 3, layout.dim)
    time = np.array([5.0, 15.0, 25.0])
    assert_jacobian(lambda e: calibration_prior(layout, e.calibration)[0], x)
    known = calibration_prior(layout, x.calibration, ("lever",))
    assert [(b.kind, b.robust) for b in known] == [("calibration_prior", False), ("stated", True)]
    for k in range(2):
        assert_jacobian(lambda e, k=k: calibration_prior(layout, e.calibration, ("lever",))[k], x)
    blocks = walk(layout, x.calibration, time, ("scale",))
    assert [b.kind for b in blocks] == ["calibration_walk", "scale_walk"]
    for k, block in enumerate(blocks):
        assert_jacobian(lambda e, k=k: walk(layout, e.calibration, time, ("scale",))[k], x)
        assert block.robust == (k == 1)
    # a constant stays what it is: over a day not a thousandth of its sigma
    np.testing.assert_array_equal(layout.walk[:4], [0.01, 0.01, 0.01, 1e-3])
    assert (layout.walk[4:6] * np.sqrt(86400) < 1e-3 * layout.prior_sd[4:6]).all()
    still = Estimate(x.R_nb, x.v_n, x.p_n, x.phase, np.tile(layout.prior, (3, 1)))
    assert not any(
        b.residual.any() for b in calibration_prior(layout, still.calibration, ("lever",))
    )
    assert all(np.abs(b.residual).max() == 0 for b in walk(layout, still.calibration, time, ()))
    faded = still.calibration.copy()
    faded[:, 6:] += 0.8 * np.exp(-(time - time[0]) / 30.0)[:, None]  # as a process forgets
    assert np.abs(walk(layout, faded, time, ())[0].residual).max() < 1e-9


def test_a_process_with_memory_keeps_its_deviation() -> None:
    """Prior and steps together leave every segment of a long chain with the same deviation."""
    layout = Layout((Component("gnss_offset", np.zeros(1), np.full(1, 0.5), memory=30.0),))
    c, time = np.zeros((40, 1)), np.linspace(5.0, 395.0, 40)
    x = Estimate(np.eye(3)[None], np.zeros((1, 3)), np.zeros((1, 3)), np.zeros(1), c)
    blocks = [*calibration_prior(layout, c), *walk(layout, c, time, ())]
    J = np.concatenate([dense_jacobian(b, x)[:, 10:] for b in blocks])
    np.testing.assert_allclose(np.diag(np.linalg.inv(J.T @ J)), 0.25, rtol=1e-9)
