"""The rover's graph: nodes at 1 Hz tied by the wheels and levelled by the accelerometer.

No gyro is needed; where gyros are present the inertial factors join in and take the place of the
quasi-static level.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from factors import wheel_velocity as wv
from factors.block import Block
from factors.calibration import Component, Layout
from factors.calibration import prior as calibration_prior
from factors.heading import heading
from factors.inertial import Field, inertial
from factors.position import Fixes, position
from factors.preintegration import Increments, InertialNoise, preintegrate
from factors.start import Start, start
from graphnav.common.angles import rotation_of_angles
from graphnav.common.earth import G_STANDARD, Origin
from graphnav.common.errors import InputError
from graphnav.common.run import Array, Run
from graphnav.graph.calibrations import gnss_components
from graphnav.graph.elimination import Chain
from graphnav.graph.estimate import Estimate
from graphnav.graph.nodes import Nodes, nearest_node, place_nodes
from graphnav.inertial.increments import increments
from graphnav.reading.vehicle import Vehicle
from graphnav.rover import running_gear as rover
from graphnav.rover import terrain as rover_terrain

Factor = Callable[[Estimate], list[Block]]

K_BOUNDS = 0.7, 1.02  # slip coefficients beyond are held back (C6's clip, softened)
K_SD, K_LENGTH = 0.06, 20.0  # how the ground's slip varies, and over how many metres
BOUND_SD = 0.01
TOE_SD, SIDE_SD, SIDE_LENGTH = 0.02, 0.02, 10.0  # rad/m; m/m; m
YAW_LOOSE = 3.0  # the yaw slip's spread before it is measured, of what the wheels' fit says
YAW_LENGTH = 1.0  # m over which wheels keep slipping unlike each other
STEP_FLOOR, STEP_SHARE = 0.001, 0.03  # m; of the way
YAW_FLOOR, YAW_SHARE = 3e-4, 0.3  # rad; of the wheels' own yaw uncertainty
TILT_FLOOR, TILT_SHARE = 1e-3, 0.5  # rad; rad per m
LOOSE_POSITION = 300.0  # m, of the first fix
FIX_REACH_S, FIX_SD = 0.6, 0.05  # a fix further from every node is left out; m, best believed
UNLEVEL_SD = 0.1  # rad, of the ground, where no accelerometer tells
UNHEARD_SPEED, UNHEARD_RATE = 0.2, 0.1  # m/s, rad/s: what may happen unheard
SPEED_SD, SPEED_SHARE = 0.01, 0.1  # m/s; of the speed


@dataclass(frozen=True)
class RoverProblem:
    """All that is known before solving."""

    run: Run
    origin: Origin
    wheels: rover.Wheels
    sums: wv.WheelSums
    nodes: Nodes
    layout: Layout
    wandering: tuple[wv.Wandering, ...]
    start: Start
    inc: Increments | None  # with gyros
    noise: InertialNoise | None

    @property
    def chain(self) -> Chain:
        """Elimination order for the solver."""
        n = self.nodes
        return Chain(len(n.time), len(n.segment_time), self.layout.dim, n.segment)


def prepare(run: Run, vehicle: Vehicle) -> RoverProblem:
    """Wheels, nodes, calibration layout and start; InputError says what is missing."""
    if run.rover is None:
        raise InputError(f"{run.path}: a rover needs wheel_1 .. wheel_6 and steer_1 .. steer_6")
    linkage = rover.linkage_of(vehicle.rover, str(run.path))
    wheels = rover.wheels_of(run.rover, linkage, vehicle.odometer.lever_b)
    inc = increments(run.imu) if run.imu is not None else None
    edges = wheels.time if inc is None else inc.edge
    nodes = place_nodes(edges, np.zeros(0), np.zeros(0), np.zeros((0, 2)))
    origin = _origin(run, vehicle)
    spec = vehicle.imu
    layout, wandering = calibrations(
        spec.gyro_bias_deg_h if inc else None, spec.accel_bias_mg, wheels
    )
    noise = InertialNoise(
        np.deg2rad(spec.gyro_noise_deg_sqrt_h) / 60,
        spec.accel_noise_mg_sqrt_hz * 1e-3 * G_STANDARD,
    )
    sums = rover.sums_between(wheels, nodes.time)
    known = _start(run, vehicle, wheels, nodes, origin)
    layout = Layout((*layout.components, *gnss_components(vehicle, run.gnss)))
    return RoverProblem(run, origin, wheels, sums, nodes, layout, wandering, known, inc, noise)


def _origin(run: Run, vehicle: Vehicle) -> Origin:
    """The frame's origin: the stated start, else the first fixes."""
    at, gnss = vehicle.start, run.gnss
    if at.lat is not None and at.lon is not None:
        return Origin(np.deg2rad(at.lat), np.deg2rad(at.lon), at.height or 0.0)
    if gnss is None:
        raise InputError(f"{run.path}: no start: give [start] lat, lon, height in the vehicle file")
    few = [float(np.median(x[:10])) for x in (gnss.lat_deg, gnss.lon_deg, gnss.height)]
    return Origin(np.deg2rad(few[0]), np.deg2rad(few[1]), few[2])


