"""Fixes withheld in turn: the promise of a path held against what was found."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from smoothing import QUICK, command

from graphnav.common.errors import InputError
from graphnav.pipeline import solve
from graphnav.reading.read import read_run
from graphnav.reading.vehicle_file import load_vehicle
from graphnav.result import withheld
from graphnav.result.solved import Solved
from graphnav.result.withheld import Promise
from graphnav.simulation import simulate
from graphnav.validation import validate


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated car with fixes."""
    where = tmp_path_factory.mktemp("withheld") / "drive"
    simulate("wheeled", where, 6, grade="mems", duration=180, gnss=True)
    return where / "run.csv.gz"


@pytest.fixture(scope="module")
def solved(drive: Path) -> Solved:
    """The drive, smoothed with all fixes."""
    vehicle = load_vehicle(None, drive)
    return solve(read_run(drive, vehicle), vehicle)


def test_blocks_leave_fixes_at_both_ends_and_between() -> None:
    time = np.arange(0.0, 400.0)
    held = withheld.blocks(time, 60.0)
    assert held == [(60.0, 120.0), (180.0, 240.0), (300.0, 360.0)]
    assert withheld.blocks(time, 10.0)[:2] == [(60.0, 70.0), (100.0, 110.0)]
    assert withheld.blocks(time[time < 60], 10.0) == []
    assert (180.0, 240.0) not in withheld.blocks(time[(time < 150) | (time > 250)], 60.0)


def test_a_promise_follows_the_path_it_is_held_against(solved: Solved) -> None:
    """A path moved by 30 m is off by 30 m more, with the same promise."""
    fixes, held = withheld.believed(solved), [(70.0, 130.0)]
    here = withheld.promise(solved, fixes, held, 60.0)
    moved = replace(
        solved, path=replace(solved.path, p_n=solved.path.p_n + np.array([30.0, 0.0, 0.0]))
    )
    there = withheld.promise(moved, fixes, held, 60.0)
    assert here is not None and there is not None
    assert there.promised_m == pytest.approx(here.promised_m)
    assert there.found_m == pytest.approx(np.hypot(30.0, here.found_m), abs=4.0)
    assert here.inside_95 > 0.8 and there.inside_95 < 0.1
    assert withheld.promise(solved, fixes, [(1e4, 2e4)], 60.0) is None


def test_every_fix_has_its_own_weight_however_late_the_receiver(solved: Solved) -> None:
    """A delay found that is not taken off the fixes' times moves none to its neighbour."""
    late = [
        replace(c, value=np.full_like(c.value, 0.015)) if c.name == "gnss_time_offset_s" else c
        for c in solved.calibrated
    ]
    assert withheld.delay(replace(solved, calibrated=late)) == pytest.approx(0.015)
    there, here = withheld.believed(replace(solved, calibrated=late)), withheld.believed(solved)
    np.testing.assert_array_equal(there.time, here.time)
    assert here.doubted == there.doubted


def test_a_receivers_caution_is_no_merit_of_the_path(solved: Solved) -> None:
    careful = [
        replace(b, residual=b.residual / 3, sigma=3 * b.sigma)
        if b.kind == "gnss" and b.sigma is not None
        else b
        for b in solved.blocks
    ]
    here, there = withheld.believed(solved), withheld.believed(replace(solved, blocks=careful))
    np.testing.assert_allclose(there.sd_en, here.sd_en)


def test_bold_and_careful_deviations_are_told() -> None:
    honest = Promise(60.0, 3, 180, 2.0, 5.0, 2.1, 1.0, 0.94)
    assert withheld.in_words([honest]).endswith("honest")
    assert "too much (by 2 times)" in withheld.in_words([replace(honest, promised_m=1.0)])
    assert "too careful (by 3 times)" in withheld.in_words([replace(honest, promised_m=6.0)])


def test_the_command_keeps_what_it_found(drive: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command("validate", drive) == 0
    beside = json.loads((drive.parent / "run_validation.json").read_text())
    assert [b["block_s"] for b in beside["blocks"]] == [10.0, 30.0, 60.0]
    assert beside["said"] in capsys.readouterr().out
    assert command("smooth", drive, *QUICK) == 0
    kept = drive.parent / "run_graphnav"
    vehicle = drive.parent / "vehicle.toml"
    said, file = validate(drive, vehicle, kept, lengths=(30.0,))
    assert file == kept / "validation.json" and json.loads(file.read_text()) == said
    assert command("smooth", drive, *QUICK) == 0  # what validate left is replaced with the rest


def test_a_run_without_fixes_is_refused(drive: Path, tmp_path: Path) -> None:
    text = (drive.parent / "vehicle.toml").read_text()
    (tmp_path / "vehicle.toml").write_text(text.replace("[gnss]", "[gnss]\nuse = false"))
    with pytest.raises(InputError, match="fixes in use"):
        validate(drive, tmp_path / "vehicle.toml", tmp_path)
