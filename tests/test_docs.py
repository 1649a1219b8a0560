"""The documents keep up with the code."""

import importlib.util
import re
import tomllib
from pathlib import Path

import pytest

from graphnav.cli.cli import cli
from graphnav.reading.grades import GRADES
from graphnav.reading.vehicle import Vehicle

ROOT = Path(__file__).parents[1]
VEHICLE = (ROOT / "docs" / "vehicle.md").read_text(encoding="utf-8")
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_tables_of_vehicle_keys_are_fresh() -> None:
    where = ROOT / "tools" / "vehicle_keys.py"
    spec = importlib.util.spec_from_file_location("vehicle_keys", where)
    assert spec is not None
    assert spec.loader is not None
    tool = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tool)
    assert tool.page(VEHICLE) == VEHICLE, "run: python tools/vehicle_keys.py"


def test_grades_are_the_documented_ones() -> None:
    for name, figures in GRADES.items():
        [row] = re.findall(rf"\| `{name}` \|(.*)\|", VEHICLE)
        assert [float(cell) for cell in row.split("|")] == list(figures.values())


@pytest.mark.parametrize("text", [VEHICLE, README], ids=["vehicle.md", "README.md"])
def test_vehicle_files_shown_are_valid(text: str) -> None:
    blocks = [tomllib.loads(block) for block in re.findall(r"```toml\n(.*?)```", text, re.S)]
    assert blocks
    for block in blocks:
        Vehicle.model_validate({"vehicle": {"kind": "wheeled"}} | block)


def test_readme_names_commands_files_and_targets_that_exist() -> None:
    used = set(re.findall(r"(?:^    |`)graphnav (\w+)", README, re.M))
    assert used <= set(cli.commands)
    assert {"smooth", "show", "check", "export"} <= used
    for path in re.findall(r"\]\(((?!http)[^)#]+)\)", README):
        assert (ROOT / path).exists(), path
    for tool in re.findall(r"python (tools/\w+\.py)", README):
        assert (ROOT / tool).exists(), tool
    targets = re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(), re.M)
    assert set(re.findall(r"make (\w+)", README)) <= {*targets, "and"}


def test_readme_picture_is_small() -> None:
    [picture] = re.findall(r"!\[[^]]*\]\(([^)]+\.png)\)", README)
    assert (ROOT / picture).stat().st_size < 400_000


def test_contributing_shows_every_room_and_names_files_that_exist() -> None:
    said = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    for name in re.findall(r"`((?:\w+/)*\w+\.(?:py|md|toml|svg))`", said):
        assert (ROOT / name).exists() or (ROOT / "graphnav" / name).exists(), name
    drawn = (ROOT / "docs" / "rooms.svg").read_text(encoding="utf-8")
    rooms = {f.parent.name for f in (ROOT / "graphnav").glob("*/__init__.py")} | {"factors"}
    assert len(rooms) > 10
    for room in rooms:
        assert re.search(rf">[^<]*\b{room}\b[^<]*<", drawn), room
