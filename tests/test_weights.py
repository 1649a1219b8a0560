"""Weight functions: their shape, their losses, and the same in GTSAM."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from factors.weights import Name, Robust

FAMILY: tuple[Name, ...] = ("none", "huber", "cauchy", "geman_mcclure", "igg3")
members = st.builds(
    lambda name, k0, more: Robust(name, k0, k0 + more),
    st.sampled_from(FAMILY),
    st.floats(0.5, 5),
    st.floats(0.5, 8),
)
residuals = st.floats(-50, 50)


@given(members, residuals)
def test_weights_lie_between_nothing_and_all(robust: Robust, u: float) -> None:
    assert 0 <= float(robust.weight(np.array(u))) <= 1


@given(members, residuals)
def test_weights_know_no_sign(robust: Robust, u: float) -> None:
    assert robust.weight(np.array(u)) == robust.weight(np.array(-u))


@given(members, residuals, st.floats(0, 10))
def test_more_error_never_weighs_more(robust: Robust, u: float, more: float) -> None:
    near, far = robust.weight(np.array([abs(u), abs(u) + more]))
    assert far <= near + 1e-15


@given(members)
def test_no_error_weighs_all(robust: Robust) -> None:
    assert float(robust.weight(np.array(0.0))) == 1


@given(st.floats(0.5, 4), st.floats(0.5, 8), st.floats(-20, 20))
def test_igg3_is_full_then_fades_then_nothing(k0: float, more: float, u: float) -> None:
    k1 = k0 + more
    w = float(Robust("igg3", k0, k1).weight(np.array(u)))
    if abs(u) <= k0:
        assert w == 1
    elif abs(u) >= k1:
        assert w == 0
    else:  # D3 as printed
        assert w == pytest.approx(k0 / abs(u) * ((k1 - abs(u)) / (k1 - k0)) ** 2)


@given(st.floats(0.5, 4), st.floats(0.5, 8))
def test_igg3_is_continuous(k0: float, more: float) -> None:
    k1, h = k0 + more, 1e-9
    around = np.array([k0 - h, k0 + h, k1 - h, k1 + h])
    w = Robust("igg3", k0, k1).weight(around)
    np.testing.assert_allclose(w[::2], w[1::2], atol=1e-7)


@given(st.sampled_from(FAMILY), st.floats(0.5, 4), st.floats(0.5, 8), st.floats(-20, 20))
def test_a_loss_has_its_weight_as_derivative(name: Name, k0: float, more: float, u: float) -> None:
    h, robust = 1e-5, Robust(name, k0, k0 + more)
    above, below = robust.loss(np.array([u + h, u - h]))
    weight = float(robust.weight(np.array(u)))
    assert (above - below) / (2 * h) == pytest.approx(u * weight, abs=1e-4)
    assert robust.loss(np.zeros(1)) == 0


@pytest.mark.parametrize("name", FAMILY)
def test_gtsam_weighs_the_same(name: Name) -> None:
    robust = Robust(name, 1.7, 5.0)
    theirs = robust.m_estimator()
    for u in (-9.0, -3.0, -1.0, 0.0, 0.5, 1.6, 1.8, 4.9, 5.1):
        assert theirs.weight(u) == pytest.approx(float(robust.weight(np.array(u))), abs=1e-12)


def test_axes_are_weighed_apart() -> None:
    u = np.array([[20.0, 0.1, 0.1], [0.1, 20.0, 0.1]])
    np.testing.assert_array_equal(Robust("igg3").weight(u), [[0, 1, 1], [1, 0, 1]])
