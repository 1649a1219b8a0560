"""Units a column of a run file may come in; everything inside is SI and radians."""

import math

G_STANDARD = 9.80665  # m/s^2 per g
DEG = math.pi / 180

# dimension -> unit -> factor to the unit graphnav reads the column in (the one with factor 1)
UNITS: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0},
    "rate": {
        "rad/s": 1.0,
        "deg/s": DEG,
        "deg/h": DEG / 3600,
        "mrad/s": 1e-3,
        "rpm": math.tau / 60,
        "rad/sample": 1.0,
        "deg/sample": DEG,
        "rad": 1.0,
        "deg": DEG,
    },
    "acceleration": {
        "m/s^2": 1.0,
        "g": G_STANDARD,
        "mg": G_STANDARD * 1e-3,
        "cm/s^2": 1e-2,
        "m/s/sample": 1.0,
        "m/s": 1.0,
    },
    "speed": {"m/s": 1.0, "km/h": 1 / 3.6, "mph": 0.44704, "kn": 1852 / 3600, "cm/s": 1e-2},
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "km": 1e3, "ft": 0.3048},
    "angle": {"rad": 1.0, "deg": DEG},
    "position": {"deg": 1.0, "rad": 1 / DEG, "1e-7 deg": 1e-7},
    "count": {"count": 1.0},
}
SPELLINGS = {"m/s2": "m/s^2", "m/s²": "m/s^2", "kmh": "km/h", "kph": "km/h", "dps": "deg/s",
             "°/s": "deg/s", "°": "deg", "degrees": "deg", "radians": "rad", "knots": "kn",
             "µs": "us", "counts": "count", "pulses": "count",
             "deg*1e-7": "1e-7 deg", "deg*1e7": "1e-7 deg", "1e7 deg": "1e-7 deg",
             "degE7": "1e-7 deg"}  # fmt: skip
# what an IMU gained over its sampling interval, rather than the mean over it
INCREMENTS = {"rate": ("rad/sample", "deg/sample", "rad", "deg"),
              "acceleration": ("m/s/sample", "m/s")}  # fmt: skip


def factor(dimension: str, unit: str) -> float:
    """Factor from `unit` to the reading unit of `dimension`; ValueError lists what there is."""
    known = UNITS[dimension]
    value = known.get(SPELLINGS.get(unit, unit))
    if value is None:
        raise ValueError(f"unit '{unit}' is not known here; use one of {', '.join(known)}")
    return value


def is_increment(dimension: str, unit: str) -> bool:
    """Whether `unit` is what was gained over a sample, to be divided by its interval."""
    return SPELLINGS.get(unit, unit) in INCREMENTS.get(dimension, ())
