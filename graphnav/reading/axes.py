"""Axis orders: what the recorded x, y, z of an IMU point to."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

DIRECTIONS = {"R": (1, 0, 0), "L": (-1, 0, 0), "F": (0, 1, 0), "B": (0, -1, 0),
              "U": (0, 0, 1), "D": (0, 0, -1)}  # fmt: skip
OPPOSITE = dict(zip("RLFBUD", "LRBFDU", strict=True))


def axes_matrix(axes: str) -> Array:
    """Signed permutation (3, 3) taking a recorded vector to right-forward-up.

    `axes` are three letters, what x, y, z point to: R/L, F/B, U/D. ValueError when a direction is
    unknown or used twice, or when the three are left-handed.
    """
    if len(axes) != 3 or any(letter not in DIRECTIONS for letter in axes):
        raise ValueError(f"'{axes}' is not three letters out of R/L, F/B, U/D, e.g. RFU, FRD, FLU")
    matrix = np.array([DIRECTIONS[letter] for letter in axes], float).T
    turn = round(np.linalg.det(matrix))
    if turn == 0:
        raise ValueError(f"'{axes}' uses one direction twice; x, y, z need one of each pair")
    if turn < 0:
        flipped = axes[:2] + OPPOSITE[axes[2]]
        raise ValueError(f"'{axes}' is a left-handed frame; was '{flipped}' meant?")
    return matrix


def axes_name(matrix: Array) -> str:
    """The three letters of a signed permutation (3, 3): the inverse of `axes_matrix`."""
    letters = {vector: letter for letter, vector in DIRECTIONS.items()}
    return "".join(letters[tuple(round(x) for x in column)] for column in matrix.T)
