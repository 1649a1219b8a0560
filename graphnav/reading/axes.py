"""Axis orders: what the recorded x, y, z of an IMU point to."""

from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

DIRECTIONS = {"R": (1, 0, 0), "L": (-1, 0, 0), "F": (0, 1, 0), "B": (0, -1, 0),
              "U": (0, 0, 1), "D": (0, 0, -1)}  # fmt: skip
COMMON = ("RFU", "FLU", "FRD", "LBU", "BRU", "RBD", "LFD", "BLD")
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
        # which axis is up and which ahead everyone sees: the side is mistaken, or D for U
        other = "".join(OPPOSITE[x] if x in "RL" else x for x in axes)
        likely = [other] if "U" in axes else [axes.replace("D", "U"), other]
        meant = " or ".join(f"'{x}'" for x in likely)
        raise ValueError(f"'{axes}' is a left-handed frame; was {meant} meant?")
    return matrix


def right_handed() -> list[str]:
    """The 24 axis orders there are, the usual ones first."""
    found = []
    for order in permutations(("RL", "FB", "UD")):
        for letters in product(*order):
            matrix = np.array([DIRECTIONS[letter] for letter in letters], float)
            if np.linalg.det(matrix) > 0:
                found.append("".join(letters))
    return [*COMMON, *(axes for axes in found if axes not in COMMON)]


def axes_name(matrix: Array) -> str:
    """The three letters of a signed permutation (3, 3): the inverse of `axes_matrix`."""
    letters = {vector: letter for letter, vector in DIRECTIONS.items()}
    return "".join(letters[tuple(round(x) for x in column)] for column in matrix.T)
