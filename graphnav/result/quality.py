"""How far a result can be relied on: its grade, what speaks against it, what would cure it."""

from dataclasses import asdict, dataclass
from typing import Any, Literal

from graphnav.common.remark import Remark

Grade = Literal["good", "doubtful", "rejected"]
GRADES: tuple[Grade, ...] = ("good", "doubtful", "rejected")  # an index is a remark's level


@dataclass(frozen=True)
class Spread:
    """A standard deviation over a run; `at_s` is when it was worst, on the file's own clock."""

    median: float
    worst: float
    at_s: float


@dataclass(frozen=True)
class Quality:
    """`quality` of summary.json; `why` and `remedy` in the order worth reading."""

    grade: Grade
    why: tuple[str, ...]
    remedy: tuple[str, ...]
    position_sd_m: Spread  # horizontal: root of the sum of east and north variances
    heading_sd_deg: float  # median

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self) | {"why": list(self.why), "remedy": list(self.remedy)}


def graded(remarks: list[Remark], position: Spread, heading_sd_deg: float) -> Quality:
    """The quality that some remarks leave: as bad as the worst of them."""
    ordered = sorted(remarks, key=lambda d: -d.level)
    return Quality(
        grade=GRADES[max([0, *(d.level for d in ordered)])],
        why=tuple(dict.fromkeys(d.why for d in ordered)),
        remedy=tuple(dict.fromkeys(d.remedy for d in ordered if d.remedy)),
        position_sd_m=position,
        heading_sd_deg=heading_sd_deg,
    )


def in_one_line(quality: dict[str, Any]) -> str:
    """The `quality` of summary.json as the terminal says it first."""
    position, heading = quality["position_sd_m"], quality["heading_sd_deg"]
    line = (
        f"position +- {position['median']:.2g} m, worst +- {position['worst']:.2g} m at "
        f"{position['at_s']:.0f} s; heading +- {heading:.2g} deg"
    )
    grade = quality["grade"].upper() if quality["grade"] == "rejected" else quality["grade"]
    return "; ".join([f"{line}: {grade}", *quality["why"][:1]])
