"""Whether a path leads to a file that can be read, and if not, why: before anything waits on it."""

from pathlib import Path

from graphnav.common.errors import InputError


def check_file(path: Path, what: str, cure: str) -> None:
    """InputError, with the cause, when `path` is no file; `what` is missing, `cure` what to do."""
    try:
        if path.is_file():
            return
        why = _why(path, what)
    except OSError as error:  # a name too long, a directory that may not be entered
        why = (error.strerror or str(error)).lower()
    raise InputError(f"{path}: {why}; {cure}")


def _why(path: Path, what: str) -> str:
    if path.is_dir():
        return f"is a directory, no {what}"
    if path.is_symlink():
        return f"is a link that leads to no {what}"
    if path.exists():
        return f"is a pipe or a device, no {what} on disk"
    return f"no such {what}"
