"""Measured points of DMIS output (ISO 22093): ``FA(label)=FEAT/POINT,CART,x,y,z,i,j,k``.

``F(label)`` is the nominal and ``PTMEAS`` a target: neither is data. ``$`` at the end of a line goes on in
the next one, ``$$`` starts a comment, ``UNITS/`` holds for what follows it, ``ENDFIL`` is the end.
"""

from __future__ import annotations

import re
from typing import Final

from cmm_align.errors import MalformedInputError, UnitsError
from cmm_align.formats.decoding import decoded
from cmm_align.formats.source import Source, scale_to_mm, told
from cmm_align.formats.statements import (
    SHOWN,
    Statement,
    checked_point,
    continued_statements,
    cut_off,
    no_points,
    numbers,
    numbers_of_names,
    opening_text,
)
from cmm_align.model import PointKind, PointSet

_OPENING: Final = re.compile(r"^\s*(?:(?:FILNAM|DMISMN)\s*/|FA?\s*\([^)\n]*\)\s*=\s*FEAT\s*/)", re.I | re.M)
_ACTUAL: Final = re.compile(r"FA\s*\(", re.IGNORECASE)
_POINT: Final = re.compile(r"FA\s*\(([^)]*)\)\s*=\s*FEAT\s*/\s*POINT\s*,\s*CART\s*,", re.IGNORECASE)
_NOT_A_POINT: Final = re.compile(r"FA\s*\([^)]*\)\s*=\s*FEAT\s*/\s*(?!POINT\b)[A-Z]+", re.IGNORECASE)
_UNITS: Final = re.compile(r"UNITS\s*/\s*([A-Z]+)", re.IGNORECASE)
_UNIT: Final = {"MM": "mm", "CM": "cm", "M": "m", "METER": "m", "INCH": "inch", "UM": "um"}


def recognises(head: bytes) -> bool:
    """Return whether one of the first lines names the file or a feature as DMIS does."""
    return bool(_OPENING.search(opening_text(head)))


def read(source: Source, units: str | None = None) -> PointSet:
    """Return the actual points of a file, compensated for the tip, frame `machine`.

    Parameters
    ----------
    source : Source
    units : str, optional
        Unit of length where the file states none; mm by default.

    Raises
    ------
    MalformedInputError
        With file, line, column and the offending text.
    UnitsError
        If the file states another unit than `units`, or one that is not known.

    Notes
    -----
    Features other than points are left out, and told in `passed_over`. Nominals, comments and all other
    statements are passed over.
    """
    where = source.where
    lines = decoded(source.raw, where).split("\n")
    scale = scale_to_mm("", units, where)
    points: list[list[float]] = []
    names: list[str] = []
    others: list[tuple[int, str, str]] = []
    ended = False
    for found in continued_statements(lines):
        text = found.text
        if stated := _UNITS.match(text):
            scale = _scale(stated, units, found, where)
        elif _ACTUAL.match(text):
            match = _POINT.match(text)
            if match is not None:
                values = checked_point(numbers(found, where, match.end()), found, where)
                points.append([value * scale for value in values])
                names.append(match[1].strip())
            elif _NOT_A_POINT.match(text):
                others.append((found.starts[0][1], text, "a feature that is no point"))
            else:
                raise MalformedInputError(
                    f"{found.text[:SHOWN]!r} is no actual point",
                    where=found.place(0, where),
                    expected="FA(label)=FEAT/POINT,CART,x,y,z,i,j,k",
                )
        ended = text.upper().startswith("ENDFIL")
    if not points:
        raise no_points(
            where,
            "FA(label)=FEAT/POINT,CART,...",
            "F(label) and PTMEAS are the nominal: give the output of the measurement, not its program",
        )
    if not ended:
        raise cut_off(where, len(lines), "ENDFIL as its last statement")
    return PointSet.of(
        points,
        kind=PointKind.CONTACT,
        ids=numbers_of_names(names),
        source=where,
        passed_over=told(where, others),
    )


def _scale(stated: re.Match[str], units: str | None, found: Statement, where: str) -> float:
    place = found.place(stated.start(1), where)
    unit = _UNIT.get(stated[1].upper())
    if unit is None:
        raise UnitsError(f"UNITS/{stated[1]}", where=place, expected=f"one of {', '.join(_UNIT)}")
    return scale_to_mm(unit, units, place)
