"""The kinds of factors, by which weights, noise and outputs speak of them."""

from typing import Final

START: Final = "start"
INERTIAL: Final = "inertial"
STANDSTILL: Final = "standstill"
DISPLACEMENT: Final = "displacement"
VELOCITY: Final = "velocity"
PHASE: Final = "phase"
DRIVING: Final = "driving"
LEVEL: Final = "level"
TRACK_WIDTH: Final = "track_width"
GNSS: Final = "gnss"
HEADING: Final = "heading"
START_HEADING: Final = "start_heading"
CALIBRATION_PRIOR: Final = "calibration_prior"
STATED: Final = "stated"
CALIBRATION_WALK: Final = "calibration_walk"
SCALE_WALK: Final = "scale_walk"

# a rover's
WHEEL_DISPLACEMENT: Final = "wheel_displacement"
WHEEL_YAW: Final = "wheel_yaw"
WHEEL_SPEED: Final = "wheel_speed"
TILT: Final = "tilt"
TERRAIN_SLIP: Final = "terrain_slip"
CALIBRATION_MEAN: Final = "calibration_mean"
BOUNDS: Final = "bounds"
