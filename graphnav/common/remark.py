"""Something found on the way that a reader of the result must hear."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Remark:
    """One finding with its cure; `level` 0: told only, 1: doubtful, 2: beyond use."""

    why: str
    remedy: str = ""
    level: int = 0
