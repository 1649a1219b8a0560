"""Result directories appear whole or not at all, and replace nothing graphnav did not write."""

import json
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from fnmatch import fnmatch
from pathlib import Path

from graphnav import __version__
from graphnav.common.errors import InputError

MARKER = ".graphnav"  # lists the files graphnav wrote into the directory
# made from a finished result by other commands, so no loss when it is replaced
DERIVED = ("run.rrd", "report.html", "validation.json", "export/*")


def default_out(run_path: Path) -> Path:
    """`<run stem>_graphnav` beside the run."""
    return run_path.parent / f"{run_path.name.split('.')[0]}_graphnav"


def check_replaceable(out: Path) -> None:
    """InputError when `out` exists and is anything but an empty or a graphnav directory.

    To be called before the work begins, so that nobody waits for a refusal.
    """
    if not out.exists():
        return
    if not out.is_dir():
        raise InputError(f"{out}: is a file, not a directory; give another --out")
    there = sorted(path.relative_to(out) for path in out.rglob("*") if not path.is_dir())
    if not there:
        return
    foreign = [path for path in there if not _own(path, _listed(out))]
    if foreign:
        raise InputError(
            f"{out}: holds {foreign[0]}, which graphnav did not write, and is not replaced; "
            "move it away or give another --out"
        )


def keep_in_result(result: Path, name: str, run_path: Path, text: str) -> Path:
    """Write one of `DERIVED` into a result directory; beside the run where `result` is none.

    Aside first and then renamed; the path written.
    """
    if (result / MARKER).is_file():
        path = result / name
    else:
        path = run_path.parent / f"{run_path.name.split('.')[0]}_{name}"
    aside = _sibling(path, "part")
    try:
        aside.write_text(text, encoding="utf-8")
        aside.replace(path)
    finally:
        aside.unlink(missing_ok=True)
    return path


@contextmanager
def whole_directory(out: Path) -> Iterator[Path]:
    """A directory to write into, which becomes `out` when the block ends without an exception.

    Until then it is a hidden sibling of `out`; an exception, Ctrl-C included, removes it. Raises
    `InputError` when `out` may not be replaced or cannot be made.
    """
    out = out.resolve()
    check_replaceable(out)
    part = _sibling(out, "part")
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        _sweep(out)
        part.mkdir()
    except OSError as error:
        raise InputError(f"{out}: cannot be made: {error.strerror}; give another --out") from None
    try:
        yield part
        _mark(part)
        check_replaceable(out)  # someone may have put a file there meanwhile
        _swap(part, out)
    finally:
        shutil.rmtree(part, ignore_errors=True)


def _sibling(out: Path, what: str) -> Path:
    return out.with_name(f".{out.name}.{what}-{os.getpid()}")


def _mark(directory: Path) -> None:
    files = sorted(str(p.relative_to(directory)) for p in directory.rglob("*") if p.is_file())
    content = {"graphnav": __version__, "files": files}
    (directory / MARKER).write_text(json.dumps(content, indent=1), encoding="utf-8")


def _listed(directory: Path) -> frozenset[str]:
    """Files the marker of `directory` claims; none without a readable marker."""
    try:
        content = json.loads((directory / MARKER).read_text(encoding="utf-8"))
        return frozenset([MARKER, *content["files"]])
    except (OSError, ValueError, KeyError, TypeError):
        return frozenset()


def _own(path: Path, listed: frozenset[str]) -> bool:
    return bool(listed) and (str(path) in listed or any(fnmatch(str(path), p) for p in DERIVED))


def _swap(part: Path, out: Path) -> None:
    """Put `part` in the place of `out`; the old one survives until the new one stands."""
    old = _sibling(out, "old")
    replaced = out.exists()
    if replaced:
        out.rename(old)
    try:
        part.rename(out)
    except OSError:
        if replaced:
            old.rename(out)
        raise
    shutil.rmtree(old, ignore_errors=True)


def _sweep(out: Path) -> None:
    """Remove what a killed graphnav left beside `out`."""
    for path in out.parent.glob(f".{out.name}.part-*"):
        pid = path.name.rpartition("-")[2]
        if pid.isdigit() and not _alive(int(pid)):
            shutil.rmtree(path, ignore_errors=True)


def _alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True
