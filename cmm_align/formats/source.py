"""A file as its name and its bytes: what every reader of a foreign format gets."""

from __future__ import annotations

from pathlib import Path
from typing import Final, NamedTuple

from cmm_align.errors import MalformedInputError, MissingFileError, UnitsError
from cmm_align.units import mm_per

HEAD_BYTES: Final = 4096
"""As much as a format may look at to recognise itself."""

MAX_FILE_BYTES: Final = 4 << 30


class Source(NamedTuple):
    """A file that has been read."""

    where: str
    """Its name as the user wrote it, for messages."""
    raw: bytes

    @property
    def head(self) -> bytes:
        """The first bytes, by which a format recognises itself."""
        return self.raw[:HEAD_BYTES]


def load(path: Path | str) -> Source:
    """Return the bytes of a file.

    Raises
    ------
    MissingFileError
        If it cannot be read, or is a folder.
    MalformedInputError
        If it is empty or larger than 4 GiB.
    """
    where = str(path)
    try:
        size = Path(path).stat().st_size
        if size > MAX_FILE_BYTES:
            raise MalformedInputError(
                f"{size} bytes", where=where, expected=f"at most {MAX_FILE_BYTES} bytes"
            )
        raw = Path(path).read_bytes()
    except OSError as error:
        raise MissingFileError(f"cannot read it ({error.strerror})", where=where) from None
    if not raw:
        raise MalformedInputError("the file is empty (0 bytes)", where=where, expected="points")
    return Source(where, raw)


def scale_to_mm(stated: str, given: str | None, where: str) -> float:
    """Return the factor to mm of a unit stated in the file or given by the user; mm if neither.

    Raises
    ------
    UnitsError
        If both are there and differ, or one is not known.
    """
    if stated and given and mm_per(stated, where=where) != mm_per(given):
        raise UnitsError(
            f"the file states {stated}, --units says {given}",
            where=where,
            remedy="leave --units out, or mend the file",
        )
    return mm_per(stated or given or "mm", where=where)
