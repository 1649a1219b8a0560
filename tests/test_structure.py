"""What keeps the code readable: no long files, no long functions. Arguments: ruff (PLR0913)."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
LINES, FUNCTION = 300, 60
FILES = sorted(f for room in ("factors", "graphnav") for f in (ROOT / room).rglob("*.py"))


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
