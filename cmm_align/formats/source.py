"""A file as its name and its bytes: what every reader of a foreign format gets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

from cmm_align.errors import MalformedInputError, MissingFileError, UnitsError, UsageError
from cmm_align.units import mm_per

HEAD_BYTES: Final = 4096
"""As much as a format may look at to recognise itself."""

MAX_FILE_BYTES: Final = 4 << 30
MOST_TOLD: Final = 50
"""So many rows that were left out are told one by one."""
_SHOWN: Final = 60


@dataclass(frozen=True, slots=True)
class Hints:
    """What the user says of a file that can be read in two ways.

    Attributes
    ----------
    decimal : str or None
        Decimal sign of its numbers: ``,`` or ``.``.
    columns : str or None
        What its columns are, in order: ``id,x,y,z``; ``-`` for one that is not wanted.
    strict : bool
        Whether a measured row that would be left out is an error instead.

    Raises
    ------
    UsageError
        If the decimal sign is neither comma nor point.
    """

    decimal: str | None = None
    columns: str | None = None
    strict: bool = False

    def __post_init__(self) -> None:
        if self.decimal not in {None, ",", "."}:
            raise UsageError(f"decimal sign {self.decimal!r}", expected="--decimal , or --decimal .")


NO_HINTS: Final = Hints()


class Source(NamedTuple):
    """A file that has been read."""

    where: str
    """Its name as the user wrote it, for messages."""
    raw: bytes
    hints: Hints = NO_HINTS

    @property
    def head(self) -> bytes:
        """The first bytes, by which a format recognises itself."""
        return self.raw[:HEAD_BYTES]


def load(path: Path | str, hints: Hints = NO_HINTS) -> Source:
    """Return the bytes of a file.

    Parameters
    ----------
    path : path
    hints : Hints
        What the user says of it.

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
    return Source(where, raw, hints)


def told(where: str, rows: Sequence[tuple[int, str, str]]) -> tuple[str, ...]:
    """Return a sentence for each row that was left out: ``file:line: text: why``.

    Parameters
    ----------
    where : str
        Name of the file.
    rows : sequence of (int, str, str)
        Line from 1, text of the row, and why it was left out.

    Returns
    -------
    tuple of str
        At most `MOST_TOLD`, and one more that counts the others.
    """
    sentences = [
        f"{where}:{line}: {' '.join(text.split())[:_SHOWN]}: {why}" for line, text, why in rows[:MOST_TOLD]
    ]
    if len(rows) > MOST_TOLD:
        sentences.append(f"{where}: ... and {len(rows) - MOST_TOLD} more")
    return tuple(sentences)


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
