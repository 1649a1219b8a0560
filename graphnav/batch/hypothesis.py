"""A mistake a user may have made: what would undo it, and words for it."""

from collections.abc import Callable
from dataclasses import dataclass

from graphnav.common.run import Run
from graphnav.reading.vehicle import Vehicle
from graphnav.result.solved import Solved

Undone = tuple[Run, Vehicle]


@dataclass(frozen=True)
class Hypothesis:
    """A mistake: what undoes it, and words for it once the run agrees."""

    undo: Callable[[Run, Vehicle], Undone]
    why: Callable[[Solved], str]  # of the run solved without the mistake
    remedy: Callable[[Solved], str]


def said(text: str) -> Callable[[Solved], str]:
    """Words that need nothing of the solution."""
    return lambda _: text
