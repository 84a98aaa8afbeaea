"""Points of VDA-FS files (DIN 66301): POINT, PSET and MDI.

Records of 80 columns, the last eight of which may hold a number; ``$$`` starts a comment; a statement
``name = WORD / ...`` runs on until the next one. The format knows no units; mm by convention.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np

from cmm_align.errors import MalformedInputError
from cmm_align.formats.decoding import decoded
from cmm_align.formats.source import Source, scale_to_mm, told
from cmm_align.formats.statements import (
    SHOWN,
    Statement,
    cut_off,
    no_points,
    numbers,
    numbers_of_names,
    opening_text,
    statement,
)
from cmm_align.model import PointKind, PointSet

_DATA_COLUMNS: Final = 72
_START: Final = re.compile(r"\s*(?:([A-Z][^\s=/,]*)\s*=\s*)?([A-Z]+)\s*(/|(?=\s*$))", re.IGNORECASE)
_OPENING: Final = re.compile(r"^[ \t]*[A-Z][^\s=/,]*\s*=\s*(?:HEADER|POINT|PSET|MDI)\s*/", re.I | re.M)
_WIDTH: Final = {"POINT": 3, "PSET": 3, "MDI": 6}
"""Numbers of one point; PSET and MDI say first how many points there are."""
_STRUCTURE: Final = {"HEADER", "END", "BEGINSET", "ENDSET"}
_CURVES: Final = {"CIRCLE", "CURVE", "SURF", "CONS", "FACE", "TOP"}
"""What is there to be seen, but is no point."""
_MOVES: Final = {"TMAT", "TLIST", "GROUP"}
"""What places points elsewhere; refused, for nobody has shown us a file with them."""


class Named(NamedTuple):
    """A statement with its name and its word."""

    name: str
    word: str
    body: Statement
    first: int
    """Place in the text where what follows the ``/`` starts."""


def recognises(head: bytes) -> bool:
    """Return whether one of the first lines is a statement of the format."""
    return bool(_OPENING.search(opening_text(head)))


def read(source: Source, units: str | None = None) -> PointSet:
    """Return the points of a file in their order, on the part's surface; directions are not used.

    Curves and surfaces are left out, and told in `passed_over`.

    Parameters
    ----------
    source : Source
    units : str, optional
        Unit of length; mm by default, the file cannot state it.

    Raises
    ------
    MalformedInputError
        With file, line, column and the offending text; also for transformations, which are not applied.
    """
    where = source.where
    lines = decoded(source.raw, where).split("\n")
    points: list[Sequence[float]] = []
    names: list[str] = []
    others: list[tuple[int, str, str]] = []
    ended = False
    for found in _named(lines, where):
        if found.word in _WIDTH:
            new = _points(found, where)
            points += new
            names += [found.name] * len(new)
        elif found.word in _MOVES or found.word not in _STRUCTURE | _CURVES:
            raise MalformedInputError(
                f"{found.body.text.strip()[:SHOWN]!r} is not read",
                where=found.body.place(0, where),
                expected="POINT, PSET or MDI, nothing that moves them",
                remedy="export the points in their final place",
            )
        elif found.word in _CURVES:
            others.append((found.body.starts[0][1], found.body.text, "a curve or surface, no point"))
        ended = found.word == "END"
    if not points:
        raise no_points(where, "POINT, PSET or MDI")
    if not ended:
        raise cut_off(where, len(lines), "END as its last statement")
    return PointSet.of(
        np.array(points) * scale_to_mm("", units, where),
        kind=PointKind.CONTACT,
        ids=numbers_of_names(names),
        source=where,
        passed_over=told(where, others),
    )


def _points(found: Named, where: str) -> list[Sequence[float]]:
    values = numbers(found.body, where, found.first)
    width, counted = _WIDTH[found.word], found.word != "POINT"
    count = values[0] if counted else 1.0
    if len(values) != counted + width * count:
        raise MalformedInputError(
            f"{len(values) - counted} numbers in {found.word}" + (f" / {count:g}" if counted else ""),
            where=found.body.place(0, where),
            expected=f"{count:g} x {width}",
        )
    return [values[k : k + 3] for k in range(int(counted), len(values), width)]


def _named(lines: Sequence[str], where: str) -> Iterator[Named]:
    """Give the statements of a file; comments and the free text of headers are passed over."""
    pieces: list[tuple[int, int, str]] = []
    free = 0
    for number, line in enumerate(_without_sequence(lines, where), 1):
        if free > 0:
            free -= 1
        elif line.strip() and not line.lstrip().startswith("$$"):
            match = _START.match(line)
            if match is not None and pieces:
                yield _parted(statement(pieces))
                pieces = []
            if match is None and not pieces:
                raise MalformedInputError(
                    f"{line.strip()[:SHOWN]!r}", where=f"{where}:{number}:1", expected="NAME = WORD / ..."
                )
            pieces.append((number, 1, line))
            if match is not None and match[2].upper() in _STRUCTURE:  # one record each
                if match[2].upper() == "HEADER":
                    free = int(numbers(statement(pieces), where, match.end())[0])
                yield _parted(statement(pieces))
                pieces = []
    if pieces:
        yield _parted(statement(pieces))


def _parted(found: Statement) -> Named:
    match = _START.match(found.text)
    if match is None:  # it would not have been started
        return Named("", "", found, 0)
    return Named(match[1] or "", match[2].upper(), found, match.end())


def _without_sequence(lines: Sequence[str], where: str) -> list[str]:
    """Cut the record numbers off: eight digits in columns 73 to 80, and nothing after them.

    Raises
    ------
    MalformedInputError
        If they may as well be the last digits of a number.
    """
    numbered = [line[_DATA_COLUMNS:].rstrip() for line in lines]
    free = any(
        text and not _is_sequence(text) and not line.lstrip().startswith("$$")
        for text, line in zip(numbered, lines, strict=True)
    )
    kept = []
    for number, (line, text) in enumerate(zip(lines, numbered, strict=True), 1):
        if _is_sequence(text):
            if free and line[_DATA_COLUMNS - 1] in "0123456789.":
                word = line.split()[-1]
                raise MalformedInputError(
                    f"{word[-30:]!r} has two readings: {word.split(',')[-1][:-8]} and a record number, or one"
                    " number in a file with long lines",
                    where=f"{where}:{number}:{_DATA_COLUMNS + 1}",
                    expected="record numbers in all lines or in none",
                )
            kept.append(line[:_DATA_COLUMNS])
        else:
            kept.append(line)
    return kept


def _is_sequence(text: str) -> bool:
    return len(text) == 8 and text.isascii() and text.isdigit()
