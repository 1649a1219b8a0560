"""run.rrd read back: entities, rows, values, layout; optional files absent; long runs thinned."""

import shutil
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import result_maker

from graphnav.result import palette
from graphnav.result import result_directory as results
from graphnav.views import recording
from graphnav.views.recording import paths, scalars
from graphnav.views.recording.entry import SERIES_LIMIT
from graphnav.views.recording.map import zoom

pytest.importorskip("rerun")
from rerun.chunk import RrdReader

pytestmark = pytest.mark.filterwarnings("error::rerun.error_utils.RerunWarning")


@pytest.fixture(scope="module")
def loaded(tmp_path_factory: pytest.TempPathFactory) -> results.Results:
    return results.load(result_maker.write(tmp_path_factory.mktemp("r") / "run_graphnav"))


@pytest.fixture(scope="module")
def rrd(loaded: results.Results, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("rrd") / "run.rrd"
    recording.write(loaded, path)
    return path


def chunks(path: Path, entity: str, component: str) -> Iterator[dict[str, list]]:
    store = RrdReader(path).store()
    for chunk in store.stream().filter(content=entity, components=component):
        yield chunk.to_record_batch().to_pydict()


def column(path: Path, entity: str, component: str) -> tuple[np.ndarray, list]:
    """Times [s] and cells of one component over time."""
    parts = [c for c in chunks(path, entity, component) if "time" in c]
    assert parts, f"{entity} has no {component} over time"
    times = [
        t.total_seconds() if hasattr(t, "total_seconds") else t for p in parts for t in p["time"]
    ]
    return np.array(times, float), [v for p in parts for v in p[component]]


def entities(path: Path) -> set[str]:
    return set(RrdReader(path).store().schema().entity_paths())


def test_every_entity_is_there(rrd: Path) -> None:
    axes = [f"/calibration/gyro_bias_deg_h/{k}" for k in "xyz"]
    factors = [f"/calibration/forward_factor/{s}" for s in result_maker.TURNS]
    lanes = ["/state/motion", "/state/motion_true", "/state/slip/side_slip", "/state/slip/hop"]
    world = [
        "smoothed",
        "dead_reckoning",
        "truth",
        "incremental",
        "gnss",
        "ellipses_3sigma",
        "vehicle",
    ]
    plots = [
        *(f"/velocity/forward/{k}" for k in ("smoothed", "odometer", "odometer_raw")),
        *("/velocity/lateral/odometer", "/error/east", "/error/heading", "/weights/velocity"),
        *("/residuals/odometer/y", "/residuals/odometer/down_weighted", "/summary"),
    ]
    maps = ["/map/smoothed", "/map/gnss", "/map/vehicle"]
    wanted = {*axes, *factors, *lanes, *plots, *maps, *(f"/world/{w}" for w in world)}
    assert wanted <= entities(rrd)


def test_velocity_comes_back_exactly(rrd: Path, loaded: results.Results) -> None:
    at, value = column(rrd, "/velocity/forward/smoothed", "Scalars:scalars")
    assert len(at) == 40001
    np.testing.assert_allclose(at, loaded.time - result_maker.CLOCK_START, atol=1e-6, rtol=0)
    np.testing.assert_array_equal(np.ravel(value), loaded.trajectory["v_y"])


def test_discarded_odometer_stays_a_gap(rrd: Path, loaded: results.Results) -> None:
    _, value = column(rrd, "/velocity/forward/odometer", "Scalars:scalars")
    assert loaded.odometer is not None
    np.testing.assert_array_equal(np.ravel(value), loaded.odometer["v_y"])
    assert np.isnan(np.ravel(value)).sum() > 100


def test_vehicle_moves_along_the_path(rrd: Path, loaded: results.Results) -> None:
    _, place = column(rrd, "/world/vehicle", "Transform3D:translation")
    np.testing.assert_array_equal(np.squeeze(place), loaded.p_n.astype(np.float32))
    _, turned = column(rrd, "/world/vehicle", "Transform3D:quaternion")
    x, y, z, w = np.squeeze(turned).T
    forward_n = np.stack([2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)], -1)
    heading = np.degrees(np.arctan2(forward_n[:, 0], forward_n[:, 1]))
    apart = (heading - loaded.trajectory["heading_deg"] + 180) % 360 - 180
    assert np.abs(apart).max() < 0.2  # meridians converge over a few km, axes do not swap


