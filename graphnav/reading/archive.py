"""A gzip archive as a stream of whole lines, also one that is cut off in the middle."""

import io
import zlib
from pathlib import Path

from graphnav.common.errors import InputError
from graphnav.reading.dialect import HEAD_BYTES

MAGIC = b"\x1f\x8b"
GZIP = 31  # zlib's word for deflated bytes between a gzip header and its trailer
READ, UNFOLDED = 1 << 18, 1 << 20  # bytes read and unfolded at once
CUT = "the archive is cut off: its whole lines are read, what was recorded after them is not in it"
FOLLOWED = "what follows the archive's end is none, and not read"


def is_archive(path: Path) -> bool:
    """Whether the name says gzip."""
    return path.suffix.lower() == ".gz"


class Unfolding(io.RawIOBase):
    """The lines of an archive, member after member; a last line that is cut off is left out, since
    a number that is cut off reads as another one.

    Reading raises InputError where the bytes are damaged: what they unfold to cannot be trusted.
    """

    def __init__(self, path: Path) -> None:
        self.note = ""  # how it ended, where it did not end well
        self._path, self._file = path, path.open("rb")
        self._member, self._fresh = zlib.decompressobj(GZIP), True  # fresh: none of it was seen
        self._members = 0
        self._left, self._ready, self._begun = b"", b"", b""  # folded; lines; a line's beginning
        self._done = False

    def close(self) -> None:
        """And the file."""
        self._file.close()
        super().close()

    def readable(self) -> bool:
        """It is."""
        return True

    def read(self, size: int = -1) -> bytes:
        """As a file's."""
        while not self._done and (size < 0 or len(self._ready) < size):
            self._unfold()
        size = len(self._ready) if size < 0 else size
        data, self._ready = self._ready[:size], self._ready[size:]
        return data

    def readinto(self, buffer: memoryview) -> int:  # type: ignore[override]
        """As a file's."""
        data = self.read(len(buffer))
        buffer[: len(data)] = data
        return len(data)

    @property
    def share(self) -> float:
        """Of the archive's bytes that were unfolded so far."""
        return (self._file.tell() - len(self._left)) / max(self._path.stat().st_size, 1)

    def _unfold(self) -> None:
        """Some more lines, or the end."""
        self._left = self._left or self._file.read(READ)
        if not self._left:
            self._end("" if self._fresh else CUT)
        elif self._fresh and not self._left.startswith(MAGIC[: len(self._left)]):
            if not self._members:
                raise InputError(
                    f"{self._path}: is no gzip archive, whatever its name says; give it the name "
                    "of what it is (.csv, .parquet)"
                )
            self._end(FOLLOWED if self._left.strip(b"\0") else "")
        else:
            self._take(self._unfolded())

    def _unfolded(self) -> bytes:
        self._members += self._fresh
        self._fresh = False
        try:
            data = self._member.decompress(self._left, UNFOLDED)
        except zlib.error:
            raise InputError(
                f"{self._path}: the archive is damaged (its checksum or its inner order is wrong): "
                "copy it anew"
            ) from None
        if self._member.eof:
            self._left = self._member.unused_data
            self._member, self._fresh = zlib.decompressobj(GZIP), True
        else:
            self._left = self._member.unconsumed_tail
        return data

    def _take(self, data: bytes) -> None:
        whole = max(data.rfind(b"\n"), data.rfind(b"\r")) + 1
        if whole:
            self._ready += self._begun + data[:whole]
            self._begun = data[whole:]
        else:
            self._begun += data
        if len(self._begun) > 4 * HEAD_BYTES:  # of four bytes a character
            raise InputError(
                f"{self._path}: a line is longer than {HEAD_BYTES // 1024} kB: no table"
            )

    def _end(self, note: str) -> None:
        self.note, self._done = note, True
        self._ready += b"" if note == CUT else self._begun
        self._begun = b""
