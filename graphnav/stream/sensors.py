"""What a stream has heard of the vehicle's own motion."""

from dataclasses import dataclass, field

from graphnav.stream.inertial_intake import Inertial
from graphnav.stream.intake import Distance, Sides
from graphnav.stream.standstill import CausalStandstill


@dataclass(frozen=True)
class Sensors:
    """Inertial samples, running gear and where the vehicle stands."""

    standstill: CausalStandstill
    inertial: Inertial = field(default_factory=Inertial)
    odometer: Distance = field(default_factory=Distance)
    sides: Sides = field(default_factory=Sides)
