"""The words inside a recording: quality, verdicts, warnings, how to read the drawing."""

from graphnav.result.quality import in_one_line
from graphnav.result.result_directory import Results
from graphnav.views.headline import against_truth
from graphnav.views.recording.entry import Entry, static
from graphnav.views.recording.paths import exaggeration


def entries(results: Results) -> list[Entry]:
    """One static text document, `/summary`."""
    import rerun as rr

    return static("/summary", rr.TextDocument(_text(results), media_type="text/markdown"))


def _text(results: Results) -> str:
    summary = results.summary
    lines = [f"# {results.title}"]
    if results.quality:
        lines += [f"**{in_one_line(results.quality)}**"]
        lines += _bullets("What speaks against it", results.quality["why"])
        lines += _bullets("What to try", results.quality["remedy"])
    distance, duration = summary.get("distance_m"), summary.get("duration_s")
    if distance is not None and duration is not None:
        lines.append(f"{distance / 1000:.2f} km in {duration:.0f} s")
    lines += _bullets("Verdicts", summary.get("verdicts", []))
    lines += _bullets("Warnings", summary.get("warnings", []))
    figures = [f"{label}: {value}" for label, value in against_truth(summary)]
    lines += _bullets("Against truth", figures)
    lines += _bullets(
        "How to read it",
        [
            f"Time 0 is {results.clock_start:g} s on the run file's own clock.",
            f"Ellipses in the overview are 3σ, drawn {exaggeration(results):g} times their size.",
            "Bands are ±3σ. Red crosses are measurements the robust loss turned down.",
            "The map view asks tile servers for the place of the run; it is off until you open it.",
        ],
    )
    return "\n".join(lines)


def _bullets(heading: str, items: list[str]) -> list[str]:
    return [f"\n## {heading}", *(f"- {item}" for item in items)] if items else []
