"""What of a table is left out or read otherwise than it stands: counted, the first lines named."""

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import islice

from graphnav.common.errors import InputError
from graphnav.reading.dialect import MOST_DAMAGED

NAMED = 2  # damaged lines that are named, of all that are counted
HOPELESS = 10_000  # damaged lines after which a file of which most are is read no further


@dataclass
class LeftOut:
    """Counted up block after block, so that a ruined file takes no more memory than a whole one."""

    damaged: int = 0
    first: list[tuple[int, str]] = field(default_factory=list)  # line and what is wrong with it
    blanks: Counter[str] = field(default_factory=Counter)  # words read as blank
    comments: int = 0
    cut: int = 0  # lines with blank cells beyond the header
    said: list[str] = field(default_factory=list)  # of the whole

    def damage(self, count: int, why: Iterable[tuple[int, str]]) -> None:
        """More damaged lines, of which the first tell `why`."""
        self.damaged += count
        self.first = sorted([*self.first, *islice(why, NAMED)])[:NAMED]

    def notes(self) -> Iterator[str]:
        """In the words a user reads."""
        if self.comments:
            yield f"{self.comments} comment lines passed over"
        if self.cut:
            yield f"blank cells beyond the header cut off in {self.cut} lines"
        yield from self.said
        if self.blanks:
            words = ", ".join(f"'{word}' ({count})" for word, count in self.blanks.most_common(4))
            yield f"cells that say there is no sample are read as blank: {words}"
        if self.damaged:
            first = "; ".join(f"line {line}: {what}" for line, what in self.first)
            yield f"{self.damaged} damaged line{'s' * (self.damaged > 1)} left out, {first}"

    def check(self, where: str, kind: str, rows: int, ended: bool) -> None:
        """InputError with the first damaged line when there are more of them than `MOST_DAMAGED`
        beside `rows` whole ones; before the end only where that is beyond hope.

        `kind` is how rows are counted: line or row.
        """
        lines = rows + self.damaged
        if self.damaged <= MOST_DAMAGED * lines:
            return
        if not ended and (self.damaged < HOPELESS or self.damaged <= rows):
            return
        line, what = self.first[0]
        cure = "; leave the cell blank when there is no sample" if "not a number" in what else ""
        if what.startswith("time "):
            cure = "; a time is a number [s] or ISO 8601, as 2024-05-01T12:00:00.010Z"
        raise InputError(
            f"{where}: {kind} {line}: {what} ({self.damaged} such {kind}s of {lines}"
            f"{'' if ended else ' so far'}, over {MOST_DAMAGED:.0%}){cure}"
        )
