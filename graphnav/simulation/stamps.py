"""How samples reach the file: stamped by a host, some of them never."""

import numpy as np
import pandas as pd

from graphnav.simulation.ellipsoid import Array

JITTER, JITTER_MOST = 0.15, 1.5e-3  # mean delay of a stamp: share of the interval, s at most
LATE_SHARE, LATE = 0.002, 0.8  # now and then a stamp waits this share of the interval longer
APART = 1e-5  # s, least between two stamps
LOST_SHARE = 0.001  # single samples
BURST_EVERY, BURST = 200.0, (0.05, 0.6)  # s between losses of more than one, s of each


def jittered(rng: np.random.Generator, time: Array, dt: float) -> Array:
    """Stamps (N,) of even times (N,): delayed unlike each other, on average not at all."""
    mean = min(JITTER * dt, JITTER_MOST)
    delay = rng.gamma(2.0, mean / 2, len(time))
    delay += LATE * dt * rng.uniform(size=len(time)) * (rng.uniform(size=len(time)) < LATE_SHARE)
    rank = APART * np.arange(len(time))
    stamps = np.maximum.accumulate(time + delay - delay.mean() - rank) + rank
    return np.asarray(np.round(stamps, 6))


def kept(rng: np.random.Generator, time: Array) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Which samples (N,) arrive; the first and the last do."""
    arrives = rng.uniform(size=len(time)) >= LOST_SHARE
    for _ in range(rng.poisson(time[-1] / BURST_EVERY)):
        start = rng.uniform(0, time[-1])
        arrives &= ~((time >= start) & (time < start + rng.uniform(*BURST)))
    arrives[[0, -1]] = True
    return np.asarray(arrives)


def delivered(
    rng: np.random.Generator, run: pd.DataFrame, dt: float, effects: frozenset[str]
) -> pd.DataFrame:
    """The run's rows as they arrive."""
    rows = kept(rng, run["time"].to_numpy()) if "losses" in effects else np.ones(len(run), bool)
    if "jitter" in effects:
        run = run.assign(time=jittered(rng, run["time"].to_numpy(), dt))
    return run[rows].reset_index(drop=True)
