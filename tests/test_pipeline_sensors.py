"""`graphnav smooth` when sensors lie, fall silent or are not there; a car with a MEMS IMU."""

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from smoothing import QUICK, Table, changed, command, smoothed, summary, trajectory

from graphnav.simulation import simulate


@pytest.fixture(scope="module")
def car(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A car with a speed column, MEMS IMU, a side slip at 400 s; 430 s.

    Its heading at the start, which such an IMU cannot find, is stated truly.
    """
    directory = simulate("slip", tmp_path_factory.mktemp("c") / "run", 22, duration=430)
    true = json.loads((directory / "truth_calibration.json").read_text())["start_heading_deg"]
    vehicle = directory / "vehicle.toml"
    stated = re.sub(r"heading_deg = .+", f"heading_deg = {true}", vehicle.read_text(), count=1)
    vehicle.write_text(stated)
    return directory


def blanked(column: str, start: float, end: float) -> Callable[[Table], Table]:
    """No samples of a column between two times."""
    return lambda t: t.assign(**{column: t[column].where((t["time"] < start) | (t["time"] > end))})


def imu_blanked(table: Table, start: float, end: float) -> Table:
    """No inertial samples between two times."""
    inside = table["time"].between(start, end)
    sensors = [f"{sensor}_{axis}" for sensor in ("gyro", "accel") for axis in "xyz"]
    return table.assign(**{name: table[name].where(~inside) for name in sensors})


def test_a_car_slides_and_stays_on_its_path(car: Path) -> None:
    """MEMS IMU, no fixes; the slip of 5 m/s at 400 s would alone throw it 12 m aside."""
    result = smoothed(car, *QUICK)
    assert summary(result)["comparison"]["horizontal_max_m"] < 10.0
    events = pd.read_csv(result / "events.csv")
    slip = events[(events["start"] < 405) & (events["end"] > 400)]
    assert list(slip["kind"]) == ["side_slip"]
    assert abs(abs(slip["peak_velocity"].iloc[0]) - 5) < 1.5
    table = trajectory(result)
    inside = table[table["time"].between(401.5, 403.5)]
    assert inside["w_x"].max() < 0.3
    assert inside["w_y"].mean() > 0.5  # the forward speed is kept


def test_driving_backwards(car: Path, tmp_path: Path) -> None:
    """The same drive with the IMU turned about: the odometer is negative, the path the same."""

    def turned(table: Table) -> Table:
        flipped = ["gyro_x", "gyro_y", "accel_x", "accel_y", "odo_speed"]
        return table.assign(**{name: -table[name] for name in flipped})

    def facing_back(text: str) -> str:
        heading = float(re.findall(r"heading_deg = (.+)", text)[0])
        return re.sub(r"heading_deg = .+", f"heading_deg = {(heading + 180) % 360}", text, count=1)

    table = trajectory(smoothed(changed(car, tmp_path, turned, facing_back), *QUICK))
    forward = trajectory(smoothed(car, *QUICK))
    np.testing.assert_allclose(table[["e", "n"]], forward[["e", "n"]], atol=0.1)
    assert table["v_y"].min() < -5
    assert table["v_y"].max() < 0.5


@pytest.mark.parametrize(
    ("what", "change", "metres"),
    [
        ("odometer silent for 30 s", blanked("odo_speed", 200, 230), 10.0),
        ("odometer stuck at zero for 20 s", None, 15.0),
        ("one speed a second", lambda t: t.assign(odo_speed=t["odo_speed"][99::100]), 10.0),
        ("odometer from 120 s on only", blanked("odo_speed", -1, 120), 30.0),
        # 25 m, told +- 78: the turn such a gap may hide is doubted since gaps are bridged
        ("IMU silent for 3 s", lambda t: imu_blanked(t, 250, 253), 30.0),
        ("no odometer at all", lambda t: t.drop(columns="odo_speed"), 15.0),
    ],
)
def test_less_odometer(
    car: Path, tmp_path: Path, what: str, change: Callable[[Table], Table] | None, metres: float
) -> None:
    def stuck(table: Table) -> Table:
        span = table["time"].between(200, 220) & table["odo_speed"].notna()
        return table.assign(odo_speed=table["odo_speed"].mask(span, 0.0))

    found = summary(smoothed(changed(car, tmp_path, change or stuck), *QUICK))
    assert found["comparison"]["horizontal_max_m"] < metres, what
    assert found["comparison"]["nees_horizontal"] < 6.0, what
    assert found["warnings"] or change is None or "second" in what


def test_fixes_without_odometer_and_without_a_stated_start(
    tmp_path_factory: pytest.TempPathFactory, tmp_path: Path
) -> None:
    """Begun on the move, held by GNSS and the non-holonomic constraint alone."""
    source = simulate("slip", tmp_path_factory.mktemp("g") / "run", 23, duration=250, gnss=True)
    late = changed(
        source,
        tmp_path,
        lambda t: t[t["time"] > 80].drop(columns="odo_speed"),
        lambda text: text.split("[start]")[0],
    )
    found = summary(smoothed(late, *QUICK))
    assert found["comparison"]["horizontal_max_m"] < 3.0
    assert found["solver"]["heading_source"] == "satellite course"


def test_faulty_input_ends_with_two_and_writes_nothing(
    car: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    short = pd.read_csv(car / "run.csv.gz", nrows=20000)
    text = short.astype({"gyro_x": object})
    text.loc[500:800, "gyro_x"] = "n/a?"
    back = short.assign(time=short["time"].where(short.index < 700, short["time"] - 1.0))
    cases = {
        "gyro_z": short.drop(columns="gyro_z"),
        "n/a?": text,
        "backwards": back,
        "no rows": short.iloc[:0],
    }
    (tmp_path / "vehicle.toml").write_text((car / "vehicle.toml").read_text())
    for part, table in cases.items():
        table.to_csv(tmp_path / "run.csv", index=False)
        assert command("smooth", tmp_path / "run.csv") == 2, part
        out, err = capsys.readouterr()
        assert (out, err.count("\n")) == ("", 1), part
        assert part in err
        assert "run.csv" in err
    assert {path.name for path in tmp_path.iterdir()} == {"run.csv", "vehicle.toml"}


def test_gyros_in_degrees_whose_noise_hides_the_rest_are_named(
    car: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """No rest tells the unit of such gyros before the solution does: rejected, cause and cure."""
    short = changed(car, tmp_path, lambda t: in_degrees(t[:14000]))
    assert command("smooth", short / "run.csv", *QUICK) == 3
    message = capsys.readouterr().err
    assert message.count("\n") == 1 and "the gyros are in deg/s, not in rad/s" in message


def in_degrees(table: pd.DataFrame) -> pd.DataFrame:
    """Gyros in another unit than the vehicle file says."""
    return table.assign(**{f"gyro_{a}": np.rad2deg(table[f"gyro_{a}"]) for a in "xyz"})


def test_no_start_and_no_fix_is_said(
    car: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    nowhere = changed(car, tmp_path, lambda t: t[:20000], lambda text: text.split("[start]")[0])
    assert command("smooth", nowhere / "run.csv") == 2
    assert "[start]" in capsys.readouterr().err
