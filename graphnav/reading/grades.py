"""How good inertial sensors of a grade are, and defaults that follow from it."""

from collections.abc import Callable
from typing import Any, Literal

import numpy as np

ImuGrade = Literal["navigation", "fog", "tactical", "mems"]
Default = Callable[[dict[str, Any]], float]  # of a key, from the keys above it

# typical 1-sigma figures; explicit keys win over them. Scale factors: most sensors 100 to 1000 ppm,
# ring lasers 1 to 100, cheap MEMS up to a per cent (Groves 2013, Principles of GNSS, 4.4.2)
GRADES: dict[str, dict[str, float]] = {
    "navigation": {"gyro_bias_deg_h": 0.005, "gyro_noise_deg_sqrt_h": 0.001,
                   "gyro_scale_ppm": 20.0, "accel_bias_mg": 0.03,
                   "accel_noise_mg_sqrt_hz": 0.005, "accel_scale_ppm": 100.0},
    "fog": {"gyro_bias_deg_h": 0.05, "gyro_noise_deg_sqrt_h": 0.005,
            "gyro_scale_ppm": 300.0, "accel_bias_mg": 0.1,
            "accel_noise_mg_sqrt_hz": 0.02, "accel_scale_ppm": 500.0},
    "tactical": {"gyro_bias_deg_h": 5.0, "gyro_noise_deg_sqrt_h": 0.15,
                 "gyro_scale_ppm": 500.0, "accel_bias_mg": 2.0,
                 "accel_noise_mg_sqrt_hz": 0.1, "accel_scale_ppm": 1000.0},
    "mems": {"gyro_bias_deg_h": 200.0, "gyro_noise_deg_sqrt_h": 0.4,
             "gyro_scale_ppm": 5000.0, "accel_bias_mg": 20.0,
             "accel_noise_mg_sqrt_hz": 0.2, "accel_scale_ppm": 10000.0},
}  # fmt: skip
DEFAULT_GRADE: ImuGrade = "mems"
INSTABILITY = 0.1  # in-run over static bias (Groves 2013, 4.4.1)


def from_grade(name: str) -> Default:
    """A default for `key`: the figure `name` of the grade stated, or of `DEFAULT_GRADE`."""
    return lambda fields: GRADES[fields.get("grade") or DEFAULT_GRADE][name]


def share_of(stated: str, share: float) -> Default:
    """A default for `key`: a share of the figure `stated`, whoever states it."""
    return lambda fields: share * float(fields[stated])


def from_grade_like(name: str, stated: str) -> Default:
    """As `from_grade`, but without a grade stated from that whose figure `stated` is nearest."""

    def figure(fields: dict[str, Any]) -> float:
        value = float(fields.get(stated) or GRADES[DEFAULT_GRADE][stated])
        apart = {grade: abs(np.log(of[stated] / value)) for grade, of in GRADES.items()}
        return GRADES[fields.get("grade") or min(apart, key=apart.__getitem__)][name]

    return figure
