"""Heading from the whole path and the weighing of evidence."""

from itertools import permutations

import numpy as np
import pytest

from graphnav.common.run import Array
from graphnav.inertial.angle_line import angle_line
from graphnav.inertial.heading_evidence import Evidence, weigh
from graphnav.inertial.path_heading import STEP_S, PathHeading, Reckoned, path_heading

DEG = np.pi / 180


def found(
    heading: float,
    pace: float = 8.0,
    fix_sd: float = 2.0,
    rate: float = 0.0,
    seed: int = 1,
    speed_of_wheels: float = 1.0,
    wild: float = 0.0,
) -> PathHeading:
    """A 300 s drive with a standing first minute, its fixes turned to a heading [deg].

    `rate` deg/s that the gyro reads too much; `wild` share of fixes 100 m off.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(0, 300, STEP_S)
    speed = pace * np.clip((t - 60) / 5, 0, 1)
    angle = np.cumsum(0.1 * np.sin(t / 17) + 0.05 * np.sin(t / 7 + seed)) * STEP_S
    truth = Reckoned(t, speed, angle).path(0.0) * np.exp(-1j * heading * DEG)
    at = np.arange(0, len(t), 5)
    fixes = truth[at] + fix_sd * (rng.normal(size=len(at)) + 1j * rng.normal(size=len(at)))
    fixes = fixes + np.where(rng.random(len(at)) < wild, 100.0 * np.exp(1j * at), 0)
    read = Reckoned(t, speed_of_wheels * speed, angle + rate * DEG * t)
    out = path_heading(read, fixes, t[at], np.full(len(at), fix_sd), 200 * DEG / 3600)
    assert out is not None
    return out


def off(found: PathHeading, heading: float) -> float:
    """Degrees between a heading found and the truth."""
    return abs((np.rad2deg(found.heading) - heading + 180) % 360 - 180)


@pytest.mark.parametrize("heading", np.arange(0.0, 360.0, 60.0))
@pytest.mark.parametrize(("pace", "fix_sd"), [(12.0, 3.0), (0.5, 0.02), (3.0, 1.0)])
def test_heading_at_any_speed(heading: float, pace: float, fix_sd: float) -> None:
    out = found(heading, pace, fix_sd, seed=round(heading))
    assert off(out, heading) < min(2.0, 3 * out.sd / DEG)


@pytest.mark.parametrize("rate", [-4.0, -0.3, 0.05, 0.98, 4.0])
def test_bias_is_found_beside_the_heading(rate: float) -> None:
    out = found(250.0, rate=rate)
    assert off(out, 250.0) < 3.0
    assert abs(out.rate / DEG - rate) < 0.02


@pytest.mark.parametrize(("wheels", "wild"), [(0.28, 0.0), (1.2, 0.0), (1.0, 0.2), (-1.0, 0.0)])
def test_wrong_scale_and_wild_fixes_do_not_turn_it(wheels: float, wild: float) -> None:
    out = found(100.0, speed_of_wheels=wheels, wild=wild)
    assert off(out, 280.0 if wheels < 0 else 100.0) < 2.0


def test_fixes_that_stand_say_nothing() -> None:
    t = np.arange(0, 300, STEP_S)
    noise = np.random.default_rng(0).normal(size=(2, 300))
    still = Reckoned(t, np.zeros_like(t), np.zeros_like(t))
    fixes = noise[0] + 1j * noise[1]
    assert path_heading(still, fixes, np.arange(300.0), np.ones(300), 1e-3) is None


def test_a_line_through_angles_goes_on_past_half_a_turn() -> None:
    t: Array = np.arange(0.0, 100.0)
    line = angle_line(np.exp(1j * (3.0 + 0.02 * t)), t, np.full(100, 1e4), 0.1)
    assert line.angle % (2 * np.pi) == pytest.approx(3.0, abs=1e-3)
    assert line.slope == pytest.approx(0.02, abs=1e-5)


def test_evidence_has_no_order() -> None:
    pieces = [
        Evidence(0.10, 0.05, "a", 0.02),
        Evidence(0.12, 0.02, "b", 0.02),
        Evidence(2.0, 0.001, "c", 0.02),
        Evidence(6.3, 0.3, "d", 1e-6),
    ]
    answers = {weigh(list(order)) for order in permutations(pieces)}
    (answer,) = answers
    assert answer.heading % (2 * np.pi) == pytest.approx(0.118, abs=2e-3)
    assert [p.source for p in answer.outvoted] == ["c"]
    assert [p.source for p in answer.agreeing] == ["b", "a", "d"]


def test_two_alike_the_surer_path_wins() -> None:
    pieces = [Evidence(1.0, 0.001, "stated", 0.02), Evidence(4.0, 0.04, "path", 1e-6)]
    assert weigh(pieces).heading == pytest.approx(4.0)
    assert weigh(pieces[:1]).heading == 1.0
