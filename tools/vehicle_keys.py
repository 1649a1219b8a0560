"""docs/vehicle.md's tables from the fields of `reading.vehicle`: `python tools/vehicle_keys.py`.

Everything under the line `<!-- keys -->` is replaced; tests/test_docs.py fails when it is stale.
"""

from pathlib import Path
from typing import Any

from graphnav.reading.vehicle import Section, Vehicle

PAGE = Path(__file__).parents[1] / "docs" / "vehicle.md"
MARK = "<!-- keys -->\n"


def tables() -> str:
    """One Markdown table per section of the vehicle file."""
    parts = []
    for name, field in Vehicle.model_fields.items():
        section = field.annotation
        if isinstance(section, type) and issubclass(section, Section):
            about = (section.__doc__ or "").split(": ", 1)[1].split("\n")[0].rstrip(".")
            rows = [_row(key, value) for key, value in section.model_fields.items()]
            head = f"## [{field.alias or name}]\n{about[0].upper()}{about[1:]}.\n\n"
            parts.append(head + "| key | unit | default | meaning |\n|---|---|---|---|\n")
            parts[-1] += "\n".join(rows) + "\n"
    return "\n".join(parts)


def _row(key: str, field: Any) -> str:
    extra = field.json_schema_extra or {}
    return f"| `{key}` | {extra.get('unit', '')} | {_default(field)} | {field.description} |"


def _default(field: Any) -> str:
    if field.is_required():
        return "**needed**"
    if field.default_factory is not None:
        return "see above"
    value = field.default
    if value is None or value == "":
        return ""
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    return f'`"{value}"`' if isinstance(value, str) else f"`{value:g}`"


def page(text: str) -> str:
    """The page with its tables made anew."""
    return text.split(MARK)[0] + MARK + tables()


if __name__ == "__main__":
    PAGE.write_text(page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
