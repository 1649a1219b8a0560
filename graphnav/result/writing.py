"""Result directories appear whole or not at all, and nothing of a user's is lost by it.

A marker lists what graphnav wrote, with sizes and digests; whatever else a replaced directory holds
is kept in a directory beside it.
"""

import hashlib
import json
import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from graphnav import __version__
from graphnav.common import replacing
from graphnav.common.errors import GraphnavError, InputError

MARKER = ".graphnav"
OWN_MARKER = re.compile(r"\.graphnav(\.\d+)?")  # and what a kill leaves of one
# made from a result by versions that did not list them: no loss when replaced
DERIVED = ("run.rrd", "report.html", "validation.json")
DIGEST = 16  # bytes


def default_out(run_path: Path) -> Path:
    """`<run stem>_graphnav` beside the run."""
    return run_path.parent / f"{run_path.name.split('.')[0]}_graphnav"


def check_replaceable(out: Path, inputs: tuple[Path | None, ...] = ()) -> None:
    """InputError when `out` exists and is anything but an empty or a graphnav directory, or when it
    holds one of the `inputs`.

    To be called before the work begins, so that nobody waits for a refusal.
    """
    out = _resolved(out)
    _there(replacing.aside(out, "part"))  # its name is the longer one
    _check_makeable(out)
    if not _there(out):
        return
    if out.is_mount():
        raise InputError(
            f"{out}: is a mount, which no result can take the place of; give a directory in it as "
            f"--out ({out / 'result'})"
        )
    if not out.is_dir():
        raise InputError(f"{out}: is a file, not a directory; give another --out")
    for path in inputs:
        if path is not None and out in _resolved(path).parents:
            raise InputError(f"{path}: lies in {out}, which is to be replaced; give another --out")
    there = replacing.files(out)
    if there and _listed(out) is None:
        raise InputError(
            f"{out}: holds {there[0]}, which graphnav did not write, and is not replaced; "
            "move it away or give another --out"
        )


def _there(out: Path) -> bool:
    try:
        return out.exists()
    except OSError as error:  # a name too long, a directory that may not be entered
        raise InputError(f"{out}: {error.strerror}; give another --out") from None


def _check_makeable(out: Path) -> None:
    """InputError when no directory can be made where `out` is to be."""
    above = next(path for path in out.parents if path.exists())
    if not above.is_dir():
        raise InputError(f"{out}: cannot be made, {above} is a file; give another --out")
    if not os.access(above, os.W_OK | os.X_OK):
        raise InputError(f"{out}: may not be written in {above}; give another --out")


@contextmanager
def whole_directory(out: Path) -> Iterator[Path]:
    """A directory to write into, which becomes `out` when the block ends without an exception.

    Until then it is a hidden sibling of `out`; an exception, Ctrl-C included, removes it. Raises
    `InputError` when `out` may not be replaced or cannot be made or written.
    """
    out = _resolved(out)
    check_replaceable(out)
    with _complaints(out):
        out.parent.mkdir(parents=True, exist_ok=True)
        _recover(out)
        part = replacing.made_aside(out, "part")
    try:
        with _complaints(out):
            yield part
            _mark(part, {})
            _replace(part, out)
    finally:
        _clear(part, out)  # what was written, or what stood there before: the two are exchanged


def kept_aside(out: Path) -> list[str]:
    """What of `out` will be kept beside it when it is replaced, in words; nothing as a rule."""
    out = _resolved(out)
    foreign = _foreign(out) if out.is_dir() else []
    if not foreign:
        return []
    return [
        f"{replacing.named(foreign)} in {out.name} were not written by graphnav, or changed since: "
        f"kept in {replacing.kept_beside(out, foreign).name}"
    ]


def adopt(directory: Path, file: Path) -> None:
    """Add a `file` made later to what graphnav wrote into its result `directory`."""
    listed = _listed(directory)
    with suppress(ValueError, OSError):
        name = str(file.resolve().relative_to(directory.resolve()))
        if listed is not None:
            _mark(directory, {**listed, name: _print_of(directory / name)})


def keep_in_result(result: Path, name: str, run_path: Path, text: str) -> Path:
    """Write a text into a result directory; beside the run where `result` is none.

    Aside first and then renamed; the path written.
    """
    restore(result)
    path = result / name
    if not (result / MARKER).is_file():
        path = run_path.parent / f"{run_path.name.split('.')[0]}_{name}"
    with replacing.whole(path) as part:
        part.write_text(text, encoding="utf-8")
    adopt(result, path)
    return path


