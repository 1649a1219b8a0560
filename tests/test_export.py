"""Exports read back with the libraries their users have, at the IMU and at a lever arm."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import result_maker
from hypothesis import given
from hypothesis import strategies as st

from graphnav import export
from graphnav.common.errors import InputError
from graphnav.export.nmea import each_second
from graphnav.export.tables import SBET_FIELDS
from graphnav.result import palette
from graphnav.result import result_directory as results

LEVER_B = (0.3, -1.0, 0.8)


@pytest.fixture(scope="module")
def loaded(tmp_path_factory: pytest.TempPathFactory) -> results.Results:
    directory = tmp_path_factory.mktemp("r") / "run_graphnav"
    return results.load(result_maker.write(directory, duration=300.0))


def written(loaded: results.Results, fmt: str, tmp_path: Path, at_b: tuple | None = None) -> Path:
    path = tmp_path / f"out{export.SUFFIX[fmt]}"
    export.write(loaded, fmt, path, at_b)
    assert [p.name for p in tmp_path.iterdir()] == [path.name]
    return path


def test_lever_arm_turns_with_the_vehicle(loaded: results.Results) -> None:
    ahead = export.track(loaded, (0.0, 5.0, 0.0)).p_n - loaded.p_n
    np.testing.assert_allclose(np.linalg.norm(ahead, axis=1), 5.0, rtol=1e-12)
    heading = np.degrees(np.arctan2(ahead[:, 0], ahead[:, 1]))
    apart = (heading - loaded.trajectory["heading_deg"] + 180.0) % 360.0 - 180.0
    assert np.abs(apart).max() < 0.02  # convergence of meridians over 2 km
    pitch = np.degrees(np.arcsin(ahead[:, 2] / 5.0))
    np.testing.assert_allclose(pitch, loaded.trajectory["pitch_deg"], atol=0.03)
    right = export.track(loaded, (2.0, 0.0, 0.0)).p_n - loaded.p_n
    down = -np.degrees(np.arcsin(right[:, 2] / 2.0))
    np.testing.assert_allclose(down, loaded.trajectory["roll_deg"], atol=0.03)


def test_velocity_at_the_lever_arm_is_the_path_s_slope(loaded: results.Results) -> None:
    lever_b = (0.5, 40.0, 1.0)  # long, so that turning shows
    moved, still = export.track(loaded, lever_b), export.track(loaded)
    slope = np.gradient(moved.p_n - still.p_n, loaded.time, axis=0)
    np.testing.assert_allclose((moved.v_l - still.v_l)[1:-1], slope[1:-1], atol=0.02)
    assert np.abs(moved.v_l - still.v_l).max() > 2.0


def test_geodetic_places_follow_the_local_ones(loaded: results.Results) -> None:
    moved = export.track(loaded, LEVER_B)
    lat, lon = np.radians(moved.lat_deg), np.radians(moved.lon_deg)
    back = loaded.origin.local(lat, lon, moved.height)
    np.testing.assert_allclose(back, moved.p_n, atol=1e-6)
    there = export.track(loaded)
    np.testing.assert_array_equal(there.lat_deg, loaded.trajectory["lat"])


def test_sbet_is_17_doubles_in_radians(loaded: results.Results, tmp_path: Path) -> None:
    path = written(loaded, "sbet", tmp_path)
    assert path.stat().st_size == len(loaded.time) * 17 * 8
    record = dict(zip(SBET_FIELDS, np.fromfile(path, "<f8").reshape(-1, 17).T, strict=True))
    table = loaded.trajectory
    np.testing.assert_array_equal(record["time"], table["time"])
    angles = {"lat": "lat", "lon": "lon"} | {k: f"{k}_deg" for k in ("roll", "pitch", "heading")}
    for name, column in angles.items():
        np.testing.assert_allclose(np.degrees(record[name]), table[column], rtol=1e-14)
    for name, column, sign in (("height", "height", 1), ("v_north", "v_n", 1), ("v_east", "v_e", 1),
                               ("v_down", "v_u", -1)):  # fmt: skip
        np.testing.assert_array_equal(sign * record[name], table[column])
    assert not record["wander"].any()
    turn = np.degrees(np.gradient(np.unwrap(record["heading"]), record["time"]))
    np.testing.assert_allclose(np.degrees(record["w_down"])[1:-1], turn[1:-1], atol=0.02)
    forward = np.gradient(table["v_y"], record["time"])
    straight = np.abs(turn) < 0.01
    np.testing.assert_allclose(
        record["a_forward"][straight][2:-2], forward[straight][2:-2], atol=0.3
    )


def test_tum_reads_back(loaded: results.Results, tmp_path: Path) -> None:
    rows = np.loadtxt(written(loaded, "tum", tmp_path, LEVER_B))
    np.testing.assert_allclose(rows[:, 0], loaded.time, atol=1e-9)
    np.testing.assert_allclose(rows[:, 1:4], export.track(loaded, LEVER_B).p_n, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(rows[:, 4:], axis=1), 1.0, atol=1e-11)


def test_evo_accepts_the_tum_file(loaded: results.Results, tmp_path: Path) -> None:
    interface = pytest.importorskip("evo.tools.file_interface", reason="evo is not installed")
    path = interface.read_tum_trajectory_file(written(loaded, "tum", tmp_path))
    valid, details = path.check()
    assert valid, details
    assert path.num_poses == len(loaded.time)
    steps = np.linalg.norm(np.diff(loaded.p_n, axis=0), axis=1).sum()
    assert path.path_length == pytest.approx(steps, rel=1e-4)


def test_csv_keeps_the_columns(loaded: results.Results, tmp_path: Path) -> None:
    back = pd.read_csv(written(loaded, "csv", tmp_path))
    pd.testing.assert_frame_equal(back, loaded.trajectory, rtol=0, atol=0, check_dtype=False)


def test_kml_is_absolute_and_complete(loaded: results.Results, tmp_path: Path) -> None:
    from fastkml import KML
    from fastkml.enums import AltitudeMode

    document = KML.parse(written(loaded, "kml", tmp_path)).features[0]
    marks = [mark for folder in document.features for mark in folder.features]
    assert {m.kml_geometry.altitude_mode for m in marks} == {AltitudeMode.absolute}
    assert len(marks) == len(results.state_spans(loaded))
    places = np.vstack([m.geometry.coords for m in marks])
    lon, lat, height = places.T
    assert lon.min() == pytest.approx(loaded.trajectory["lon"].min(), abs=1e-9)
    assert lat.max() == pytest.approx(loaded.trajectory["lat"].max(), abs=1e-9)
    assert height.min() == pytest.approx(loaded.trajectory["height"].min(), abs=1e-4)
    assert len(places) >= len(loaded.time)
    style = next(s for s in document.styles if s.id == "stop").styles[0]
    red, green, blue = palette.rgb(palette.MOTION["stop"])
    assert style.color == f"ff{blue:02x}{green:02x}{red:02x}"


def test_geojson_lines_are_the_states(loaded: results.Results, tmp_path: Path) -> None:
    document = json.loads(written(loaded, "geojson", tmp_path).read_text())
    assert document["type"] == "FeatureCollection"
    spans = results.state_spans(loaded)
    assert [f["properties"]["state"] for f in document["features"]] == [s for s, _, _ in spans]
    first = document["features"][0]["geometry"]["coordinates"][0]
    expected = loaded.trajectory.loc[0, ["lon", "lat", "height"]].to_numpy(float)
    np.testing.assert_allclose(first[:2], expected[:2], atol=1e-9)
    np.testing.assert_allclose(first[2], expected[2], atol=1e-4)


def test_gpx_reads_back(loaded: results.Results, tmp_path: Path) -> None:
    import gpxpy

    document = gpxpy.parse(written(loaded, "gpx", tmp_path).read_text())
    points = document.tracks[0].segments[0].points
    assert len(points) == len(loaded.time)
    np.testing.assert_allclose([p.latitude for p in points], loaded.trajectory["lat"], atol=1e-9)
    np.testing.assert_allclose(
        [p.elevation for p in points], loaded.trajectory["height"], atol=1e-4
    )
    assert (points[-1].time - points[0].time).total_seconds() == pytest.approx(300.0)


def test_nmea_reads_back(loaded: results.Results, tmp_path: Path) -> None:
    from pynmeagps import NMEAReader

    with written(loaded, "nmea", tmp_path).open("rb") as stream:
        sentences = [parsed for _, parsed in NMEAReader(stream, quitonerror=2)]
    places = [s for s in sentences if s.msgID == "GGA"]
    assert len(places) == 301 and len(sentences) == 602
    table = loaded.trajectory.iloc[::10]
    np.testing.assert_allclose([p.lat for p in places], table["lat"], atol=2e-9)
    np.testing.assert_allclose([p.lon for p in places], table["lon"], atol=2e-9)
    np.testing.assert_allclose([p.alt for p in places], table["height"], atol=1e-4)
    assert {p.quality for p in places} == {6}
    headings = [s.headingT for s in sentences if s.msgID == "HDT"]
    np.testing.assert_allclose(headings, table["heading_deg"], atol=1e-4)


@given(st.floats(0, 1e9), st.floats(0.01, 0.9))
def test_every_second_once(start: float, step: float) -> None:
    time = start + step * np.arange(200)
    seconds = np.floor(time[each_second(time)] + 1e-6)
    assert np.array_equal(seconds, np.unique(np.floor(time + 1e-6)))


def test_an_unknown_format_names_the_nearest(loaded: results.Results, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="did you mean geojson"):
        export.write(loaded, "geojsn", tmp_path / "x")
    assert not list(tmp_path.iterdir())


def test_heavy_libraries_are_imported_only_where_used() -> None:
    code = "import sys, graphnav.export; from graphnav.views import recording, report, show;"
    code += (
        "print([m for m in ('rerun','pandas','matplotlib','fastkml','jinja2') if m in sys.modules])"
    )
    root = Path(__file__).parents[1]
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=root, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"
