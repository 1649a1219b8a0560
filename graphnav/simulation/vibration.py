"""Vibration at the IMU: resonances and tones above and below its sample rate.

It shakes the IMU about its place on the path by less than half a millimetre: the truth is the path.
"""

import numpy as np
from scipy.signal import iirpeak, lfilter

from graphnav.simulation.drive import Driven, Options, stream
from graphnav.simulation.ellipsoid import Array
from graphnav.simulation.field import FieldConditions, Shaking, roughness

HZ = 2000  # of its own grid
RESONANCES = ((12.0, 20.0, 0.35), (25.0, 70.0, 0.6), (90.0, 260.0, 0.7))  # from, to [Hz], share
QUALITY = (3.0, 9.0)  # of the resonances
TONE_SHARE = 0.3  # of the running gear's tone
WINDOW = 0.5  # of its interval a mean takes in: filters are not made for the rate they are read at


def vibration(driven: Driven, options: Options) -> tuple[Array, Array]:
    """What the gyros [rad/s] and accelerometers [m/s^2] make of it (N, 3) each."""
    field = driven.setup.field
    assert field is not None
    rng = stream(options.seed, "vibration")
    time = driven.commands.time
    fine = np.arange(round(time[-1] * HZ) + 1) / HZ
    level, phase = _level(rng, field, driven)
    level = np.interp(fine, time, level)
    phase = np.interp(fine, time, phase)
    window = 1 / HZ if options.sampled else max(WINDOW / options.rate_hz, 1 / HZ)
    rms = (*field.shaking.gyro, *field.shaking.accel)
    columns = []
    for each in rms:
        shaken = options.vibration * each * _axis(rng, field.shaking, level, phase, fine)
        columns.append(_seen(fine, shaken, driven.truth.time[1:], window))
    seen = np.stack(columns, -1)
    return seen[:, :3], seen[:, 3:]


def _level(rng: np.random.Generator, field: FieldConditions, driven: Driven) -> tuple[Array, Array]:
    """Strength (M,) at the internal nodes and phase (M,) rad of the running gear's tone."""
    drive, shaking = driven.commands, field.shaking
    dt = float(drive.time[1])
    gear = np.abs(drive.speed) + field.half_gauge * np.abs(drive.yaw_rate)
    ground = roughness(rng, field.stretch, np.cumsum(np.abs(drive.speed)) * dt)
    level = ground * (gear / shaking.speed) ** shaking.power
    return level, 2 * np.pi / shaking.pitch * np.cumsum(gear) * dt


def _axis(
    rng: np.random.Generator, shaking: Shaking, level: Array, phase: Array, time: Array
) -> Array:
    """One axis (K,), rms 1 where the level (K,) is 1."""
    total = np.zeros(len(time))
    for low, high, share in RESONANCES:
        hz = float(np.exp(rng.uniform(np.log(low), np.log(high))))
        peak = lfilter(*iirpeak(hz, rng.uniform(*QUALITY), HZ), rng.standard_normal(len(time)))
        total += share * peak / peak.std()
    total += TONE_SHARE * np.sqrt(2) * np.sin(phase + rng.uniform(0, 2 * np.pi))
    total *= level / np.sqrt(sum(share**2 for *_, share in RESONANCES) + TONE_SHARE**2)
    engine = 2 * np.pi * shaking.engine_hz * rng.uniform(0.97, 1.03) * time
    return np.asarray(
        total + shaking.idle * np.sqrt(2) * np.sin(engine + rng.uniform(0, 2 * np.pi))
    )


def _seen(time: Array, value: Array, at: Array, window: float) -> Array:
    """Means (N,) of a signal (K,) over the `window` s before each time `at` (N,)."""
    integral = np.concatenate([[0.0], np.cumsum(value[1:] + value[:-1]) * (0.5 / HZ)])
    return np.asarray(
        (np.interp(at, time, integral) - np.interp(at - window, time, integral)) / window
    )