@contextmanager
def own_files(directory: Path) -> Iterator[None]:
    """What fails on files of a result that were changed since graphnav wrote them, as an InputError
    that names the first.
    """
    try:
        yield
    except (GraphnavError, OSError, MemoryError):
        raise
    except Exception as error:
        names = [name for name in _foreign(directory) if str(name) in (_listed(directory) or {})]
        if not names:
            raise
        raise InputError(
            f"{directory / names[0]}: was changed since graphnav wrote it, and is no longer what "
            f"it was ({error}); run `graphnav smooth` again"
        ) from error


@contextmanager
def _complaints(out: Path) -> Iterator[None]:
    """A full disk and its like as one line."""
    try:
        yield
    except OSError as error:
        what = error.strerror or str(error)
        at = f"{error.filename}: " if error.filename else ""
        raise InputError(
            f"{out}: cannot be written: {at}{what}; make room or give another --out (what was "
            "there stands)"
        ) from None


def _resolved(path: Path) -> Path:
    try:
        return path.resolve()
    except (OSError, RuntimeError) as error:  # links in a circle
        raise InputError(f"{path}: cannot be found: {error}; give another path") from None


def _replace(part: Path, out: Path) -> None:
    """Put `part` in the place of `out`; keep what is not graphnav's, remove the rest."""
    stands_in = out == Path.cwd() or out in Path.cwd().parents
    old = replacing.put(part, out)
    if old is not None:
        if replacing.files(old) and _listed(old) is None:  # someone put a file there meanwhile
            replacing.put(old, out)
            check_replaceable(out)
        _clear(old, out)
    if stands_in:
        os.chdir(out)


def restore(out: Path) -> None:
    """Put the newest whole result that killed runs left beside `out` there, if nothing stands.

    Two renames are needed where a file system cannot exchange names: a kill between them leaves the
    old and the new result under hidden names. Every command that reads or replaces one begins here.
    """
    out = _resolved(out)
    if _there(out):
        return
    for path in replacing.left_by_the_dead(out):
        if _is_whole(path):
            with suppress(OSError):
                path.rename(out)
                return


def _recover(out: Path) -> None:
    """Put right what killed runs left: a whole result is restored where none stands, files of a
    user's are kept, the rest is removed.
    """
    restore(out)
    for path in replacing.left_by_the_dead(out):
        _clear(path, out)


def _clear(old: Path, out: Path) -> None:
    """Remove a directory that was or would have been `out`, but for what is not graphnav's."""
    replacing.clear(old, out, _foreign(old))


def _foreign(directory: Path) -> list[Path]:
    """Files of a marked directory that graphnav did not write, or that were changed since."""
    listed = _listed(directory)
    if listed is None:
        return []
    return [name for name in _results(directory) if not _own(directory, str(name), listed)]


def _own(directory: Path, name: str, listed: Mapping[str, Any]) -> bool:
    if name not in listed:
        return False
    written = listed[name]
    if written is None:  # a marker of names alone
        return True
    try:
        stat = (directory / name).stat()
        same = [stat.st_size, stat.st_mtime_ns] == written[:2]
        return bool(same or _print_of(directory / name)[2] == written[2])
    except OSError:
        return False


def _is_whole(directory: Path) -> bool:
    listed = _listed(directory) or {}
    return bool(listed) and all(t and (directory / name).exists() for name, t in listed.items())


def _results(directory: Path) -> list[Path]:
    """All files but the marker."""
    return [name for name in replacing.files(directory) if not OWN_MARKER.fullmatch(str(name))]


def _mark(directory: Path, listed: Mapping[str, Any]) -> None:
    """Write the marker; all that is there, where nothing is listed."""
    listed = listed or {str(name): _print_of(directory / name) for name in _results(directory)}
    part = directory / f"{MARKER}.{os.getpid()}"  # what a kill leaves is no foreign file
    part.write_text(json.dumps({"graphnav": __version__, "files": listed}), encoding="utf-8")
    part.replace(directory / MARKER)


def _print_of(path: Path) -> list[Any]:
    """Size, time of change and digest of a file: by them a change is known."""
    stat = path.stat()
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, lambda: hashlib.blake2b(digest_size=DIGEST))
    return [stat.st_size, stat.st_mtime_ns, digest.hexdigest()]


def _listed(directory: Path) -> dict[str, Any] | None:
    """Files the marker of `directory` claims, with their prints; None without a readable one."""
    try:
        content = json.loads((directory / MARKER).read_text(encoding="utf-8"))
        files = content["files"]
        if not isinstance(files, dict):
            return dict.fromkeys([*map(str, files), *DERIVED])
        sound = all(each is None or len(list(each)) == 3 for each in files.values())
        return dict(files) if sound else None
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None
