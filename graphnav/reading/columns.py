"""The columns of a run file and how a vehicle file renames or rescales them."""

from graphnav.reading.units import UNITS

GYRO = ("gyro_x", "gyro_y", "gyro_z")
ACCEL = ("accel_x", "accel_y", "accel_z")
SIDES = ("odo_left", "odo_right")
SIDE_PULSES = ("odo_pulses_left", "odo_pulses_right")
GNSS = ("gnss_lat", "gnss_lon", "gnss_height")
GNSS_SD = ("gnss_sd_e", "gnss_sd_n", "gnss_sd_u")
WHEELS = tuple(f"wheel_{i}" for i in range(1, 7))
STEERS = tuple(f"steer_{i}" for i in range(1, 7))
LINKS = ("rocker", "bogie_left", "bogie_right")

# column -> dimension, a key of units.UNITS
DIMENSION: dict[str, str] = {
    "time": "time",
    **dict.fromkeys(GYRO, "rate"),
    **dict.fromkeys(ACCEL, "acceleration"),
    "odo_speed": "speed",
    "odo_pulses": "count",
    **dict.fromkeys(SIDES, "speed"),
    **dict.fromkeys(SIDE_PULSES, "count"),
    "gnss_lat": "position",
    "gnss_lon": "position",
    "gnss_height": "length",
    **dict.fromkeys(GNSS_SD, "length"),
    "heading_deg": "position",
    **dict.fromkeys(WHEELS, "rate"),
    **dict.fromkeys(STEERS, "angle"),
    **dict.fromkeys(LINKS, "angle"),
}

# names that stand for several columns when only their unit is mapped: `gyro = { unit = "deg/s" }`
GROUPS: dict[str, tuple[str, ...]] = {
    "gyro": GYRO,
    "accel": ACCEL,
    "sides": SIDES,
    "gnss_sd": GNSS_SD,
    "wheels": WHEELS,
    "steers": STEERS,
}


def dimension(column: str) -> str:
    """Dimension of a column or group name; KeyError when there is none."""
    return DIMENSION[GROUPS[column][0] if column in GROUPS else column]


def default_unit(column: str) -> str:
    """The unit a column is read in when the vehicle file says nothing."""
    return next(iter(UNITS[dimension(column)]))
