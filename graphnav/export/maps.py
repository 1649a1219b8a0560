"""Exports for maps: KML (fastkml), GeoJSON (geojson), GPX (gpxpy).

Places are WGS 84 with heights above its ellipsoid; KML and GPX readers take heights as above sea
level, so they show the path off by the geoid's undulation (no geoid model is shipped). KML and
GeoJSON hold one line per motion state, thinned to what a map shows; GPX holds every row.
"""

from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from graphnav.export.track import Track
from graphnav.result import palette
from graphnav.result.result_directory import Results, state_spans, thin

LINE_LIMIT = 30_000  # vertices in all
DEGREE_DIGITS = 9  # 0.1 mm
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


def _lines(results: Results, track: Track) -> Iterator[tuple[str, int, int, list[Any]]]:
    """`(state, first, last, [(lon, lat, height), ...])` of each motion state."""
    share = min(1.0, LINE_LIMIT / len(track.time))
    place = np.column_stack([
        track.lon_deg.round(DEGREE_DIGITS), track.lat_deg.round(DEGREE_DIGITS),
        track.height.round(4),
    ])  # fmt: skip
    for state, first, last in state_spans(results):
        count = last - first + 1
        rows = first + thin(count, max(2, round(count * share)))
        yield state, first, last, place[rows].tolist()


def kml(results: Results, track: Track, path: Path) -> None:
    """Google Earth: a folder per motion state, coloured as everywhere, altitude mode absolute."""
    from fastkml import KML, Document, Folder, Placemark, Style, StyleUrl
    from fastkml.enums import AltitudeMode
    from fastkml.geometry import Coordinates, LineString
    from fastkml.styles import LineStyle

    marks: dict[str, list[Any]] = {}
    for state, first, last, places in _lines(results, track):
        start, end = track.time[[first, last]]
        line = LineString(
            altitude_mode=AltitudeMode.absolute, kml_coordinates=Coordinates(coords=places)
        )
        style = StyleUrl(url=f"#{state}")
        name = f"{palette.motion_label(state)} {start:.1f}-{end:.1f} s"
        marks.setdefault(state, []).append(Placemark(name=name, style_url=style, kml_geometry=line))
    states = palette.in_order(marks)
    styles = [Style(id=s, styles=[LineStyle(color=_abgr(s), width=3.0)]) for s in states]
    folders = [Folder(name=palette.motion_label(s), features=marks[s]) for s in states]
    document = Document(name=results.title, styles=styles, features=folders)
    text = KML(features=[document]).to_string(prettyprint=False)
    path.write_text('<?xml version="1.0" encoding="UTF-8"?>\n' + text, encoding="utf-8")


def _abgr(state: str) -> str:
    red, green, blue = palette.rgb(palette.motion(state))
    return f"ff{blue:02x}{green:02x}{red:02x}"


def geojson(results: Results, track: Track, path: Path) -> None:
    """One LineString feature per motion state; `stroke` is understood by GIS and code hosts."""
    from geojson import Feature, FeatureCollection, LineString, dump

    features = [
        Feature(
            geometry=LineString(places, precision=DEGREE_DIGITS),
            properties={
                "state": state,
                "start": float(track.time[first]),
                "end": float(track.time[last]),
                "stroke": palette.motion(state),
                "stroke-width": 3,
            },
        )
        for state, first, last, places in _lines(results, track)
    ]
    with path.open("w", encoding="utf-8") as out:
        dump(FeatureCollection(features, name=results.title), out)


def gpx(results: Results, track: Track, path: Path) -> None:
    """Every row a track point. The run file's clock is read as Unix seconds (UTC)."""
    from gpxpy.gpx import GPX, GPXTrack, GPXTrackPoint, GPXTrackSegment

    rows = zip(
        track.lat_deg.round(DEGREE_DIGITS).tolist(),
        track.lon_deg.round(DEGREE_DIGITS).tolist(),
        track.height.round(4).tolist(),
        track.time.tolist(),
        strict=True,
    )
    segment = GPXTrackSegment(
        [
            GPXTrackPoint(lat, lon, height, EPOCH + timedelta(seconds=second))
            for lat, lon, height, second in rows
        ]
    )
    line = GPXTrack(name=results.title)
    line.segments.append(segment)
    document = GPX()
    document.creator = "graphnav"
    document.tracks.append(line)
    path.write_text(document.to_xml(prettyprint=False), encoding="utf-8")