def fixes_n(run: Run, origin: Origin) -> Array:
    """All fixes of the run in n, (F, 3) m."""
    if run.gnss is None:
        return np.zeros((0, 3))
    g = run.gnss
    return origin.local(np.deg2rad(g.lat_deg), np.deg2rad(g.lon_deg), g.height)


def calibrations(
    gyro_deg_h: float | None, accel_mg: float, wheels: rover.Wheels
) -> tuple[Layout, tuple[wv.Wandering, ...]]:
    """Biases of what is fitted, and the ground: slip, side slip, toe, yaw slip."""
    gyro, accel = np.deg2rad(gyro_deg_h or 0.0) / 3600, accel_mg * 1e-3 * G_STANDARD
    biases = [Component("accel_bias", np.zeros(3), np.full(3, accel), 0.003 * accel)]
    if gyro_deg_h is not None:
        biases.insert(0, Component("gyro_bias", np.zeros(3), np.full(3, gyro), 0.003 * gyro))
    moving = wheels.motion.speed > 0.01
    stray = wheels.motion.w_z_sd[moving] / wheels.motion.speed[moving]
    yaw_sd = YAW_LOOSE * float(np.median(stray)) if moving.any() else 0.02
    wandering = (
        wv.Wandering(_one("slip_coefficient", rover.K_GUESS, K_SD), K_LENGTH),
        wv.Wandering(_one("side_slip", 0.0, SIDE_SD), SIDE_LENGTH),
        wv.Wandering(_one("yaw_slip", 0.0, yaw_sd), YAW_LENGTH),
    )
    toe = _one("toe", 0.0, TOE_SD)
    return Layout((*biases, toe, *(w.component for w in wandering))), wandering


def _one(name: str, prior: float, sd: float) -> Component:
    return Component(name, np.array([prior]), np.array([sd]))


def _start(run: Run, vehicle: Vehicle, wheels: rover.Wheels, nodes: Nodes, origin: Origin) -> Start:
    """Stated heading, else the first the sensor sees carried back by the wheels."""
    at = vehicle.start
    if at.heading_deg is not None:
        value, sd = np.deg2rad(at.heading_deg), np.deg2rad(at.heading_sd_deg)
    elif run.heading is not None:
        seen = run.heading
        yaw = np.interp([nodes.time[0], seen.time[0]], wheels.time, wheels.yaw)
        value, sd = seen.heading[0] + rover.K_GUESS * (yaw[1] - yaw[0]), np.deg2rad(90.0)
    else:
        raise InputError(
            f"{run.path}: the heading at the start is unknown: give [start] heading_deg, "
            "or a heading_deg column"
        )
    tilt = np.deg2rad(30.0)
    stated = at.has_position
    p_n = np.zeros(3) if stated else fixes_n(run, origin)[0]
    p_sd = at.position_sd_m if stated else LOOSE_POSITION
    sds = np.array([tilt, tilt, sd, 1.0, 1.0, 1.0, p_sd, p_sd, p_sd])
    R = rotation_of_angles(*np.array([0.0, 0.0, float(value)]))
    return Start(R, np.zeros(3), p_n, sds)


def build(problem: RoverProblem, at: Estimate, found: list[rover_terrain.Track]) -> list[Factor]:
    """Every factor as a function of the estimate."""
    factors = [_constraints(problem), _wheels(problem)]
    factors.append(_level(problem) if problem.inc is None else _inertial(problem, at))
    if problem.run.heading is not None:
        factors.append(_heading(problem))
    if problem.run.gnss is not None:
        factors.append(_gnss(problem))
    layout = problem.layout
    factors.append(lambda x: rover_terrain.blocks(found, x.calibration, layout))
    return factors


def _constraints(problem: RoverProblem) -> Factor:
    """Start, calibrations and what keeps them in place."""
    nodes, layout = problem.nodes, problem.layout
    path = np.interp(nodes.segment_time, problem.wheels.time, problem.wheels.path)
    t = float(nodes.time[0])

    def factor(x: Estimate) -> list[Block]:
        c = x.calibration
        return [
            start(problem.start, x.R_nb[0], x.v_n[0], x.p_n[0], t),
            calibration_prior(layout, c),
            *wv.wander(layout, problem.wandering, c, path, nodes.segment_time),
            wv.bounds(layout, "slip_coefficient", *K_BOUNDS, BOUND_SD, c, nodes.segment_time),
            wv.unused_phase(x.phase, nodes.time),
        ]

    return factor


