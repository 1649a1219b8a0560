"""The vehicle file: what carried the sensors, where they sat and how good they are.

Every key is optional except `kind`. Lever arms and the mounting rotation are given in b **after**
`imu.axes` has been applied, so right-forward-up whatever the recorded axes were. Reading the file
and turning its mistakes into one line each is `graphnav.reading.vehicle_file`.
"""

from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from graphnav.reading import columns, units
from graphnav.reading.axes import axes_matrix
from graphnav.reading.grades import (
    DEFAULT_GRADE,
    GRADES,
    INSTABILITY,
    ImuGrade,
    from_grade,
    from_grade_like,
    share_of,
)

Array = NDArray[np.float64]
Kind = Literal["tracked", "wheeled", "rover"]
Bearer = Literal["imu", "vehicle"]
# no length, angle or noise of a vehicle is larger; squares of larger ones leave a float's range
LARGEST, SMALLEST = 1e9, 1e-12
Number = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-LARGEST, le=LARGEST)]
Positive = Annotated[Number, Field(ge=SMALLEST)]
NotNegative = Annotated[Number, Field(ge=0)]
Vector = tuple[Number, Number, Number]


def key(about: str, unit: str = "", default: Any = None) -> Any:
    """A field with its meaning and unit, from which messages and documentation are made.

    `default` may be a function of the keys above it.
    """
    extra: Any = {"unit": unit}
    if callable(default):
        return Field(default_factory=default, description=about, json_schema_extra=extra)
    return Field(default, description=about, json_schema_extra=extra)


def sharper_if(given: str, sd: float, otherwise: float) -> Any:
    """A default for `key`: `sd` when the file states `given`, `otherwise` when it does not."""
    return lambda fields: sd if fields.get(given) is not None else otherwise


def apart_sd(fields: dict[str, Any]) -> float:
    """1 sigma of the antenna's lever arm, m: no antenna sits in the IMU, so zeros state nothing."""
    return 0.05 if any(fields.get("lever_arm") or ()) else 1.0


