"""Whether a path leads to a file that can be read, and if not, why: before anything waits on it."""

from pathlib import Path

from graphnav.common.errors import InputError

PARQUET = b"PAR1"
OTHERS = {  # first bytes: what it is, what to do
    PARQUET: ("a Parquet file", "give it the name .parquet"),
    b"\x1f\x8b": ("a gzip archive", "give it the name .csv.gz, or unpack it"),
    b"PK\x03\x04": ("a zip archive or a workbook", "unpack it, or save it as CSV"),
    b"\xd0\xcf\x11\xe0": ("an Excel workbook", "save it as CSV"),
    b"SQLite format 3": ("a database", "export the run as CSV"),
}


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


def check_content(path: Path, head: bytes, parquet: bool) -> None:
    """InputError when a file that begins with `head` is something else than its name says."""
    if parquet:
        if not head.startswith(PARQUET):
            raise InputError(
                f"{path}: is no Parquet file, whatever its name says; give it the name of what it "
                "is (.csv, .csv.gz)"
            )
        return
    for magic, (what, cure) in OTHERS.items():
        if head.startswith(magic):
            raise InputError(f"{path}: is {what}, whatever its name says; {cure}")
