"""The rover's graph: nodes at 1 Hz tied by the wheels and levelled by the accelerometer.

No gyro is needed; where gyros are present the inertial factors join in and take the place of the
quasi-static level.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from factors import rover_wheels as rw
from factors.block import Block
from factors.calibration import (
    SIDE_SLIP,
    SLIP_COEFFICIENT,
    TOE,
    YAW_SLIP,
    Component,
    Layout,
)
from factors.calibration import prior as calibration_prior
from factors.estimate import Estimate
from factors.heading import Bearing, heading
from factors.initial_state import InitialState, initial_state
from factors.level import level
from factors.preintegration import Increments, InertialNoise, preintegrate
from factors.terrain_slip import WheelTrack, terrain_slip
from graphnav.common.angles import rotation_of_angles
from graphnav.common.earth import Origin
from graphnav.common.errors import InputError
from graphnav.common.run import Gnss, Run
from graphnav.graph.calibrations import bias_components, gnss_components
from graphnav.graph.elimination import EliminationOrder
from graphnav.graph.nodes import Nodes, near_fixes, nearest_node, place_nodes
from graphnav.graph.preparation import fixes_in, inertial_noise
from graphnav.graph.problem import inertial_factor
from graphnav.graph.satellite_fixes import fixes_on_smooth_path
from graphnav.inertial.alignment import first_position, frame_origin
from graphnav.inertial.increments import increments
from graphnav.reading.vehicle import Vehicle
from graphnav.rover import running_gear as rover

Factor = Callable[[Estimate], list[Block]]

K_SD, K_LENGTH = 0.06, 20.0  # how the ground's slip varies, and over how many metres
SLIP_BOUNDS = rw.Bounds(SLIP_COEFFICIENT, 0.7, 1.02, sigma=0.01)  # C6's clip, softened
TOE_SD, SIDE_SD, SIDE_LENGTH = 0.02, 0.02, 10.0  # rad/m; m/m; m
YAW_LOOSE = 3.0  # the yaw slip's spread before it is measured, of what the wheels' fit says
YAW_LENGTH = 1.0  # m over which wheels keep slipping unlike each other
# errors of the wheels, white: all per sqrt(s)
STEP_FLOOR, STEP_SHARE = 0.001, 0.03  # m; of the speed
YAW_FLOOR, YAW_SHARE = 3e-4, 0.3  # rad; of the yaw slip's spread times the speed
TILT_FLOOR, TILT_SHARE = 1e-3, 0.5  # rad; rad/m of the speed
UNLEVEL_SD = 0.1  # rad, of the ground, where no accelerometer tells
UNHEARD_SPEED, UNHEARD_RATE = 0.2, 0.1  # m/s, rad/s: what may happen unheard
SPEED_SD, SPEED_SHARE = 0.01, 0.1  # m/s; of the speed


@dataclass(frozen=True)
class RoverProblem:
    """All that is known before solving."""

    run: Run
    origin: Origin
    wheels: rover.Wheels
    sums: rw.WheelSums
    nodes: Nodes
    layout: Layout
    wandering: tuple[rw.Wandering, ...]
    start: InitialState
    inc: Increments | None  # with gyros
    noise: InertialNoise | None

    @property
    def order(self) -> EliminationOrder:
        """Elimination order for the solver."""
        n = self.nodes
        return EliminationOrder(len(n.time), len(n.segment_time), self.layout.dim, n.segment)


def prepare(run: Run, vehicle: Vehicle) -> RoverProblem:
    """Wheels, nodes, calibration layout and start; InputError says what is missing."""
    if run.rover is None:
        raise InputError(f"{run.path}: a rover needs wheel_1 .. wheel_6 and steer_1 .. steer_6")
    linkage = rover.linkage_of(vehicle.rover, str(run.path))
    wheels = rover.wheels_of(run.rover, linkage, vehicle.odometer.lever_b, str(run.path))
    inc = increments(run.imu) if run.imu is not None else None
    edges = wheels.time if inc is None else inc.edge
    fixes = () if run.gnss is None else (run.gnss.time,)
    nodes = place_nodes(edges, np.zeros(0), near_fixes(*fixes), np.zeros((0, 2)))
    origin = frame_origin(run, vehicle)
    layout, wandering = calibrations(vehicle, run.gnss, wheels, gyro=inc is not None)
    return RoverProblem(
        run=run,
        origin=origin,
        wheels=wheels,
        sums=rover.sums_between(wheels, nodes.time),
        nodes=nodes,
        layout=layout,
        wandering=wandering,
        start=_start(run, vehicle, wheels, nodes, origin),
        inc=inc,
        noise=inertial_noise(vehicle),
    )


def calibrations(
    vehicle: Vehicle, gnss: Gnss | None, wheels: rover.Wheels, gyro: bool
) -> tuple[Layout, tuple[rw.Wandering, ...]]:
    """Biases of what is fitted, the ground (slip, side slip, toe, yaw slip) and the antenna."""
    gyro_bias, accel_bias = bias_components(vehicle)
    biases = [gyro_bias, accel_bias] if gyro else [accel_bias]
    moving = wheels.motion.speed > 0.01
    stray = wheels.motion.w_z_sd[moving] / wheels.motion.speed[moving]
    yaw_sd = YAW_LOOSE * float(np.median(stray)) if moving.any() else 0.02
    wandering = (
        rw.Wandering(_one(SLIP_COEFFICIENT, rover.K_GUESS, K_SD), K_LENGTH),
        rw.Wandering(_one(SIDE_SLIP, 0.0, SIDE_SD), SIDE_LENGTH),
        rw.Wandering(_one(YAW_SLIP, 0.0, yaw_sd), YAW_LENGTH),
    )
    toe = _one(TOE, 0.0, TOE_SD)
    ground = (toe, *(w.component for w in wandering))
    return Layout((*biases, *ground, *gnss_components(vehicle, gnss))), wandering


def _one(name: str, prior: float, sd: float) -> Component:
    return Component(name, np.array([prior]), np.array([sd]))


def _start(
    run: Run, vehicle: Vehicle, wheels: rover.Wheels, nodes: Nodes, origin: Origin
) -> InitialState:
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
    p_n, p_sd = first_position(run, vehicle, origin, float(nodes.time[0]))
    sds = np.array([tilt, tilt, sd, 1.0, 1.0, 1.0, p_sd, p_sd, p_sd])
    R = rotation_of_angles(*np.array([0.0, 0.0, float(value)]))
    return InitialState(R, np.zeros(3), p_n, sds)


def build(problem: RoverProblem, at: Estimate, found: list[WheelTrack]) -> list[Factor]:
    """Every factor as a function of the estimate."""
    layout = problem.layout
    factors = [_constraints(problem), _wheels(problem)]
    factors.append(_level(problem) if problem.inc is None else _inertial(problem, at))
    if problem.run.heading is not None:
        factors.append(_heading(problem))
    if problem.run.gnss is not None:
        fixes_n = fixes_in(problem.origin, problem.run.gnss)
        factors.append(fixes_on_smooth_path(problem.run.gnss, fixes_n, layout, problem.nodes))
    factors.append(lambda x: [terrain_slip(track, layout, x) for track in found])
    return factors


def _constraints(problem: RoverProblem) -> Factor:
    """Start, calibrations and what keeps them in place."""
    nodes, layout = problem.nodes, problem.layout
    path = np.interp(nodes.segment_time, problem.wheels.time, problem.wheels.path)
    t = float(nodes.time[0])

    def factor(x: Estimate) -> list[Block]:
        c = x.calibration
        return [
            initial_state(problem.start, t, x),
            *calibration_prior(layout, c),
            *rw.wander(layout, problem.wandering, c, path, nodes.segment_time),
            rw.bounded(SLIP_BOUNDS, layout, nodes.segment_time, x),
            rw.unused_phase(nodes.time, x),
        ]

    return factor


def _wheels(problem: RoverProblem) -> Factor:
    """Displacement, yaw and velocity from the running gear."""
    nodes, layout, wheels, sums = problem.nodes, problem.layout, problem.wheels, problem.sums
    T = np.diff(nodes.time)
    unheard = (1 - rover.heard_share(wheels, nodes.time)).clip(0) * T
    root, pace = np.sqrt(T), sums.path / T
    step = np.hypot((STEP_FLOOR + STEP_SHARE * pace) * root, UNHEARD_SPEED * unheard)
    steps = np.repeat(step[:, None], 3, 1)
    yaw_sd = problem.layout.prior_sd[layout.column(YAW_SLIP)]
    yaw = np.hypot((YAW_FLOOR + YAW_SHARE * yaw_sd * pace) * root, UNHEARD_RATE * unheard)
    u_b = rover.origin_velocity(wheels, nodes.time)
    speed = SPEED_SD + SPEED_SHARE * np.linalg.norm(u_b, axis=1)
    intervals, every = nodes.intervals, nodes.at(np.arange(len(nodes.time)))

    def factor(x: Estimate) -> list[Block]:
        turn = rw.turns(x.R_nb)
        return [
            rw.wheel_displacement(sums, turn, steps, layout, intervals, x),
            rw.wheel_yaw(sums, turn, yaw, layout, intervals, x),
            rw.wheel_speed(u_b, speed, layout, every, x),
        ]

    return factor


def _level(problem: RoverProblem) -> Factor:
    """Gyro-free attitude: quasi-static level and a ground whose slope changes little.

    Nodes without an accelerometer sample are taken to be level, loosely.
    """
    nodes, layout = problem.nodes, problem.layout
    n = len(nodes.time)
    T = np.diff(nodes.time)
    slope_sd = (TILT_FLOOR + TILT_SHARE * problem.sums.path / T) * np.sqrt(T)
    g_n = problem.origin.gravity(np.zeros(3))
    force, sigma = np.tile(-g_n, (n, 1)), np.full(n, UNLEVEL_SD * float(np.linalg.norm(g_n)))
    source = problem.run.accelerometer
    if source is not None:
        means = rover.levelling(source, nodes.time)
        known = np.isfinite(means.force_b[:, 0])
        force[known], sigma[known] = means.force_b[known], means.sigma[known]
    intervals, every, both = nodes.intervals, nodes.at(np.arange(n)), np.stack([sigma] * 2, -1)

    def factor(x: Estimate) -> list[Block]:
        return [
            rw.tilt(rw.turns(x.R_nb), slope_sd, intervals),
            level(force, g_n, both, layout, every, x),
        ]

    return factor


def _inertial(problem: RoverProblem, at: Estimate) -> Factor:
    """With gyros: inertial factors as for any vehicle."""
    assert problem.inc is not None and problem.noise is not None
    nodes, layout = problem.nodes, problem.layout
    errors = layout.imu_errors_of(at.calibration)[nodes.segment]
    pre = preintegrate(problem.inc, nodes.edge, errors, problem.noise)
    return inertial_factor(problem.origin, layout, nodes, pre)


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
    sigma, scope = np.full(len(value), rover.heading_sd(seen, wheels)), nodes.at(node, seen.time)
    bearing = Bearing(value, sigma)
    return lambda x: [heading(bearing, problem.layout, scope, x)]
