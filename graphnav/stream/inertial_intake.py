"""An IMU's samples arriving piece by piece: judged, put on their own clock, bridged, compounded.

The batch's own functions, over the last samples and a few to come: what is said of time t rests on
samples up to `AHEAD_S` and a frame after it. The result does not depend on the sizes of the pieces.
"""

import numpy as np

from factors.preintegration import Increments
from graphnav.common.errors import InputError
from graphnav.common.growing_array import GrowingArray
from graphnav.common.run import Array, Imu
from graphnav.inertial.gaps import bridged
from graphnav.inertial.increments import GRID_S, NEIGHBOURS, increments
from graphnav.inertial.measured import LONGEST_S
from graphnav.inertial.sample_clock import FEWEST as CLOCKED
from graphnav.inertial.sample_clock import SampleClock, sample_clock
from graphnav.inertial.screening import screened

FEWEST = 10  # samples that tell the sampling interval
FRAME_S, AHEAD_S = 0.2, 0.2  # judged at a time, and seen after it
LEAST_AHEAD = 4  # samples
BEHIND = 512  # samples before a frame that it is compared with
LOST_S, REMEMBERED_S = 0.1, 120.0  # a longer loss asks more of the past
PULLED = 0.02  # of what the clock is found off, taken back with every sample


class Inertial:
    """Raw samples to increments, the same as `increments` makes of the whole run."""

    def __init__(self, grid_s: float = GRID_S) -> None:
        self._grid_s = grid_s
        self._size = 0  # samples in an increment, once known
        self._usual = 0.0  # s between samples, once known
        self._raw = GrowingArray(9)  # stamp, gyro, accel; whether they were measured, once judged
        self._judged = 0  # of them
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
        new = False
        while (rest := count - self._judged) > 0 and (last or rest >= frame + ahead):
            end = count if last and rest < frame + ahead else self._judged + frame
            self._frame(end, min(end + ahead, count))
            new = True
        if new:
            self._compound()

    def _frame(self, end: int, seen_until: int) -> None:
        """Judge the samples until `end`, with those until `seen_until` known."""
        done = self._judged
        first = self._behind()
        part = self._raw.rows[first:seen_until]
        stamp = part[:, 0]
        if (jump := float(np.diff(stamp).max(initial=0.0))) > LONGEST_S:
            raise InputError(f"add_imu: time jumps by {jump:.6g} s: begin another stream after it")
        imu = Imu(stamp, np.diff(stamp, prepend=stamp[0] - self._usual), part[:, 1:4], part[:, 4:7])
        clock = sample_clock(stamp, self._step or None)
        if clock.even:
            self._step = clock.step
        known = part[:, 7:9] > 0  # what lies ahead is judged again
        for fault in screened(imu, clock.step, np.zeros(len(stamp), bool), causal=True):
            known[done - first :, fault.sensor] &= ~fault.mask[done - first :]
        filled = bridged(imu, clock, known)
        self._keep(filled, clock, done - first, end - first)
        self._raw.rows[done:end, 7:9] = known[done - first : end - first]
        self._judged = end

    def _behind(self) -> int:
        """The first sample of a window with enough measured samples before the next frame.

        Usually `BEHIND`; after a longer loss `REMEMBERED_S`, in which the vehicle has shown more of
        what it may have done meanwhile.
        """
        done = self._judged
        lately = self._raw.rows[max(done - BEHIND, 0) : done]
        lost = not lately[:, 7:9].all() or np.diff(lately[:, 0]).max(initial=0) > LOST_S
        needed = max(BEHIND, round(REMEMBERED_S / self._usual)) if lost else BEHIND
        for back in (needed, 4 * needed, done):
            first = max(done - back, 0)
            measured = np.flatnonzero(self._raw.rows[first:done, 7:9].all(axis=1))
            if len(measured) >= needed or first == 0:
                break
        return first + int(measured[-needed]) if len(measured) > needed else first

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