def test_path_strips_carry_the_state_colours(rrd: Path, loaded: results.Results) -> None:
    cell = next(chunks(rrd, "/world/smoothed", "LineStrips3D:colors"))["LineStrips3D:colors"][0]
    spans = results.state_spans(loaded)
    assert list(cell) == [palette.rgba32(palette.motion(state)) for state, _, _ in spans]
    strips = next(chunks(rrd, "/world/smoothed", "LineStrips3D:strips"))["LineStrips3D:strips"][0]
    ends = [strip[-1] for strip in strips[:-1]]
    np.testing.assert_array_equal(ends, [strip[0] for strip in strips[1:]])  # no gaps


def test_timeline_lanes(rrd: Path, loaded: results.Results) -> None:
    at, state = column(rrd, "/state/motion", "StateChange:state")
    assert [s[0] for s in state] == list(loaded.states["state"])
    np.testing.assert_allclose(at, loaded.states["start"] - result_maker.CLOCK_START, atol=1e-6)
    at, state = column(rrd, "/state/slip/hop", "StateChange:state")
    assert loaded.events is not None
    hops = loaded.events[loaded.events["kind"] == "hop"]
    assert [s[0] for s in state] == ["hop", ""] * len(hops)
    np.testing.assert_allclose(at[1::2] - at[::2], 1.5, atol=1e-6)
    _, true = column(rrd, "/state/motion_true", "StateChange:state")
    assert len(true) <= len(loaded.states)


def test_bands_are_three_sigma(rrd: Path, loaded: results.Results) -> None:
    curve = loaded.calibration["odometer_scale"]
    at, variance = column(rrd, "/calibration/odometer_scale/scale", "Measurements:variances")
    np.testing.assert_allclose(np.ravel(variance), (3 * 0.0004) ** 2)
    _, value = column(rrd, "/calibration/odometer_scale/scale", "Measurements:values")
    np.testing.assert_allclose(
        np.ravel(value), np.interp(at + result_maker.CLOCK_START, curve.time, curve.value[:, 0])
    )


def test_errors_are_smoothed_minus_truth(rrd: Path, loaded: results.Results) -> None:
    _, value = column(rrd, "/error/north", "Measurements:values")
    assert loaded.truth is not None
    np.testing.assert_allclose(
        np.ravel(value), loaded.trajectory["n"] - loaded.truth["n"], atol=1e-9
    )
    _, heading = column(rrd, "/error/heading", "Measurements:values")
    np.testing.assert_allclose(np.ravel(heading), -0.008, atol=1e-9)


def test_down_weighted_marks_are_the_down_weighted_rows(rrd: Path, loaded: results.Results) -> None:
    assert loaded.residuals is not None
    of_kind = loaded.residuals[loaded.residuals["kind"] == "odometer"]
    down = of_kind[of_kind["weight"] < 0.5]
    _, value = column(rrd, "/residuals/odometer/down_weighted", "Scalars:scalars")
    assert sorted(np.ravel(value)) == sorted(down["value"])
    assert 0 < len(down) < len(of_kind) / 50


def test_layout_names_only_entities_that_exist(rrd: Path) -> None:
    reader, known = RrdReader(rrd), entities(rrd)
    (blueprint,) = reader.blueprints()
    cells = [c.to_record_batch().to_pydict() for c in reader.store(store=blueprint).stream()]
    origins = [v[0] for c in cells for v in c.get("ViewBlueprint:space_origin", []) if v]
    classes = [v[0] for c in cells for v in c.get("ViewBlueprint:class_identifier", []) if v]
    names = [v[0] for c in cells for v in c.get("ViewBlueprint:display_name", []) if v]
    assert {"3D", "Map", "TimeSeries", "TextDocument"} <= set(classes)
    assert {"Overview", "Follow", "Motion state", "Forward [m/s]", "Arc turn"} <= set(names)
    spaces = {str(parent) for e in known for parent in Path(e).parents} | known
    assert len(origins) == len(classes) and set(origins) <= spaces


