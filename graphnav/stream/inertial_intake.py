"""An IMU's samples arriving piece by piece: judged, put on their own clock, bridged, compounded.

The batch's own functions, over the last samples and a few to come: what is said of time t rests on
samples up to `AHEAD_S` and a frame after it. The result does not depend on the sizes of the pieces.
"""

import numpy as np
from numpy.typing import NDArray

from factors.preintegration import Increments
from graphnav.common.errors import InputError
from graphnav.common.growing_array import GrowingArray
from graphnav.common.run import Array, Imu
from graphnav.inertial.gaps import Mask, bridged
from graphnav.inertial.increments import GRID_S, NEIGHBOURS, increments
from graphnav.inertial.measured import LONGEST_S
from graphnav.inertial.sample_clock import EVEN, SampleClock, sample_clock
from graphnav.inertial.sample_clock import FEWEST as CLOCKED
from graphnav.inertial.screening import BLOCK, screened
from graphnav.inertial.suspects import BEFORE, suspects

FEWEST = 10  # samples that tell the sampling interval
FRAME_S, AHEAD_S = 0.2, 0.2  # judged at a time, and seen after it
LEAST_AHEAD = 4  # samples
BEHIND = 512  # samples before a frame that it is compared with, and up to a block more
LOST_S, REMEMBERED_S = 0.1, 120.0  # a longer loss asks more of the past
PULLED = 0.02  # of what the clock is found off, taken back with every sample


