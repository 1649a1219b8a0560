"""Sensors in, one by one or in pieces; out comes where the vehicle is, as known at that moment."""

from dataclasses import replace
from pathlib import Path
from time import perf_counter

import numpy as np
from numpy.typing import ArrayLike

from factors.calibration import TRACK_WIDTH
from factors.preintegration import Increments
from graphnav.common.errors import InputError
from graphnav.common.run import Array
from graphnav.graph.nodes import INTERVAL_S, next_node, room_of
from graphnav.graph.preparation import Setup, gyro_bias_sd
from graphnav.reading.counter import FASTEST
from graphnav.reading.vehicle import Vehicle
from graphnav.recognition.corrections import Correction
from graphnav.stream.aiding import Aiding
from graphnav.stream.causal_estimate import CausalEstimate
from graphnav.stream.causal_standstill import CausalStandstill
from graphnav.stream.causal_states import CausalStates
from graphnav.stream.incremental_graph import IncrementalGraph
from graphnav.stream.initialisation import Initialisation
from graphnav.stream.intake import LOOK_AHEAD_S, sound
from graphnav.stream.node_log import NodeLog
from graphnav.stream.rocking import Rocking
from graphnav.stream.sensors import Sensors


class Smoother:
    """The incremental smoother as a stream: what a vehicle would know as it drives.

    Sensors come in SI and in the axes of the vehicle file, single samples or arrays, each sensor in
    order of time; the IMU last, because it drives the clock: what other sensors saw until a time
    must be there before the IMU's samples of half a second later. Every second, and at fixes and
    standstills, a node enters the graph; an estimate rests on what was recorded until half a second
    after it (`LOOK_AHEAD_S`). It begins when the heading can be known: after levelling when the
    vehicle file states it, else when the gyros or the satellite course have found it.

        from graphnav import Smoother

        smoother = Smoother("vehicle.toml")
        while recording:
            smoother.add_odometer(odo_time, pulses=count)
            smoother.add_gnss(fix_time, lat_deg, lon_deg, height, sd_enu=(2.0, 2.0, 4.0))
            smoother.add_imu(imu_time, gyro, accel)  # (n,), (n, 3) rad/s, (n, 3) m/s^2
            known = smoother.estimate()
            if known is not None:
                lat, lon, height = known.geodetic  # rad, rad, m
                print(known.time, lat, lon, known.heading_deg, known.sd_enu)
        smoother.finish()
        for known in smoother.history:  # every node, as it was known then
            print(known.time, known.p_n, 1e3 * known.latency)

    Each time the run has doubled all of it is linearised anew, with the noise its own residuals
    show. With `lag` s the history holds every node as known `lag` s later, and nothing older is
    ever linearised again, nor is noise learnt. Not handled: fixes older than the newest node,
    rovers, nodes at changes of motion state (the batch has them).
    """

    def __init__(
        self,
        vehicle: Vehicle | str | Path,
        *,
        lag: float | None = None,
        table: dict[str, Correction] | None = None,
        fixes: bool = True,
        interval: float = INTERVAL_S,
        clock: float | None = None,
    ) -> None:
        """`vehicle` a vehicle file or its content; `table` in place of its correction table;
        `fixes` whether there will be any: False spares their calibrations; `interval` s between
        nodes; `clock` the sensors' clock at the stream's time 0, the first sample's when not given.
        """
        if not isinstance(vehicle, Vehicle):
            from graphnav.reading.vehicle_file import load_vehicle

            vehicle = load_vehicle(Path(vehicle), Path(vehicle))
        self.vehicle = vehicle
        self._lag = lag
        self._expects = fixes and vehicle.gnss.use
        self._interval = interval
        self._clock = clock  # at time 0
        self._heard = Sensors(CausalStandstill(gyro_bias_sd(vehicle)))
        self._aiding = Aiding(self._expects)
        self.graph: IncrementalGraph | None = None
        self._initialisation = Initialisation(
            vehicle, table, self._heard, self._aiding, self._expects, interval
        )
        self._states = CausalStates(vehicle)
        self.history: list[CausalEstimate] = []
        self._newest: CausalEstimate | None = None
        self._aligned = 0.0  # s, when the alignment was done
        self._left = 0  # node that leaves the lag next
        self._newest_of: dict[str, float] = {}  # sample, s, by sensor
        self._rocking = Rocking()

    def add_imu(self, time: ArrayLike, gyro: ArrayLike, accel: ArrayLike) -> None:
        """Samples: time of the end of each interval (n,) s, mean rate and specific force (n, 3)."""
        due = perf_counter()
        t, w, f = self._sound("add_imu", time, np.atleast_2d(gyro), np.atleast_2d(accel))
        axes = self.vehicle.imu.axes_matrix
        self._heard.inertial.add(t, w @ axes.T, f @ axes.T)
        self._advance(self._judgeable(), due)

    def add_odometer(
        self, time: ArrayLike, *, speed: ArrayLike | None = None, pulses: ArrayLike | None = None
    ) -> None:
        """Speeds (n,) m/s or readings of the pulse counter (n,)."""
        if (speed is None) == (pulses is None):
            raise InputError("add_odometer: give either speed [m/s] or pulses")
        counts = pulses is not None
        per_pulse = self.vehicle.odometer.metres_per_pulse
        if counts and per_pulse is None:
            raise InputError("add_odometer: pulses need [odometer] metres_per_pulse [m]")
        if len(self._heard.odometer) and counts != (self._heard.odometer.pulse > 0):
            raise InputError("add_odometer: give speeds or pulses, the same all the way")
        t, values = self._sound("add_odometer", time, pulses if counts else speed)
        if counts:
            self._heard.odometer.pulse = per_pulse or 0.0
            self._heard.odometer.add_pulses(t, values, FASTEST)
        else:
            self._heard.odometer.add_speed(t, values)

    def add_sides(self, time: ArrayLike, left: ArrayLike, right: ArrayLike) -> None:
        """Speeds of both sides (n,) m/s, for the turn they tell; their mean is no odometer yet."""
        t, *both = self._sound("add_sides", time, left, right)
        layout = None if self.graph is None else self.graph.log.setup.layout
        turns = self.vehicle.kind == "tracked" and len(t) > 0
        if turns and layout is not None and TRACK_WIDTH not in layout.slices:
            raise InputError("add_sides: give both sides from the start, before the alignment")
        self._heard.sides.add(t, *both)

    def add_gnss(
        self,
        time: ArrayLike,
        lat_deg: ArrayLike,
        lon_deg: ArrayLike,
        height: ArrayLike,
        sd_enu: ArrayLike | None = None,
    ) -> None:
        """Fixes: degrees, ellipsoidal height m, one sigma (n, 3) m or the vehicle file's."""
        sd = self.vehicle.gnss.sd if sd_enu is None else np.asarray(sd_enu, np.float64)
        each = np.broadcast_to(sd, (np.size(time), 3))
        t, lat, lon, up, each = self._sound("add_gnss", time, lat_deg, lon_deg, height, each)
        self._aiding.add_fixes(t, np.column_stack([lat, lon, up]), each)

    def add_heading(self, time: ArrayLike, heading_deg: ArrayLike) -> None:
        """External heading (n,), degrees clockwise from north."""
        t, degrees = self._sound("add_heading", time, heading_deg)
        self._aiding.add_headings(t, np.deg2rad(degrees))

    @property
    def increments(self) -> Increments:
        """All increments so far."""
        return self._heard.inertial.between(0, len(self._heard.inertial))

    def estimate(self) -> CausalEstimate | None:
        """The newest node, or None before the alignment."""
        return self._newest

    def finish(self) -> None:
        """No more samples will come: use those that waited, and linearise all once more.

        Raises InputError when the heading never became known.
        """
        self._heard.inertial.finish()
        if len(self._heard.inertial):
            self._advance(len(self._heard.inertial), perf_counter(), last=True)
        if self.graph is None:
            raise self._initialisation.why or InputError("no inertial samples, or too few to align")
        edge = self._heard.inertial.edge.rows
        if edge[-1] - self.graph.log.time.rows[-1] > room_of(self._interval):
            self._nodes([len(edge) - 1], perf_counter())
        if self._lag is None:
            self.graph.settle()
        else:
            self.history += self._leaving(np.inf)

    def _sound(self, sensor: str, time: ArrayLike, *values: ArrayLike | None) -> list[Array]:
        """Seconds since the start and values of the samples that hold numbers, in order of time."""
        t, *columns = sound(sensor, time, values)
        if self._clock is None and len(t):
            self._clock = float(t[0])
        t = t - (self._clock or 0.0)
        before = np.append(self._newest_of.get(sensor, -np.inf), t)
        late = np.flatnonzero(np.diff(before) <= 0)
        if len(late):
            a, b = before[late[0] : late[0] + 2] + (self._clock or 0.0)
            raise InputError(f"{sensor}: time {b:.15g} after {a:.15g}: give samples in order, once")
        self._newest_of[sensor] = float(before[-1])
        return [t, *columns]

    def _judgeable(self) -> int:
        """Increments whose look-ahead is complete."""
        if not len(self._heard.inertial):
            return 0
        edge = self._heard.inertial.edge.rows
        return max(int(np.searchsorted(edge, edge[-1] - LOOK_AHEAD_S + 1e-9)) - 1, 0)

    def _advance(self, ready: int, due: float, last: bool = False) -> None:
        """Align when that is possible, then every node that is due (since `due`)."""
        end = 0
        while end < ready:
            # what is aligned helps to judge where it stands: frame by frame until then
            end = ready if self.graph is not None else self._heard.standstill.next_frame(ready)
            self._judge(end)
            if self.graph is None:
                self._begin(end, last and end == ready)
            elif self._expects:
                self._begin_again(end)
        if self.graph is None:
            return
        while True:
            edges = self._due()
            if not edges:
                return
            self._nodes(edges, due)
            due = perf_counter()

    def _judge(self, ready: int) -> None:
        """Where the vehicle stands, until the edge `ready`."""
        heard = self._heard
        gear = heard.inertial, heard.odometer, heard.sides
        heard.standstill.advance(*gear, self._aiding.between, ready)

    def _due(self) -> list[int]:
        """Edges of the next nodes that can be placed, up to where the graph pauses for a sweep.

        A node at a stop of the running gear enters alone: what the stop shows counts from then on.
        """
        assert self.graph is not None
        graph, gear_stopped = self.graph, self._heard.standstill.gear_stopped.rows
        last, count = int(graph.log.edge.rows[-1]), graph.last
        aids = self._aiding.stops(float(self._heard.inertial.edge.rows[last]))
        by, places = self._heard.schedule(last, aids, self._interval), list[int]()
        while not places or (count % graph.every and not gear_stopped[last - 1]):
            place = next_node(last, by)
            if place is None or (places and gear_stopped[place - 1]):
                break
            places.append(place)
            last, count = place, count + 1
        return places

    def _begin(self, ready: int, last: bool) -> None:
        """Start the graph when the alignment is done."""
        setup = self._initialisation.attempt(ready, last)
        if setup is not None:
            self._started(setup)

    def _begin_again(self, ready: int) -> None:
        """Build the graph anew where fixes have shown that it began in a wrong direction."""
        assert self.graph is not None
        setup = self._initialisation.contradicted(self.graph.log.setup.alignment, ready)
        if setup is not None:
            self._aiding.rewind()
            self._states = CausalStates(self.vehicle)
            self._started(setup)

    def _started(self, setup: Setup) -> None:
        self._aligned = self._initialisation.aligned
        self._heard.standstill.reckoned.align(setup)
        log = NodeLog(setup, self._heard, self._aiding)
        self.graph = IncrementalGraph(log, self._lag, self._states.every_s)

    def _nodes(self, edges: list[int], due: float) -> None:
        """More nodes, and what is known with each."""
        graph = self.graph
        assert graph is not None
        times = self._heard.inertial.edge.rows[edges]
        graph.log.rocking = self._rocking.until(edges[0], self._heard, graph.log.setup.noise)
        window = graph.window()
        self._states.follow(graph, window)
        entered = graph.grow(edges, self._states.now, window)
        found = list[tuple[CausalEstimate, list[CausalEstimate]]]()
        for node, t in zip(entered, times, strict=True):
            newest = self._known(node)
            found.append((newest, [newest] if self._lag is None else self._leaving(float(t))))
        latency = (perf_counter() - due) / len(edges)  # they are linearised together
        for (newest, leaving), t in zip(found, times, strict=True):
            if t >= self._aligned - 1.0:  # before, the vehicle did not know yet: made up for
                self._newest = replace(newest, latency=latency)
                self.history += [replace(k, latency=latency) for k in leaving]

    def _known(self, node: int, past: bool = False) -> CausalEstimate:
        graph = self.graph
        assert graph is not None
        time = float(graph.log.time.rows[node]) + (self._clock or 0.0)
        state = graph.past(node) if past else graph.newest(node)
        return CausalEstimate(time, *state, graph.origin, 0.0)

    def _leaving(self, now: float) -> list[CausalEstimate]:
        """The nodes that are `lag` old by now, as they are known now."""
        assert self.graph is not None and self._lag is not None
        times, first = self.graph.log.time.rows, self._left
        self._left = max(int(np.searchsorted(times, now - self._lag, side="right")), first)
        return [self._known(node, past=True) for node in range(first, self._left)]
