"""report.html: one self-contained page whose words, tables and drawings come from the results."""

import json
import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path

import pytest
import result_maker

from graphnav.result import palette
from graphnav.result import result_directory as results
from graphnav.views import report, show
from graphnav.views.report import svg, tables

VOID = {"meta", "link", "br", "img", "input", "hr"}


@pytest.fixture(scope="module")
def directory(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return result_maker.write(tmp_path_factory.mktemp("r") / "run_graphnav", duration=600.0)


@pytest.fixture(scope="module")
def page(directory: Path) -> str:
    path = directory.parent / "report.html"
    report.write(results.load(directory), path)
    return path.read_text(encoding="utf-8")


class Outline(HTMLParser):
    """Open tags, addresses and visible text; complains about tags that close out of order."""

    def __init__(self) -> None:
        super().__init__()
        self.stack: list[str] = []
        self.tags: list[str] = []
        self.addresses: list[str] = []
        self.words: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        wanted = ("src", "href", "xlink:href")
        self.addresses += [value or "" for name, value in attrs if name in wanted]
        if tag not in VOID:
            self.stack.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.stack.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.stack.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words.append(data.strip())


def outline(page: str) -> Outline:
    parsed = Outline()
    parsed.feed(page)
    assert parsed.stack == []
    return parsed


def test_self_contained_and_well_formed(page: str) -> None:
    parsed = outline(page)
    assert "script" not in parsed.tags
    assert all(a.startswith(("#", "data:")) for a in parsed.addresses), parsed.addresses
    assert "@import" not in page
    assert len(page) < 3e6


def test_every_part_is_there(page: str) -> None:
    words = outline(page).words
    for heading in ("Verdict", "Trajectory", "Motion states", "Velocity", "Error against truth",
                    "Calibration over time", "Factors by motion state", "Residuals", "Calibration",
                    "Slip events"):  # fmt: skip
        assert heading in words
    for sentence in ("odometer scale drifted 4.8 permille", "GNSS disagreed 1640-1800 s"):
        assert sentence in words
    assert any("lever arm z not observable" in w for w in words)
    assert page.count("<svg") == 7


def test_axes_have_units(page: str) -> None:
    words = outline(page).words
    for label in ("east [m]", "north [m]", "time since start [s]", "[m/s]", "[deg]",
                  "Gyro bias, x [deg/h]", "residual [σ]"):  # fmt: skip
        assert label in words, label


def test_ink_follows_the_page_and_states_keep_their_colours(page: str) -> None:
    assert not re.search("|".join(svg.THEMED), page)
    assert "var(--ink)" in page and "prefers-color-scheme: dark" in page and "@media print" in page
    for state in ("straight_high", "stop", "turn_arc"):
        assert (
            f"stroke: {palette.MOTION[state]}" in page or f"fill: {palette.MOTION[state]}" in page
        )


def test_state_table_adds_up(directory: Path) -> None:
    loaded = results.load(directory)
    rows = tables.states(loaded)
    assert sum(int(r["count"]) for r in rows) == len(loaded.states)
    assert sum(float(r["seconds"]) for r in rows) == pytest.approx(600.0, abs=0.1 * len(rows))
    assert sum(float(r["share"].rstrip(" %")) for r in rows) == pytest.approx(100.0, abs=0.5)


def test_calibration_table_rounds_to_its_sigma(directory: Path) -> None:
    rows = {row["name"]: row for row in tables.calibration(results.load(directory))}
    assert rows["Lever arm, z"]["observable"] == "no"
    assert rows["Forward factor, arc turn"]["value"] == "0.869"
    assert rows["Odometer scale"]["value"] == "1.0020 to 1.0068"
    assert rows["Odometer scale"]["sd"] == "± 0.0012"


def test_only_the_required_files_and_hostile_words(directory: Path, tmp_path: Path) -> None:
    bare = tmp_path / "bare"
    bare.mkdir()
    for name in result_maker.REQUIRED:
        shutil.copy(directory / name, bare)
    summary = json.loads((bare / "summary.json").read_text())
    summary |= {"run": "<script>x</script>", "verdicts": ["1 < 2 & 3"]}
    for key in ("comparison", "stages", "warnings", "origin"):
        del summary[key]
    (bare / "summary.json").write_text(json.dumps(summary))
    html = report.page(results.load(bare))
    parsed = outline(html)
    assert "script" not in parsed.tags and "1 < 2 & 3" in parsed.words
    assert "Error against truth" not in parsed.words and "Slip events" not in parsed.words
    assert "Trajectory" in parsed.words


def test_many_events_are_cut_and_counted(directory: Path, tmp_path: Path) -> None:
    many = tmp_path / "many"
    shutil.copytree(directory, many)
    rows = "".join(f"{1200 + k},{1200.5 + k},hop,z,0.2\n" for k in range(250))
    (many / "events.csv").write_text("start,end,kind,axis,peak_velocity\n" + rows)
    html = report.page(results.load(many))
    assert "50 more in events.csv" in html


def test_matplotlib_settings_of_the_caller_stay(directory: Path) -> None:
    import matplotlib

    before = dict(matplotlib.rcParams)
    report.page(results.load(directory))
    assert dict(matplotlib.rcParams) == before


def test_envelope_keeps_spikes_and_gaps() -> None:
    import numpy as np

    time = np.arange(100_000) * 0.1
    value = np.zeros_like(time)
    value[43_210], value[50_000:60_000] = 7.0, np.nan
    t, v = svg.envelope(time, value)
    assert len(t) == len(v) <= 2 * svg.POINTS
    assert np.nanmax(v) == 7.0
    gap = t[np.isnan(v)]
    assert 4990 < gap.min() < 5010 and 5980 < gap.max() < 6000


def test_browser_opens_it_without_a_console_message(page: str, tmp_path: Path) -> None:
    browser = shutil.which("chromium") or shutil.which("chromium-browser")
    if browser is None:
        pytest.skip("no chromium on this machine")
    (tmp_path / "report.html").write_text(page, encoding="utf-8")
    flags = ["--headless", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr", "--dump-dom"]
    profile = f"--user-data-dir={tmp_path / 'profile'}"
    command = [browser, *flags, profile, f"file://{tmp_path / 'report.html'}"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert "Factors by motion state" in done.stdout
    assert "CONSOLE" not in done.stderr


def test_show_says_how_without_a_display(
    directory: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("rerun")
    copy = tmp_path / "r"
    shutil.copytree(directory, copy)
    monkeypatch.setattr("sys.platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    said = show.open_viewer(copy)
    assert (copy / "run.rrd").exists()
    assert "no display" in said and "\n" not in said and str(copy / "run.rrd") in said


def test_show_starts_the_viewer_of_the_sdk(
    directory: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("rerun")
    started: list[list[str]] = []
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr("graphnav.views.show.subprocess.Popen", lambda c, **_: started.append(c))
    show.open_viewer(directory)
    (command,) = started
    assert Path(command[0]).exists() and command[1] == str(directory / "run.rrd")