class InertialIntake:
    """Raw samples to increments, the same as `increments` makes of the whole run."""

    def __init__(self, grid_s: float = GRID_S) -> None:
        self._grid_s = grid_s
        self._size = 0  # samples in an increment, once known
        self._usual = 0.0  # s between samples, once known
        self._raw = GrowingArray(9)  # stamp, gyro, accel; whether they were measured, once judged
        self._judged = 0  # of them
        self._sound = -BEHIND - BLOCK  # the first of the newest that all measured
        self._samples = GrowingArray(9)  # time, gyro, accel, doubt: one for every sampling step
        self._step = 0.0  # s, once the clock is known
        self.edge = GrowingArray()
        self._inc = GrowingArray(12)  # rotation, velocity, position, jump, doubt

    def __len__(self) -> int:
        return len(self._inc)

    def add(self, time: Array, gyro: Array, accel: Array) -> None:
        """Samples (n,), (n, 3), (n, 3)."""
        self._raw.append(np.column_stack([time, gyro, accel, np.ones((len(time), 2))]))
        self._judge()

    def finish(self) -> None:
        """No more will come: the samples that waited are judged with what there is."""
        self._judge(last=True)

    def _judge(self, last: bool = False) -> None:
        """Judge frame by frame what has enough samples after it."""
        count = len(self._raw)
        if not self._usual:
            if count < FEWEST:
                return
            stamps = self._raw.rows[: min(count, CLOCKED), 0]
            uneven = np.ptp(np.diff(stamps)) > 0.02 * float(np.median(np.diff(stamps)))
            if uneven and count < CLOCKED and not last:
                return  # stamps that scatter tell their clock later
            self._usual = max(float(stamps[-1] - stamps[0]) / (len(stamps) - 1), 1e-9)
            self._size = max(1, round(self._grid_s / self._usual))
        frame = max(1, round(FRAME_S / self._usual))
        ahead = max(LEAST_AHEAD, round(AHEAD_S / self._usual))
        ends = [self._judged]
        while (rest := count - ends[-1]) > 0 and (last or rest >= frame + ahead):
            ends.append(count if last and rest < frame + ahead else ends[-1] + frame)
        if len(ends) > 1:
            self._frames(ends, ahead)
            self._compound()

    def _frames(self, ends: list[int], ahead: int) -> None:
        """Judge the frames between some samples; what nothing speaks against passes as it is."""
        calm = self._calm(np.array(ends), ahead)
        for done, end, quiet in zip(ends, ends[1:], calm, strict=False):
            if quiet and done - self._sound >= BEHIND + BLOCK:
                continue
            self._pass(done)
            self._frame(end, min(end + ahead, len(self._raw)))
        self._pass(ends[-1])

    def _frame(self, end: int, seen_until: int) -> None:
        """Judge the samples until `end`, with those until `seen_until` known."""
        done = self._judged
        known = self._screened(end, seen_until)
        first = self._behind(bool(known.all()))
        part = self._raw.rows[first:seen_until]
        stamp = part[:, 0]
        if (jump := float(np.diff(stamp).max(initial=0.0))) > LONGEST_S:
            raise InputError(f"add_imu: time jumps by {jump:.6g} s: begin another stream after it")
        imu = Imu(stamp, np.diff(stamp, prepend=stamp[0] - self._usual), part[:, 1:4], part[:, 4:7])
        clock = sample_clock(stamp, self._step or None)
        if clock.even:
            self._step = clock.step
        seen = np.concatenate([part[: done - first, 7:9] > 0, known])
        own = slice(done - first, end - first)
        if seen[own].all() and (clock.steps[own] == 1).all():
            self._keep_whole(end, clock.time[max(own.start - 1, 0) : own.stop])
        else:
            self._keep(bridged(imu, clock, seen), clock, own.start, own.stop)
            faulty = np.flatnonzero(~seen[own].all(axis=1))
            self._sound = done + int(faulty[-1]) + 1 if len(faulty) else self._sound
        self._raw.rows[done:end, 7:9] = seen[own]
        self._judged = end

    def _screened(self, end: int, seen_until: int) -> Mask:
        """Which samples from the last judged on measured, gyro and accelerometer, (n, 2).

        What lies ahead of `end` is judged again.
        """
        done, first = self._judged, self._reaching(BEHIND)
        part = self._raw.rows[first:seen_until]
        dt = np.diff(part[:, 0], prepend=part[0, 0] - self._usual)
        imu = Imu(part[:, 0], dt, part[:, 1:4], part[:, 4:7])
        at_standstill = np.zeros(len(part), bool)
        known = np.ones((seen_until - done, 2), bool)
        for fault in screened(imu, self._step or self._usual, at_standstill, causal=True):
            known[:, fault.sensor] &= ~fault.mask[done - first :]
        return known

    def _pass(self, end: int) -> None:
        """Keep the samples until `end` as they came: evenly, and none of them suspected."""
        if end > self._judged:
            self._keep_whole(end, self._raw.rows[max(self._judged - 1, 0) : end, 0])
            self._judged = end

    def _keep_whole(self, end: int, time: Array) -> None:
        """Keep the samples until `end`, all measured and none lost, from the last kept on at `time`
        s (n,).
        """
        part = self._raw.rows[end - len(time) : end]
        clock = SampleClock(time, np.ones(len(time), np.int64), self._step, True, 0.0 * time)
        dt = np.diff(time, prepend=time[0] - (self._step or self._usual))
        imu = Imu(time, dt, part[:, 1:4], part[:, 4:7])
        self._keep(imu, clock, min(self._judged, 1), len(time))

    def _calm(self, ends: NDArray[np.int64], ahead: int) -> Mask:
        """Whether nothing in each frame between samples `ends` (n + 1,), or in the window it is
        judged in, asks for a test, once what lies before was measured, (n,).
        """
        done, seen = ends[:-1], np.minimum(ends[1:] + ahead, len(self._raw))
        if not self._step:
            return np.zeros(len(done), bool)
        reach = BEHIND + BLOCK + int((seen - done).max())
        first = max(int(done[0]) - BEFORE - reach, 0) // BLOCK * BLOCK
        part = self._raw.rows[first : int(seen[-1])]
        uneven = np.abs(np.diff(part[:, 0]) - self._step) > 0.2 * EVEN * self._step
        named = suspects(part[:, 1:7], self._step, BEHIND, reach)

        def none(mask: Mask, begin: NDArray[np.int64]) -> Mask:
            counted = np.concatenate([[0], np.cumsum(mask)])
            low = np.clip(begin - first, 0, len(mask))
            return np.asarray(counted[np.minimum(seen - first, len(mask))] == counted[low])

        return none(uneven, done - BEHIND - BLOCK) & none(named, done - BEFORE)

    def _behind(self, whole: bool) -> int:
        """The first sample of the window that a frame's clock and gaps are found in.

        Usually as far back as for the tests; after a longer loss, or when the frame is not `whole`,
        `REMEMBERED_S`, in which the vehicle has shown more of what it may have done meanwhile.
        """
        lately = self._raw.rows[max(self._judged - BEHIND, 0) : self._judged]
        lost = not lately[:, 7:9].all() or np.diff(lately[:, 0]).max(initial=0) > LOST_S
        long = max(BEHIND, round(REMEMBERED_S / self._usual))
        return self._reaching(long if lost or not whole else BEHIND)

    def _reaching(self, needed: int) -> int:
        """The first sample of a window with enough measured samples before the next frame."""
        done = self._judged
        for back in (needed, 4 * needed, done):
            first = max(done - back, 0)
            measured = np.flatnonzero(self._raw.rows[first:done, 7:9].all(axis=1))
            if len(measured) >= needed or first == 0:
                break
        first += int(measured[-needed]) if len(measured) > needed else 0
        return first // BLOCK * BLOCK

    def _keep(self, filled: Imu, clock: SampleClock, first: int, end: int) -> None:
        """Append the steps that end with samples `first` to `end - 1` of a window."""
        at = np.cumsum(clock.steps) - 1
        before = int(at[first - 1]) if first else -1
        on = slice(before + 1, int(at[end - 1]) + 1)
        time = filled.time[on]
        if len(self._samples):
            # one clock, not one for every frame: its corrections come in little by little
            newest = float(self._samples.rows[-1, 0])
            shift = newest - (float(filled.time[before]) if first else newest)
            time = time + shift * (1 - PULLED) ** np.arange(1, len(time) + 1)
        else:
            self.edge.push(float(time[0] - filled.dt[on][0]))
        doubt = np.zeros((len(time), 2)) if filled.doubt is None else filled.doubt[on]
        self._samples.append(np.column_stack([time, filled.gyro[on], filled.accel[on], doubt]))

    def _compound(self) -> None:
        samples = self._samples.rows
        size, done = self._size, len(self)
        whole = (len(samples) - NEIGHBOURS) // size
        if whole <= done:
            return
        context = min(done, -(-NEIGHBOURS // size))
        first = (done - context) * size
        part = samples[first : whole * size + NEIGHBOURS]
        before = samples[first - 1, 0] if first else self.edge.rows[0]
        dt = np.diff(part[:, 0], prepend=before)
        imu = Imu(part[:, 0], dt, part[:, 1:4], part[:, 4:7], part[:, 7:9])
        inc = increments(imu, size * float(np.median(dt)))
        new = slice(context, context + whole - done)
        self.edge.append(inc.edge[1:][new])
        assert inc.doubt is not None
        columns = (inc.rotation, inc.velocity, inc.position, inc.jump[:, None], inc.doubt)
        self._inc.append(np.concatenate([x[new] for x in columns], axis=1))

    def between(self, first: int, end: int) -> Increments:
        """Increments `first` to `end - 1`."""
        x = self._inc.rows[first:end]
        edge = self.edge.rows[first : end + 1]
        return Increments(edge, x[:, 0:3], x[:, 3:6], x[:, 6:9], x[:, 9], x[:, 10:12])