class Section(BaseModel):
    """One table of the vehicle file: frozen, no unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True)

    def given(self, name: str) -> bool:
        """Whether the file states this key, rather than leaving it to its default."""
        return name in self.model_fields_set


class BodySpec(Section):
    """`[vehicle]`: the running gear."""

    kind: Kind = key("tracked, wheeled or rover", default=...)
    name: str = key("free text for reports", default="")
    track_gauge: Positive = key("distance between the tracks B", "m", 2.80)
    contact_length: Positive = key("ground contact length L", "m", 3.84)
    low_gear_ratio: Positive | None = key(
        "odometer over ground speed in low gear; 1: none (1.42, or 1 with two side speeds)"
    )
    max_turn_deg: Positive = key("heading change over 1 s beyond which tracks tell nothing",
                                 "deg", 34.4)  # fmt: skip


class OdometerSpec(Section):
    """`[odometer]`: a pulse counter or a speed, and where it measures."""

    column: Literal["odo_pulses", "odo_speed"] | None = key("which column; whichever is there")
    metres_per_pulse: Positive | None = key("nominal distance per count", "m")
    scale_sd: Positive = key("1 sigma of the scale factor (0.02 = 2 %)", default=0.02)
    scale_wander: NotNegative = key(
        "by how much it wanders in an hour, 1 sigma (a tyre warms by 3 permille)", default=0.003
    )
    lever_arm: Vector | None = key("IMU to the odometer point, b frame", "m")
    lever_arm_sd: Positive = key(
        "1 sigma of each component", "m", sharper_if("lever_arm", 0.1, 1.0)
    )
    mount_deg: Vector | None = key("rotation vector b <- m about x, y, z", "deg")
    mount_sd_deg: Positive = key(
        "1 sigma of each component", "deg", sharper_if("mount_deg", 1.0, 2.0)
    )
    time_offset_s: Number = key("odometer clock minus IMU clock", "s", 0.0)
    time_offset_sd_s: NotNegative = key("1 sigma of it; 0 holds it", "s", 0.1)

    @property
    def lever_b(self) -> Array:
        """IMU to the odometer point (3,) m; zero when not given."""
        return np.array(self.lever_arm or (0.0, 0.0, 0.0))

    @property
    def mount_b(self) -> Array:
        """Rotation vector b <- m (3,) rad; zero when not given."""
        return np.deg2rad(self.mount_deg or (0.0, 0.0, 0.0))


class ImuSpec(Section):
    """`[imu]`: axis order and error figures; what is not given comes from `grade`."""

    axes: str = key("what x, y, z point to, e.g. RFU, FRD, FLU", default="RFU")
    grade: ImuGrade | None = key("navigation, fog, tactical or mems: fills the figures not given")
    gyro_bias_deg_h: Positive = key(
        "1 sigma of the constant part", "deg/h", from_grade("gyro_bias_deg_h")
    )
    gyro_noise_deg_sqrt_h: Positive = key(
        "angle random walk", "deg/sqrt(h)", from_grade("gyro_noise_deg_sqrt_h")
    )
    gyro_scale_ppm: NotNegative = key(
        "1 sigma of each axis' scale factor; 0 holds it",
        "ppm",
        from_grade_like("gyro_scale_ppm", "gyro_bias_deg_h"),
    )
    gyro_instability_deg_h: NotNegative = key(
        "by how much the bias wanders in a quarter of an hour, 1 sigma; a tenth of it if not given",
        "deg/h",
        share_of("gyro_bias_deg_h", INSTABILITY),
    )
    accel_bias_mg: Positive = key("1 sigma of the constant part", "mg", from_grade("accel_bias_mg"))
    accel_noise_mg_sqrt_hz: Positive = key(
        "velocity random walk", "mg/sqrt(Hz)", from_grade("accel_noise_mg_sqrt_hz")
    )
    accel_scale_ppm: NotNegative = key(
        "1 sigma of each axis' scale factor; 0 holds it",
        "ppm",
        from_grade_like("accel_scale_ppm", "accel_bias_mg"),
    )
    accel_instability_mg: NotNegative = key(
        "as `gyro_instability_deg_h`", "mg", share_of("accel_bias_mg", INSTABILITY)
    )

    @field_validator("axes")
    @classmethod
    def _right_handed(cls, axes: str) -> str:
        axes_matrix(axes.upper())
        return axes.upper()

    @property
    def axes_matrix(self) -> Array:
        """Signed permutation (3, 3): `v_b = axes_matrix @ v_recorded`."""
        return axes_matrix(self.axes)

    @property
    def assumed(self) -> tuple[str, ...]:
        """Figures that neither the file nor a named grade states; scale factors go by biases."""
        like = {"gyro_scale_ppm": "gyro_bias_deg_h", "accel_scale_ppm": "accel_bias_mg"}
        open_ = (
            k for k in GRADES[DEFAULT_GRADE] if not (self.given(k) or self.given(like.get(k, k)))
        )
        return () if self.grade else tuple(open_)


class GnssSpec(Section):
    """`[gnss]`: how fixes are used."""

    use: Annotated[bool, Field(strict=True)] = key(
        "false: fixes are ignored except in the report", default=True
    )
    lever_arm: Vector | None = key("IMU to the antenna, b frame", "m")
    lever_arm_sd: Positive = key("1 sigma of each component", "m", apart_sd)
    sd: Positive = key("1 sigma of fixes that state none", "m", 5.0)
    time_offset_s: Number | None = key("by how much fixes are stamped late", "s")
    time_offset_sd_s: NotNegative = key(
        "1 sigma of it; 0 holds it", "s", sharper_if("time_offset_s", 0.05, 0.1)
    )

    @property
    def lever_b(self) -> Array:
        """IMU to the antenna (3,) m; zero when not given."""
        return np.array(self.lever_arm or (0.0, 0.0, 0.0))


class StartSpec(Section):
    """`[start]`: where the run began; needed only without GNSS."""

    lat: Annotated[Number, Field(ge=-90, le=90)] | None = key("latitude", "deg")
    lon: Annotated[Number, Field(ge=-180, le=360)] | None = key("longitude", "deg")
    height: Number | None = key("ellipsoidal height", "m")
    position_sd_m: Positive = key("1 sigma of each coordinate", "m", 0.1)
    heading_deg: Number | None = key("heading at the start, clockwise from north", "deg")
    heading_of: Bearer = key("whose it is: the IMU's forward axis or the vehicle", default="imu")
    heading_sd_deg: Positive = key("1 sigma of the heading", "deg", 1.0)

    @model_validator(mode="after")
    def _both_or_none(self) -> Self:
        if (self.lat is None) != (self.lon is None):
            raise ValueError("[start] needs both lat and lon [deg], or neither")
        return self

    @property
    def has_position(self) -> bool:
        """Whether latitude and longitude are stated (a height not stated is 0)."""
        return self.lat is not None


class HeadingSpec(Section):
    """`[heading]`: the column `heading_deg` of a sun or star sensor or a dual antenna."""

    heading_of: Bearer = key("whose it is: the IMU's forward axis or the vehicle", default="imu")


class RoverSpec(Section):
    """`[rover]`: rocker-bogie linkage, named as in methods C3, metres."""

    l_m1: Positive | None = key("rocker pivot back to the bogie pivot", "m")
    l_m2: Positive | None = key("rocker pivot forward to the front axle", "m")
    l_r1: Positive | None = key("bogie pivot back to the rear axle", "m")
    l_r2: Positive | None = key("bogie pivot forward to the middle axle", "m")
    d_a1: Number | None = key("rocker pivot down to the front axle", "m")
    d_a2: Number | None = key("bogie pivot down to the middle axle", "m")
    d_a3: Number | None = key("bogie pivot down to the rear axle", "m")
    d_r: Number | None = key("rocker pivot down to the bogie pivot", "m")
    l_x: Number | None = key("body origin forward to the differential", "m")
    l_z: Number | None = key("body origin down to the differential", "m")
    l_d: Positive | None = key("differential to either wheel plane", "m")
    wheel_radius: Positive | None = key("wheel radius", "m")


class Column(Section):
    """`[columns]` entry: the name and unit a column has in the run file."""

    name: str | None = key("header in the run file")
    unit: str | None = key("its unit, e.g. deg/s, g, km/h, ms")


class Vehicle(Section):
    """A whole vehicle file."""

    body: BodySpec = Field(alias="vehicle")
    odometer: OdometerSpec = OdometerSpec()
    imu: ImuSpec = ImuSpec()
    gnss: GnssSpec = GnssSpec()
    start: StartSpec = StartSpec()
    heading: HeadingSpec = HeadingSpec()
    rover: RoverSpec = RoverSpec()
    columns: dict[str, Column] = {}

    @field_validator("columns", mode="before")
    @classmethod
    def _plain_name(cls, value: Any) -> Any:
        """`gyro_x = "wx"` is short for `gyro_x = { name = "wx" }`."""
        if not isinstance(value, dict):
            return value
        return {k: {"name": v} if isinstance(v, str) else v for k, v in value.items()}

    @field_validator("columns")
    @classmethod
    def _known_units(cls, value: dict[str, Column]) -> dict[str, Column]:
        for name, column in value.items():
            if column.unit is not None:
                try:
                    units.factor(columns.dimension(name), column.unit)
                except ValueError as error:
                    raise ValueError(f"[columns] {name}: {error}") from None
        return value

    @property
    def kind(self) -> Kind:
        """tracked, wheeled or rover."""
        return self.body.kind