def _wheels(problem: RoverProblem) -> Factor:
    """Displacement, yaw and velocity from the running gear."""
    nodes, layout, wheels, sums = problem.nodes, problem.layout, problem.wheels, problem.sums
    seg, time = nodes.segment, nodes.time
    T = np.diff(time)
    unheard = (1 - rover.heard_share(wheels, time)).clip(0) * T
    step = np.hypot(STEP_FLOOR + STEP_SHARE * sums.path, UNHEARD_SPEED * unheard)
    yaw_sd = problem.layout.prior_sd[layout.column("yaw_slip")]
    yaw = np.hypot(YAW_FLOOR + YAW_SHARE * yaw_sd * sums.path, UNHEARD_RATE * unheard)
    u_b = rover.origin_velocity(wheels, time)
    speed = SPEED_SD + SPEED_SHARE * np.linalg.norm(u_b, axis=1)
    at_node = np.append(seg, seg[-1])

    def factor(x: Estimate) -> list[Block]:
        turn, c = wv.interval(x.R_nb), x.calibration
        return [
            wv.wheel_displacement(
                sums, turn, x.R_nb, x.p_n, c, layout, seg, np.repeat(step[:, None], 3, 1), time
            ),
            wv.wheel_yaw(sums, turn, c, layout, seg, yaw, time),
            wv.wheel_speed(u_b, x.R_nb, x.v_n, c, layout, at_node, speed, time),
        ]

    return factor


def _level(problem: RoverProblem) -> Factor:
    """Gyro-free attitude: quasi-static level and a ground whose slope changes little.

    Nodes without an accelerometer sample are taken to be level, loosely.
    """
    nodes, layout = problem.nodes, problem.layout
    n, c_of = len(nodes.time), np.append(nodes.segment, nodes.segment[-1])
    slope_sd = TILT_FLOOR + TILT_SHARE * problem.sums.path
    g_n = problem.origin.gravity(np.zeros(3))
    force, sigma = np.tile(-g_n, (n, 1)), np.full(n, UNLEVEL_SD * float(np.linalg.norm(g_n)))
    source = problem.run.accelerometer
    if source is not None:
        means = rover.levelling(source, nodes.time)
        known = np.isfinite(means.force_b[:, 0])
        force[known], sigma[known] = means.force_b[known], means.sigma[known]
    every = np.arange(n)

    def factor(x: Estimate) -> list[Block]:
        args = (force, every, x.R_nb, g_n, x.calibration, layout, c_of, sigma, nodes.time)
        return [wv.tilt(wv.interval(x.R_nb), slope_sd, nodes.time), wv.level(*args)]

    return factor


def _inertial(problem: RoverProblem, at: Estimate) -> Factor:
    """With gyros: inertial factors as for any vehicle."""
    assert problem.inc is not None and problem.noise is not None
    nodes, origin = problem.nodes, problem.origin
    pre = preintegrate(problem.inc, nodes.edge, at.calibration[nodes.segment, :6], problem.noise)

    def factor(x: Estimate) -> list[Block]:
        g = origin.gravity(0.5 * (x.p_n[:-1] + x.p_n[1:]))
        field = Field(origin.Omega_n, g, origin.gravity_gradient)
        bias = x.calibration[nodes.segment, :6]
        args = (pre, x.R_nb, x.v_n, x.p_n, bias, field, nodes.time, nodes.segment)
        return [inertial(*args, problem.layout.dim)]

    return factor


def _heading(problem: RoverProblem) -> Factor:
    """The sun sensor, carried to the nearest node by the wheels' yaw."""
    seen = problem.run.heading
    assert seen is not None
    wheels, nodes = problem.wheels, problem.nodes
    node, _ = nearest_node(nodes, seen.time)
    turned = np.interp(seen.time, wheels.time, wheels.yaw) - np.interp(
        nodes.time[node], wheels.time, wheels.yaw
    )
    value = seen.heading + rover.K_GUESS * turned
    sigma = np.full(len(value), rover.heading_sd(seen, wheels))
    return lambda x: [heading(value, sigma, node, x.R_nb, seen.time)]


def _gnss(problem: RoverProblem) -> Factor:
    """Position fixes, each at its nearest node."""
    gnss = problem.run.gnss
    assert gnss is not None
    nodes = problem.nodes
    node, dt = nearest_node(nodes, gnss.time)
    on = np.flatnonzero(np.abs(dt) < FIX_REACH_S)
    sigma = np.maximum(gnss.sd_enu[on], FIX_SD)
    segment = nodes.segment[np.minimum(node[on], len(nodes.segment) - 1)]
    p_n = fixes_n(problem.run, problem.origin)[on]
    fixes = Fixes(p_n, sigma, dt[on], node[on], segment, gnss.time[on])
    antenna, offset = problem.layout.column("antenna"), problem.layout.column("gnss_offset")
    return lambda x: [position(fixes, antenna, offset, x.R_nb, x.v_n, x.p_n, x.calibration)]
