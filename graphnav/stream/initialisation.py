"""When a stream has seen enough to align, and with what."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from graphnav.common.angles import wrapped
from graphnav.common.errors import InputError
from graphnav.common.run import Run
from graphnav.graph import calibrations
from graphnav.graph.preparation import (
    Setup,
    inertial_noise,
    initial_standstill_end,
    params,
    punctual,
    two_sided,
    weight_at_standstill,
)
from graphnav.inertial.alignment import Alignment, align
from graphnav.inertial.levelling import LEVELLING_S
from graphnav.reading.vehicle import Vehicle
from graphnav.recognition.corrections import Correction, correction_table
from graphnav.stream.aiding import Aiding, usual_fix
from graphnav.stream.sensors import Sensors

LONGEST_STANDSTILL_S = 120.0  # of an initial standstill that is waited for before aligning
GROWTH = 1.2  # of the run between looks at whether its heading still holds
CONFIRMED_SD, CONFIRMING = np.deg2rad(3.0), 20  # of a path's heading; slots it rests on
APART = np.deg2rad(10.0)  # a heading so far off begins anew, a lesser error the graph mends
FEW_FIXES, FIXES_WITHIN_S = 10, 30.0  # fixes that make the origin, waited for so long


class Initialisation:
    """Tries the batch's alignment second by second of the recording until it succeeds."""

    def __init__(
        self,
        vehicle: Vehicle,
        table: dict[str, Correction] | None,
        sensors: Sensors,
        aiding: Aiding,
        expects_fixes: bool,
        interval: float,
    ) -> None:
        self._vehicle, self._table, self._interval = vehicle, table, interval
        self._sensors, self._aiding = sensors, aiding
        self._expects_fixes = expects_fixes
        self._looked = 0.0  # s, until when it was tried
        self.why: InputError | None = None  # it was not possible
        self.aligned = 0.0  # s, when it was
        self._confirmed = False  # by a path held against the fixes

    def attempt(self, ready: int, last: bool = False) -> Setup | None:
        """The alignment with all that goes with it, once possible with the judged increments.

        `last`: there will be no more, nothing is waited for.
        """
        edge = self._sensors.inertial.edge.rows
        while ready and edge[ready] - edge[0] >= self._looked + 1.0:
            self._looked += 1.0
            until = int(np.searchsorted(edge, edge[0] + self._looked - 1e-9))
            found = self._tried(until, waits=True)
            if found is not None:
                return found
        return self._tried(ready, waits=False) if last and ready else None

    def contradicted(self, held: Alignment, ready: int) -> Setup | None:
        """Another alignment, once the fixes that came since speak against the one in use.

        Looked for each time the run has grown by `GROWTH`, until a path confirms the heading.
        """
        edge = self._sensors.inertial.edge.rows
        now = float(edge[ready] - edge[0])
        if self._confirmed or now < GROWTH * self._looked:
            return None
        self._looked = now
        setup = self._tried(ready, waits=False)
        if setup is None or setup.alignment.path is None:
            return None
        path = setup.alignment.path
        self._confirmed = path.sd < CONFIRMED_SD and len(path.time) >= CONFIRMING
        off = wrapped(setup.alignment.heading - held.heading)
        limit = max(APART, 3 * setup.alignment.heading_sd)
        return setup if abs(off) > limit else None

    def _tried(self, until: int, waits: bool) -> Setup | None:
        """The alignment with the first `until` increments, unless more is worth waiting for."""
        edge = self._sensors.inertial.edge.rows
        run = self._so_far(float(edge[until]))
        inc = self._sensors.inertial.between(0, until)
        standstill_until = initial_standstill_end(self._sensors.standstill.spans(edge, until), inc)
        if waits and self._waits(run, standstill_until, until):
            return None
        try:
            gnss, delay = punctual(run.gnss, self._vehicle, inc, run.odometer)
            run = replace(run, gnss=gnss)
            alignment = align(run, self._vehicle, inc, standstill_until)
            held = self._sensors.standstill.held.rows[:until] > 0
            weight = weight_at_standstill(inc, held, alignment.origin)
            setup = self._setup(run, alignment, delay, weight)
        except InputError as error:
            self.why = error
            return None
        self.aligned = run.end
        return setup

    def _waits(self, run: Run, standstill_until: float, until: int) -> bool:
        """Whether more is worth waiting for: the end of a standstill, levelling, more fixes."""
        if (
            self._sensors.standstill.held.rows[until - 1]
            and standstill_until == self._sensors.inertial.edge.rows[until]
        ):
            return self._looked < LONGEST_STANDSTILL_S
        few = run.gnss is not None and len(run.gnss.time) < FEW_FIXES
        if few and self._looked < FIXES_WITHIN_S:
            return True
        return standstill_until == 0 and self._looked < LEVELLING_S

    def _so_far(self, until: float) -> Run:
        """What came until a time, as a run."""
        gnss, heading = self._aiding.until(until)
        return Run(
            path=Path("stream"),
            clock_start=0.0,
            end=until,
            imu=None,
            odometer=self._sensors.odometer.around(0.0, until),
            sides=self._sensors.sides.around(0.0, until),
            gnss=gnss,
            heading=heading,
            rover=None,
        )

    def _setup(self, run: Run, alignment: Alignment, delay: float, weight: float) -> Setup:
        """What holds for the whole stream."""
        gnss, vehicle = run.gnss, self._vehicle
        both = two_sided(run, vehicle)
        table = self._table or correction_table(params(vehicle, both))
        if gnss is None and self._expects_fixes:
            gnss = usual_fix(vehicle.gnss.sd)
        bias = alignment.gyro_bias
        layout = calibrations.layout(vehicle, table, gnss, both, bias, delay, weight)
        noise = inertial_noise(vehicle)
        interval = self._interval
        return Setup(vehicle, noise, alignment, table, layout, both, interval, delay)
