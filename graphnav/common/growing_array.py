"""An array that grows at its end in amortised constant time."""

import numpy as np
from numpy.typing import NDArray

from graphnav.common.run import Array


class GrowingArray:
    """Rows appended in time order; `rows` is a view of all of them so far."""

    def __init__(self, *shape: int) -> None:
        self._data = np.empty((64, *shape))
        self._count = 0

    def __len__(self) -> int:
        return self._count

    @property
    def rows(self) -> NDArray[np.float64]:
        """(count, *shape), a view: writing to it changes the array."""
        return self._data[: self._count]

    def append(self, rows: Array) -> None:
        """Add rows (n, *shape)."""
        need = self._count + len(rows)
        if need > len(self._data):
            grown = np.empty((max(need, 2 * len(self._data)), *self._data.shape[1:]))
            grown[: self._count] = self.rows
            self._data = grown
        self._data[self._count : need] = rows
        self._count = need

    def push(self, row: Array | float) -> None:
        """Add one row."""
        self.append(np.asarray(row)[None])

    def cut(self, count: int) -> None:
        """Keep the first `count` rows."""
        self._count = min(count, self._count)
