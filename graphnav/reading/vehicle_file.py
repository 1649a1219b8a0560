"""vehicle.toml from disk; each mistake in it becomes one line that names the cure."""

import tomllib
from collections.abc import Iterable
from difflib import SequenceMatcher
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import ValidationError
from pydantic.fields import FieldInfo

from graphnav.common.errors import InputError
from graphnav.reading import columns
from graphnav.reading.plain_file import check_file
from graphnav.reading.vehicle import Column, Section, Vehicle

LARGEST = 1_000_000  # bytes
MOST_POINTS = 200  # in a line
SHOWN = 60  # characters of a value that is told
WHERE = (
    "give one with --vehicle, or write at least '[vehicle]\\nkind = \"wheeled\"' (tracked, "
    "wheeled or rover) there"
)
TABLES = {info.alias or name: info for name, info in Vehicle.model_fields.items()}


def load_vehicle(path: Path | None, run_path: Path) -> Vehicle:
    """The vehicle file at `path`, or `vehicle.toml` beside the run.

    Raises `InputError` when it is absent, is not TOML, or holds anything that is not understood.
    """
    if path is None:
        check_file(run_path, "run file", "give a .csv, .csv.gz or .parquet file")
        path = run_path.parent / "vehicle.toml"
    check_file(path, "vehicle file", WHERE)
    try:
        if path.stat().st_size > LARGEST:
            raise InputError(f"{path}: {path.stat().st_size} bytes are no vehicle file")
        text = path.read_text(encoding="utf-8-sig")
        _check_points(path, text)
        table = tomllib.loads(text)
    except RecursionError:
        raise InputError(f"{path}: not TOML: brackets in brackets, too deep to read") from None
    except ValueError as error:  # TOMLDecodeError, UnicodeDecodeError among them
        why = "a number of thousands of digits" if "digits" in str(error) else error
        raise InputError(f"{path}: not TOML: {why}") from None
    return parse_vehicle(table, str(path))


def _check_points(path: Path, text: str) -> None:
    """InputError on a line of so many points that its key would be a table in a table in a ..."""
    for number, line in enumerate(text.splitlines(), 1):
        if line.count(".") > MOST_POINTS:
            raise InputError(
                f"{path}: line {number}: {line.count('.')} points are in no line of a vehicle file"
            )


def parse_vehicle(table: dict[str, Any], source: str = "vehicle") -> Vehicle:
    """A parsed table as a `Vehicle`; `source` names it in the `InputError`."""
    try:
        _known_keys(table)
        return Vehicle.model_validate(table)
    except ValidationError as error:
        raise InputError(f"{source}: {_line(error, table)}") from None
    except ValueError as error:
        raise InputError(f"{source}: {error}") from None


def nearest(word: str, known: Iterable[str]) -> str:
    """The known word most like `word`."""
    return max(known, key=lambda k: SequenceMatcher(None, word.lower(), k.lower()).ratio())


def _shown(value: Any) -> str:
    """A value as a user wrote it, in short."""
    try:
        text = repr(value)
    except ValueError:  # Python prints no number of so many digits
        return "a number of thousands of digits"
    return text if len(text) <= SHOWN else f"{text[:SHOWN]}..."


def _section(name: str) -> type[Section] | None:
    kind = TABLES[name].annotation
    return kind if isinstance(kind, type) and issubclass(kind, Section) else None


def _keys(name: str) -> list[str]:
    section = _section(name)
    return list(section.model_fields) if section else [*columns.DIMENSION, *columns.GROUPS]


def _known_keys(table: dict[str, Any]) -> None:
    """ValueError on the first table or key that does not exist, naming the nearest that does."""
    for name, content in table.items():
        if name not in TABLES:
            home = next((s for s in TABLES if name in _keys(s)), None)
            cure = f"it belongs under [{home}]" if home else f"nearest is [{nearest(name, TABLES)}]"
            raise ValueError(f"unknown table or key '{name}'; {cure}")
        if not isinstance(content, dict):
            raise ValueError(f"[{name}] must be a table of keys, not {_shown(content)}")
        for key in content:
            if key not in _keys(name):
                raise ValueError(f"[{name}] {_unknown(key, name)}")


def _unknown(key: str, table: str) -> str:
    elsewhere = next((s for s in TABLES if s != "columns" and key in _keys(s)), None)
    if elsewhere:
        return f"unknown key '{key}'; it belongs under [{elsewhere}]"
    return f"unknown key '{key}'; nearest is '{nearest(key, _keys(table))}'"


def _line(error: ValidationError, table: dict[str, Any]) -> str:
    """The first thing wrong, with the value found, what is wanted and its unit."""
    first = error.errors()[0]
    where = [str(part) for part in first["loc"]]
    if not where or where == ["columns"] or (first["type"] == "value_error" and len(where) < 2):
        return str(first["msg"]).removeprefix("Value error, ")
    name = f"[{where[0]}] {where[1]}" if len(where) > 1 else f"[{where[0]}]"
    if first["type"] == "missing" and len(where) < 3:
        return f"{name} is missing; add {_example(where)}"
    if first["type"] == "value_error":
        return f"{name}: {str(first['msg']).removeprefix('Value error, ')}"
    if where[0] == "columns":
        keys = ", ".join(Column.model_fields)
        return f"{name} must be a name, or a table of {keys}, e.g. {_example(where)}"
    value = table.get(where[0], {}).get(where[1])
    info = _field(where)
    return f"{name} = {_shown(value)}: must be {_wanted(info, first)} ({info.description})"


def _field(where: list[str]) -> FieldInfo:
    section = _section(where[0])
    assert section is not None  # [columns] is answered before
    return section.model_fields[where[1]]


def _wanted(info: FieldInfo, first: Any) -> str:
    extra = info.json_schema_extra if isinstance(info.json_schema_extra, dict) else {}
    unit = f" [{extra['unit']}]" if extra.get("unit") else ""
    limit = {"greater_than": "above {gt:g}", "greater_than_equal": "at least {ge:g}",
             "less_than_equal": "at most {le:g}"}.get(first["type"], "")  # fmt: skip
    return f"{_kind(info.annotation)}{' ' + limit.format(**first['ctx']) if limit else ''}{unit}"


def _kind(annotation: Any) -> str:
    """A type in words: a number, three numbers, true or false, one of ..."""
    origin, args = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _kind(args[0])
    if origin in (Union, UnionType):
        return _kind(next(a for a in args if a is not NoneType))
    if origin is tuple:
        return f"{len(args)} numbers in brackets"
    if args:  # Literal
        return "one of " + ", ".join(f'"{a}"' for a in args)
    return {float: "a number", bool: "true or false"}.get(annotation, "text in quotes")


def _example(where: list[str]) -> str:
    if where[0] == "columns":
        return f'{where[1]} = {{ name = "x", unit = "{columns.default_unit(where[1])}" }}'
    return 'kind = "tracked", "wheeled" or "rover" under [vehicle]'
