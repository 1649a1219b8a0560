"""What keeps the code readable: no long files, no long functions. Arguments: ruff (PLR0913)."""

import ast
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
from mutants import MUTANTS

ROOT = Path(__file__).resolve().parents[1]
LINES, FUNCTION = 300, 60
FOLDERS = ("factors", "graphnav", "tests", "tools")
FILES = sorted(f for folder in FOLDERS for f in (ROOT / folder).rglob("*.py"))


def functions(file: Path) -> Iterator[tuple[str, int]]:
    """Name and lines of every function of a file."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            assert node.end_lineno is not None
            yield node.name, node.end_lineno - node.lineno + 1


def test_there_are_files() -> None:
    assert len(FILES) > 100


@pytest.mark.parametrize("room", sorted({f.parent for f in FILES}), ids=lambda p: p.name)
def test_files_and_functions_are_short(room: Path) -> None:
    for file in room.glob("*.py"):
        assert len(file.read_text(encoding="utf-8").splitlines()) <= LINES, file
        long = [f"{name} {size}" for name, size in functions(file) if size > FUNCTION]
        assert not long, f"{file}: {long}"


def test_every_room_says_what_comes_in_and_goes_out() -> None:
    for room in sorted(f.parent for f in (ROOT / "graphnav").glob("*/__init__.py")):
        said = ast.get_docstring(ast.parse((room / "__init__.py").read_text(encoding="utf-8")))
        assert said, room
        for part in ("In: ", "Out: ", "Not here: "):
            assert part in said, (room, part)


def test_the_drawn_rooms_are_there_and_arrows_join_rooms_that_may_import() -> None:
    """Arrows of docs/rooms.svg run between layers, never between rooms that must not meet."""
    drawing = (ROOT / "docs" / "rooms.svg").read_text(encoding="utf-8")
    shapes = re.findall(
        r'<rect x="(\d+)" y="(\d+)" width="(\d+)" height="(\d+)".*?>\n<text[^>]*class="n">(.*?)<',
        drawing,
    )
    rooms = {name: tuple(map(float, sides)) for *sides, name in shapes}
    drawn = {word for name in rooms for word in re.findall(r"\w+", name)}
    parts = {p.parent.name for p in (ROOT / "graphnav").glob("*/__init__.py")}
    assert drawn == parts | {"pipeline", "validation", "factors"}
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]
    layers = contracts["contracts"][0]["layers"]
    layer = {name: k for k, line in enumerate(layers) for name in re.findall(r"\w+", line)}

    def at(x: float, y: float) -> str:
        def apart(name: str) -> float:
            left, top, width, height = rooms[name]
            return max(left - x, x - left - width, top - y, y - top - height)

        nearest = min(rooms, key=apart)
        assert apart(nearest) < 8, (x, y)
        return re.findall(r"\w+", nearest)[0]

    arrows = re.findall(r'<path d="M([^"]+)" class="a"', drawing)
    assert arrows
    for arrow in arrows:
        points = [(float(x), float(y)) for x, y in re.findall(r"([\d.]+) ([\d.]+)", arrow)]
        begin, end = at(*points[0]), at(*points[-1])
        by_file = (begin, end) == ("simulation", "reading")  # which must not import each other
        assert by_file or layer[begin] != layer[end], (begin, end)


def test_every_mutant_changes_one_line_that_is_there() -> None:
    """Or `tools/mutants.py` stops halfway, some day after the line was rewritten."""
    for mutant in MUTANTS:
        text = (ROOT / mutant.file).read_text(encoding="utf-8")
        assert text.count(mutant.line) == 1, (mutant.name, mutant.line)
        assert mutant.line != mutant.wrong, mutant.name
        for name in mutant.tests.split():
            assert (ROOT / "tests" / f"test_{name}.py").exists(), (mutant.name, name)
    names = [mutant.name for mutant in MUTANTS]
    assert len(set(names)) == len(names)
