"""What a stream leaves the tests of samples out for: nothing that any of them would name."""

import numpy as np
import pytest

from graphnav.common.run import Array, Imu
from graphnav.inertial.screening import BLOCK, screened
from graphnav.inertial.suspects import BEFORE, suspects
from graphnav.stream.inertial_intake import BEHIND

STEP, FRAME, AHEAD = 0.01, 20, 20
COUNT = 4000


def driven(rng: np.random.Generator) -> Array:
    """Six channels (N, 6) of a vehicle that stands, starts and turns."""
    t = np.arange(COUNT) * STEP
    rough = np.where(np.sin(0.4 * t) > 0, 1.0, 0.05)[:, None]
    smooth = np.sin(np.outer(t, rng.uniform(0.1, 1.0, 6)) + rng.uniform(0, 6, 6))
    return 0.1 * smooth + 0.02 * rough * rng.standard_normal((COUNT, 6))


def spoilt(x: Array, kind: str, rng: np.random.Generator) -> Array:
    """The channels with one kind of fault at several places."""
    y = x.copy()
    if kind == "clipped":
        return np.clip(y, -np.inf, np.quantile(y, 0.997, axis=0))
    if kind == "unrecorded":
        y[:, 3:] = 0.0
        return y
    for k in rng.integers(BEHIND, COUNT // 2, 9).tolist():
        channel, length = int(rng.integers(6)), int(rng.integers(1, 5))
        match kind:
            case "spike":
                y[k : k + length, channel] += rng.choice([0.3, 3.0])
            case "stuck":
                y[k : k + 10 * length, channel] = y[k, channel]
            case "repeated":
                y[k] = y[k - 1]
            case "absurd":
                y[k, channel] = rng.choice([1e300, 6e3, -7e3])
    return y


@pytest.mark.parametrize("kind", ["spike", "stuck", "repeated", "clipped", "absurd", "unrecorded"])
def test_what_is_not_suspected_is_never_named(kind: str) -> None:
    rng = np.random.default_rng(5)
    x = spoilt(driven(rng), kind, rng)
    time = STEP * np.arange(1, COUNT + 1)
    named, passed, sound = 0, 0, 0
    mask = suspects(x, STEP, BEHIND, BEHIND + BLOCK + FRAME + AHEAD)
    for done in range(BEHIND + BLOCK, COUNT - AHEAD, FRAME):
        first, seen = (done - BEHIND) // BLOCK * BLOCK, min(done + FRAME + AHEAD, COUNT)
        on = slice(first, seen)
        imu = Imu(time[on], np.full(seen - first, STEP), x[on, :3], x[on, 3:])
        found = screened(imu, STEP, np.zeros(seen - first, bool), causal=True)
        bad = np.any([f.mask[done - first :] for f in found] or [[False]], axis=0)
        named += bool(bad.any())
        faulty = np.flatnonzero(bad[:FRAME])
        calm = done - sound >= BEHIND + BLOCK and not mask[done - BEFORE : seen].any()
        sound = done + int(faulty[-1]) + 1 if len(faulty) else sound
        if calm:
            passed += 1
            assert not bad.any()
    assert named > 5 or kind == "unrecorded"
    assert passed > 10


def test_clean_samples_are_not_suspected() -> None:
    x = driven(np.random.default_rng(6))
    assert suspects(x, STEP, BEHIND, BEHIND + 2 * BLOCK)[BEHIND:].mean() < 0.1
