"""What was measured and when: a run's inertial samples on their own clock, screened and bridged."""

from dataclasses import replace

import numpy as np

from graphnav.common.errors import InputError
from graphnav.common.run import Array, Imu, Odometer, Run
from graphnav.inertial.clock_jumps import without_jumps
from graphnav.inertial.counting_direction import put_forward
from graphnav.inertial.encoder import failures, without
from graphnav.inertial.exchanged_axes import Exchange, exchanges, put_back
from graphnav.inertial.gaps import Mask, bridged
from graphnav.inertial.odometer_steps import speed_at
from graphnav.inertial.sample_clock import SampleClock, sample_clock
from graphnav.inertial.screening import NAMES, Screened, screened

LONGEST_S = 3600.0  # a longer gap is the clock's, not the IMU's
STANDSTILL_SPEED, STANDSTILL_WINDOW_S = 0.02, 0.5  # m/s over s to either side: the wheels stand


def measured(run: Run) -> Run:
    """The run with one inertial sample for every sampling step of the IMU's clock.

    What is no measurement is bridged and doubted (`Imu.doubt`); rows that other sensors share with
    the IMU have its time. All of it is told in `Run.notes`.
    """
    if run.imu is None or len(run.imu.time) < 2:
        return run
    read = run
    _check_clock(run, run.imu)
    run = without_jumps(run)
    imu = run.imu
    assert imu is not None
    clock = sample_clock(imu.time)
    found = screened(imu, clock.step, _at_standstill(run, imu.time))
    seen = np.ones((len(imu.time), 2), bool)
    for fault in found:
        seen[fault.mask, fault.sensor] = False
    turned: list[str] = []
    if run.felt:
        felt = replace(imu, accel=np.where(seen[:, 1:], imu.accel, 0.0))
        run, turned = put_forward(run, felt)
    notes = [*_clock_notes(run, clock), *(_note(run, fault) for fault in found), *turned]
    whole = all(run.sensed)  # stand-ins know of no exchange
    for exchange in exchanges(imu, run.odometer, seen) if whole else ():
        imu = put_back(imu, exchange)
        seen[exchange.open, exchange.sensor] = False
        notes.append(_exchange_note(run, exchange))
    imu = bridged(imu, clock, seen)
    odometer, failed = _odometer(run, imu)
    notes += failed
    if not notes and run is read:
        return run
    return replace(run, imu=imu, logged=run.imu, odometer=odometer, notes=(*run.notes, *notes))


def _check_clock(run: Run, imu: Imu) -> None:
    """InputError where the clock jumps by more than can be bridged."""
    gone = np.diff(imu.time)
    worst = int(gone.argmax())
    if gone[worst] > LONGEST_S:
        raise InputError(
            f"{run.path}: the clock jumps by {gone[worst]:.6g} s after "
            f"{_at(run, imu.time[worst])}: no IMU is silent for so long; cut the file there, or "
            "mend its time column"
        )


def _odometer(run: Run, imu: Imu) -> tuple[Odometer | None, list[str]]:
    """The odometer without what it tells after it failed, and what is told of that."""
    odometer, notes = run.odometer, []
    if odometer is None:
        return None, []
    failed = np.zeros(len(odometer.time), bool)
    for failure in failures(odometer, imu, run.felt):
        failed |= failure.mask
        at = odometer.time[failure.mask]
        notes.append(
            f"the odometer {failure.what} between {_at(run, at[0])} and {_at(run, at[-1])} "
            f"({len(at)} samples): not used there"
        )
    return (without(odometer, failed) if notes else odometer), notes


def _at_standstill(run: Run, time: Array) -> Mask:
    """Where the odometer is heard to stand still, at times (N,) s."""
    if run.odometer is None:
        return np.zeros(len(time), bool)
    slow = np.abs(speed_at(run.odometer, time, STANDSTILL_WINDOW_S)) < STANDSTILL_SPEED
    return np.asarray(slow & (time > run.odometer.time[0]) & (time < run.odometer.time[-1]))


def _clock_notes(run: Run, clock: SampleClock) -> list[str]:
    notes = []
    lost = int((clock.steps - 1).sum())
    if lost:
        worst = int(clock.steps.argmax())
        gaps = int((clock.steps > 1).sum())
        notes.append(
            f"the IMU lost {lost} of {len(clock.steps) + lost} samples in {gaps} gaps, the longest "
            f"{(clock.steps[worst] - 1) * clock.step:.3g} s before {_at(run, clock.time[worst])}: "
            "bridged from both sides, and doubted by how the motion around them changes"
        )
    if clock.late.any():
        notes.append(
            f"the IMU's stamps scatter by {1e3 * float(np.std(clock.late)):.3g} ms (up to "
            f"{1e3 * float(clock.late.max()):.3g} ms late) about an even clock of "
            f"{1 / clock.step:.6g} Hz: its samples are taken to come evenly"
        )
    return notes


def _note(run: Run, fault: Screened) -> str:
    assert run.imu is not None
    at = np.flatnonzero(fault.mask)
    first, last = _at(run, run.imu.time[at[0]]), _at(run, run.imu.time[at[-1]])
    when = f"at {first}" if len(at) == 1 else f"between {first} and {last}"
    count = "1 sample" if len(at) == 1 else f"{len(at)} samples"
    return (
        f"the {NAMES[fault.sensor]} is {fault.what} {when} ({count}): not used, bridged and doubted"
    )


def _exchange_note(run: Run, exchange: Exchange) -> str:
    assert run.imu is not None
    at = run.imu.time[exchange.mask | exchange.open]
    return (
        f"the {NAMES[exchange.sensor]}'s axes {exchange.axes} stand exchanged from about "
        f"{_at(run, at[0])} to {_at(run, at[-1])}, as gravity and the vehicle's turns show: put "
        f"back; {exchange.open.sum()} samples about the beginning and the end are not used, but "
        "bridged and doubted"
    )


def _at(run: Run, time: float) -> str:
    return f"{run.clock_start + time:.3f}"