def test_uncertainty_ellipses_match_the_covariance(loaded: results.Results) -> None:
    rows = np.array([5000, 20000])
    P = paths.covariances(loaded, rows)
    table = loaded.trajectory.iloc[rows]
    np.testing.assert_allclose(np.sqrt(P[:, 0, 0]), table["sd_e"])
    np.testing.assert_allclose(P[:, 0, 1], table["corr_en"] * table["sd_e"] * table["sd_n"])
    assert paths.exaggeration(loaded) * 3 * 1.6 < 0.021 * np.ptp(loaded.p_n[:, :2], axis=0).max()


def test_fast_and_small(loaded: results.Results, tmp_path: Path) -> None:
    start = time.process_time()  # other work on the machine does not count
    recording.write(loaded, tmp_path / "run.rrd")
    assert time.process_time() - start < 1.5
    assert (tmp_path / "run.rrd").stat().st_size < 20e6
    assert [p.name for p in tmp_path.iterdir()] == ["run.rrd"]


def test_a_long_run_is_thinned_but_keeps_its_spikes(loaded: results.Results) -> None:
    import pandas as pd

    count = 400_000
    value = np.zeros(count)
    value[123_457], value[300_001] = 25.0, -31.0
    table = pd.DataFrame({"time": np.arange(count) * 0.1, "value": value})
    rows = scalars._spikes(table)
    assert len(rows) <= SERIES_LIMIT + 2
    assert {123_457, 300_001} <= set(rows.tolist())
    kept = results.thin(count, SERIES_LIMIT)
    assert len(kept) <= SERIES_LIMIT and kept[0] == 0 and kept[-1] == count - 1


def test_only_the_required_files(tmp_path: Path) -> None:
    directory = result_maker.write(tmp_path / "r", duration=100.0)
    for path in directory.iterdir():
        if path.name not in result_maker.REQUIRED:
            path.unlink()
    recording.write(results.load(directory), tmp_path / "run.rrd")
    there = entities(tmp_path / "run.rrd")
    assert "/world/smoothed" in there
    assert not [
        e for e in there if e.startswith(("/error", "/residuals", "/world/truth", "/state/slip"))
    ]


@pytest.mark.parametrize("name", result_maker.REQUIRED)
def test_a_missing_required_file_is_one_line(tmp_path: Path, name: str) -> None:
    from graphnav.common.errors import InputError

    directory = result_maker.write(tmp_path / "r", duration=20.0)
    (directory / name).unlink()
    with pytest.raises(InputError, match=name) as fault:
        results.load(directory)
    assert "\n" not in str(fault.value)


def test_a_column_short_is_named(tmp_path: Path) -> None:
    import pandas as pd

    from graphnav.common.errors import InputError

    directory = result_maker.write(tmp_path / "r", duration=20.0)
    table = pd.read_parquet(directory / "trajectory.parquet").drop(columns="sd_n")
    table.to_parquet(directory / "trajectory.parquet")
    with pytest.raises(InputError, match="sd_n"):
        results.load(directory)


def test_rerun_off_is_said(
    loaded: results.Results, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from graphnav.common.errors import SolutionError

    monkeypatch.setenv("RERUN", "off")
    with pytest.raises(SolutionError, match="RERUN"):
        recording.write(loaded, tmp_path / "run.rrd")


def test_map_zoom_shows_the_whole_run(loaded: results.Results) -> None:
    degrees_across = 360.0 * 450 / 256 / 2.0 ** zoom(loaded)
    assert degrees_across >= 0.999 * np.ptp(loaded.trajectory["lon"])
    assert degrees_across <= 4 * max(
        np.ptp(loaded.trajectory["lon"]), np.ptp(loaded.trajectory["lat"])
    )


def test_a_run_id_becomes_an_id_the_viewer_accepts(loaded: results.Results, tmp_path: Path) -> None:
    directory = tmp_path / "r"
    shutil.copytree(loaded.directory, directory)
    changed = (directory / "summary.json").read_text().replace('"run-001"', '"Läufe/7.b"')
    (directory / "summary.json").write_text(changed)
    assert recording.application_id(results.load(directory)) == "graphnav L-ufe-7"
