"""Slip of wheels and tracks: how much further their surface goes than the vehicle."""

import numpy as np

from graphnav.simulation.drive import Options, SimulatedVehicle, stream
from graphnav.simulation.ellipsoid import Array
from graphnav.simulation.field import wander
from graphnav.simulation.ground import tilt
from graphnav.simulation.legs import Commands

LENGTH = 6.0  # m of travel over which slip stays alike


def slipping(options: Options, setup: SimulatedVehicle, drive: Commands, speed: Array) -> Array:
    """Speed of the running gear (M,) or of both sides (M, 2) m/s where it goes at `speed`."""
    field = setup.field
    if field is None or "slip" not in field.effects:
        return speed
    rng = stream(options.seed, "slip")
    dt = float(drive.time[1])
    travel = np.cumsum(np.abs(drive.speed) + field.half_gauge * np.abs(drive.yaw_rate)) * dt
    pitch = tilt(stream(options.seed, "ground"), setup.rough, drive)[1]
    climb = field.slip_climb * np.sin(pitch) * np.sign(drive.speed)
    sides = [
        field.slip_sd * wander(rng, LENGTH, travel) + climb for _ in range(speed.size // len(speed))
    ]
    slip = np.clip(np.reshape(np.stack(sides, -1), speed.shape), -0.3, 0.6)
    return np.asarray(speed / (1 - slip))
