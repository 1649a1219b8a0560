"""A file or directory in the place of another: whatever moment a kill comes, one of them stands.

Names carry host and process: what a dead process of this host left may be put right, what belongs
to another host or a living process is left alone.
"""

import ctypes
import os
import re
import shutil
import socket
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from errno import EBUSY, EEXIST, EINVAL, ENOENT, ENOSYS, ENOTEMPTY, ENOTSUP, EPERM
from itertools import count
from pathlib import Path

from graphnav.common.errors import InputError

HOST = re.sub(r"[^A-Za-z0-9_]+", "_", socket.gethostname())[:40] or "host"
AT_FDCWD, RENAME_EXCHANGE, RENAME_SWAP = -100, 2, 2  # linux/fs.h; sys/stdio.h of macOS
CANNOT = {ENOSYS, EINVAL, ENOTSUP, EPERM}  # the system or its file system has no exchange
CLASH = {ENOENT, EEXIST, ENOTEMPTY, EBUSY}  # another process was quicker
TRIES = 50


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """A file to be written in the place of `path`, which it takes only when it is done.

    Raises InputError where it cannot be written.
    """
    part = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        yield part
        part.replace(path)
    except OSError as error:
        raise InputError(
            f"{path}: cannot be written: {error.strerror or error}; make room or choose another "
            "place"
        ) from None
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)


def made_aside(out: Path, what: str) -> Path:
    """A new hidden directory beside `out`, named after `what`, this host and this process."""
    for path in _names(out, what):
        with suppress(FileExistsError):
            path.mkdir()
            return path
    raise AssertionError("unreachable")


def aside(out: Path, what: str) -> Path:
    """The first name `made_aside` will try."""
    return next(_names(out, what))


def _names(out: Path, what: str) -> Iterator[Path]:
    stem = f".{out.name}.{what}-{HOST}-{os.getpid()}"
    yield out.with_name(stem)
    for number in count(2):
        yield out.with_name(f"{stem}-{number}")


def put(part: Path, out: Path) -> Path | None:
    """Put directory `part` in the place of `out`; where the old one lies then, None without one.

    In one step where the system can; else by two renames. POSIX renames no directory onto one that
    holds something, so that no order of them always leaves one there: a kill between leaves both
    under their hidden names, for the next command to put back. Raises OSError.
    """
    for attempt in range(TRIES):
        try:
            if not out.exists():
                part.rename(out)
                return None
            return part if exchange(part, out) else _put_by_two(part, out)
        except OSError as error:
            if error.errno not in CLASH or attempt == TRIES - 1:
                raise
    raise AssertionError("unreachable")


def _put_by_two(part: Path, out: Path) -> Path:
    old = made_aside(out, "old")
    out.rename(old)  # onto an empty directory
    try:
        part.rename(out)
    except BaseException:  # Ctrl-C too
        with suppress(OSError):  # another process may have put its own there meanwhile
            old.rename(out)
        raise
    return old


def exchange(one: Path, other: Path) -> bool:
    """Exchange two names in one step; False where that cannot be done. Raises OSError."""
    if sys.platform == "win32":
        return False
    libc = ctypes.CDLL(None, use_errno=True)
    names = os.fsencode(one), os.fsencode(other)
    if hasattr(libc, "renameat2"):
        failed = libc.renameat2(AT_FDCWD, names[0], AT_FDCWD, names[1], RENAME_EXCHANGE)
    elif hasattr(libc, "renamex_np"):
        failed = libc.renamex_np(*names, RENAME_SWAP)
    else:
        return False
    if not failed:
        return True
    number = ctypes.get_errno()
    if number in CANNOT:
        return False
    raise OSError(number, os.strerror(number), str(one), None, str(other))


def left_by_the_dead(out: Path) -> list[Path]:
    """What dead processes of this host left beside `out`, the newest first."""
    form = re.compile(rf"\.{re.escape(out.name)}\.(part|old)-{HOST}-(\d+)(-\d+)?")
    found = []
    with suppress(OSError):
        for path in out.parent.iterdir():
            named = form.fullmatch(path.name)
            if named and not alive(int(named[2])):
                with suppress(OSError):
                    found.append((path.stat().st_mtime, path))
    return [path for _, path in sorted(found, reverse=True)]


def alive(pid: int) -> bool:
    """Whether a process of this host still runs."""
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:
        return True
    return True


def files(directory: Path) -> list[Path]:
    """Everything in a directory that is no directory, relative to it; links are not followed."""
    found = []
    for folder, folders, names in os.walk(directory):
        links = [name for name in folders if (Path(folder) / name).is_symlink()]
        found += [(Path(folder) / name).relative_to(directory) for name in [*names, *links]]
    return sorted(found)


def kept_beside(out: Path, names: Sequence[Path]) -> Path:
    """The directory beside `out` where files of these names can be kept: none is there yet."""
    for number in count(1):
        path = out.with_name(f"{out.name}_kept{f'_{number}' if number > 1 else ''}")
        if not path.is_file() and not any((path / name).exists() for name in names):
            return path
    raise AssertionError("unreachable")


def clear(old: Path, out: Path, names: Sequence[Path]) -> None:
    """Remove a directory that was or would have been `out`; its files `names` are kept beside it.

    Raises InputError, and removes nothing, where they cannot be.
    """
    kept = kept_beside(out, names)
    try:
        for name in names:
            target = kept / name
            target.parent.mkdir(parents=True, exist_ok=True)
            with suppress(FileNotFoundError):  # another process kept it
                (old / name).rename(target)
    except OSError as error:
        raise InputError(
            f"{out}: {named(names)} of what was there cannot be moved to {kept}: "
            f"{error.strerror or error}; it lies in {old}: move it, or make room and call again"
        ) from None
    shutil.rmtree(old, ignore_errors=True)


def named(names: Sequence[Path]) -> str:
    """The first name, and how many more there are."""
    return f"{names[0]}{f' and {len(names) - 1} more' if names[1:] else ''}"
