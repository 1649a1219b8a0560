"""Colours, the same in recording, report and exports: `#rrggbb`, legible on light and dark.

Straight driving is blue, standing grey, arcs orange, separated turns green, pivots red; the low
gear of a kind is its lighter shade.
"""

from collections.abc import Iterable

MOTION = {
    "straight_high": "#2f7de1",
    "straight_low": "#6fb7f2",
    "stop": "#8a8f98",
    "turn_arc": "#e69f00",
    "turn_pivot": "#d6293e",
    "turn_separated": "#0f9d6b",
    "turn_separated_low": "#74c69d",
    "turn_pivot_low": "#f0849a",
    "turn_large": "#9b5de5",
    "moving": "#2f7de1",
}
MOTION_LABEL = {
    "straight_high": "Straight, high gear",
    "straight_low": "Straight, low gear",
    "stop": "Stop",
    "turn_arc": "Arc turn",
    "turn_pivot": "Pivot turn",
    "turn_separated": "Separated turn",
    "turn_separated_low": "Separated turn, low gear",
    "turn_pivot_low": "Pivot turn, low gear",
    "turn_large": "Large heading change",
    "moving": "Moving",
}
EVENT = {
    "side_slip": "#e84fb5",
    "hop": "#b8860b",
    "wheel_spin": "#e2571e",
    "wheel_lock": "#7a4fd0",
}
DEAD_RECKONING = "#b07a4b"
TRUTH = "#d8c62f"
GNSS = "#c061cb"
CAUSAL = "#12b5bd"
DOWN_WEIGHTED = "#ff3b30"
AXES = ("#d1495b", "#3f8f4f", "#2f7de1")  # x y z, and e n u
ODOMETER = "#e69f00"
ODOMETER_RAW = "#8a8f98"
OTHER = "#a89f68"  # a name this list does not know


def motion(state: str) -> str:
    """Colour of a motion state; a name of another version gets one colour of its own."""
    return MOTION.get(state, OTHER)


def motion_label(state: str) -> str:
    """A motion state in words."""
    return MOTION_LABEL.get(state, state.replace("_", " ").capitalize())


def event(kind: str) -> str:
    """Colour of a slip event."""
    return EVENT.get(kind, OTHER)


def event_label(kind: str) -> str:
    """A slip event in words."""
    return kind.replace("_", " ").capitalize()


def in_order(states: Iterable[str]) -> list[str]:
    """Distinct states in the order of this palette, unknown ones last by name."""
    known = list(MOTION)
    return sorted(set(states), key=lambda s: (known.index(s) if s in MOTION else len(known), s))


def rgb(colour: str) -> tuple[int, int, int]:
    """`#rrggbb` to 0..255 each."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


def rgba32(colour: str, alpha: int = 255) -> int:
    """`#rrggbb` to 0xRRGGBBAA."""
    return int(colour[1:], 16) << 8 | alpha
