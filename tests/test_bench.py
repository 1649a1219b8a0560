"""The benchmark's gate: what it calls slower, and what it lets pass."""

import bench
import pytest


def one(seconds: float, solve: float, unit: float = 0.05, memory: float = 700.0) -> dict:
    return {
        "seconds": seconds,
        "unit": unit,
        "stages": {"reading": 1.0, "solve": solve},
        "peak_memory_mb": memory,
    }


BASE = {"4000s": one(8.0, 3.0)}


@pytest.mark.parametrize(
    ("now", "said"),
    [
        (one(12.0, 4.0), ["total"]),
        (one(9.5, 6.0), ["solve"]),
        (one(8.0, 3.0, memory=1400.0), ["memory 1400 MB"]),
        (one(9.0, 3.5), []),
        (one(16.0, 6.0, unit=0.1) | {"stages": {"reading": 2.0, "solve": 6.0}}, []),  # slow machine
        (one(8.0, 3.0, unit=0.025), ["total", "solve"]),  # quick machine, same seconds
    ],
)
def test_gate_compares_units_not_seconds(now: dict, said: list[str]) -> None:
    lost = [line for line in bench.slower({"4000s": now}, BASE) if "reading" not in line]
    assert len(lost) == len(said)
    for word in said:
        assert any(word in line and "4000s" in line for line in lost)


def test_a_short_stage_may_jitter() -> None:
    base = {"600s": one(2.0, 0.05)}
    assert bench.slower({"600s": one(2.0, 0.15)}, base) == []
    assert bench.slower({"600s": one(2.1, 0.25)}, base) != []


def test_only_cases_of_both_are_compared() -> None:
    assert bench.slower({"new": one(9.0, 9.0)}, BASE) == []


def test_rounds_of_a_stage_add_up() -> None:
    merged = bench._merged({"solve, round 1": 1.0, "reading": 0.5, "solve, round 2": 0.25})
    assert merged == {"solve": 1.25, "reading": 0.5}
