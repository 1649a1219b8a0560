"""What neighbouring fixes have in common is found in their residuals."""

import numpy as np
import pytest

from factors.block import Block, Term
from factors.calibration import Component, Layout
from factors.estimate import Estimate
from factors.position import AXES
from graphnav.graph.common_error import ASSUMED, KEY, MEMORY, found_common

SD = 0.5
LAYOUT = Layout((Component("gnss_offset", np.zeros(3), np.full(3, SD), memory=300.0),))


def found(error: np.ndarray, path: np.ndarray, before: dict[str, float]) -> dict[str, float]:
    """Of fixes once a second whose errors (n, 3) m a stiff path shows."""
    n = len(error)
    segment = np.arange(n) // 10
    term = Term("c", segment, np.tile(np.eye(3), (n, 1, 1)))
    # the common part as the graph has it: of every segment the middle
    c = np.stack([np.median(error[segment == k], axis=0) for k in range(segment[-1] + 1)])
    residual = c[segment] - error
    block = Block("gnss", AXES, np.arange(n) * 1.0, residual, (term,), True, np.ones((n, 3)))
    at = Estimate(np.eye(3)[None], np.zeros((1, 3)), np.zeros((1, 3)), np.zeros(1), c)
    return found_common([block], LAYOUT, at, path, before)


def process(rng: np.random.Generator, n: int, sd: float, memory: float) -> np.ndarray:
    phi, x = np.exp(-1 / memory), np.empty(n)
    x[0] = rng.normal() * sd
    for k in range(1, n):
        x[k] = phi * x[k - 1] + sd * np.sqrt(1 - phi * phi) * rng.normal()
    return x


@pytest.mark.parametrize("seed", range(3))
def test_white_errors_have_nothing_in_common(seed: int) -> None:
    error = np.random.default_rng(seed).normal(size=(1200, 3))
    error[300:310] += 30.0  # a spell of multipath is no process
    common = found(error, np.full(3, 0.01), ASSUMED)
    assert max(common[f"{KEY}::{axis}"] for axis in AXES) < 0.4


@pytest.mark.parametrize("seed", range(3))
def test_a_process_is_found_with_its_time_constant(seed: int) -> None:
    rng = np.random.default_rng(seed)
    error = 0.3 * rng.normal(size=(6000, 3))
    error += np.stack([process(rng, 6000, 0.25, 80.0) for _ in range(3)], -1)
    common = found(error, np.full(3, 0.01), ASSUMED)
    assert 40.0 <= common[MEMORY] <= 160.0
    for axis in AXES:
        assert common[f"{KEY}::{axis}"] * SD == pytest.approx(0.25, rel=0.4)


@pytest.mark.parametrize(("path", "believed"), [(0.1, True), (30.0, False)])
def test_a_drag_is_believed_where_the_path_is_surer(path: float, believed: bool) -> None:
    error = np.random.default_rng(1).normal(size=(600, 3))
    error[:, 0] += np.maximum(np.arange(600) - 300, 0) * 0.1
    share = found(error, np.full(3, path), {})[f"{KEY}::east"]
    assert (share > 5) == believed
