"""Measured points of a PC-DMIS routine saved as text.

A point feature gives its ``ACTL/`` place, any other feature the places of its ``HIT/`` lines: of those the
last triple is the actual one, the first the nominal. ``THEO/`` and ``TARG/`` are nominal. Triples stand in
``<>``; older routines have bare numbers and go on after ``$``.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Final

from cmm_align.errors import MalformedInputError
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

_OPENING: Final = re.compile(
    r"^\s*(?:\w+\s*=\s*(?:FEAT|AUTO|ALIGNMENT)/|(?:ACTL|THEO)/|HIT/)|^PART NAME\s*:", re.I | re.M
)
_FEATURE: Final = re.compile(r"([\w.-]+)\s*=\s*(?:FEAT|AUTO)\s*/([^<]*)", re.IGNORECASE)
_POINT: Final = re.compile(r"(?:(?:CONTACT|LASER)\s*/\s*)?(?:[A-Z]+ )?POINT\b", re.IGNORECASE)
_ACTUAL: Final = re.compile(r"\bACTL\s*/\s*", re.IGNORECASE)
_HIT: Final = re.compile(r"HIT\s*/", re.IGNORECASE)
_MEASURED: Final = re.compile(r"MEAS\s*/\s*[A-Z ]+,\s*(\d+)", re.IGNORECASE)
_NEXT_WORD: Final = re.compile(r",?\s*[A-Z]+\s*[/=]|,?\s*$", re.IGNORECASE)
_TRIPLE: Final = re.compile(r"<([^<>]*)>")


@dataclass(slots=True)
class _Feature:
    """What has been read of one feature."""

    name: str
    is_point: bool
    started: Statement
    actual: list[list[float]] = field(default_factory=list)
    hits: list[list[float]] = field(default_factory=list)
    announced: int = 0
    """Number of hits that ``MEAS/`` announces."""
    open: bool = False
    """Whether ``ENDMEAS/`` is still to come."""

    def points(self, where: str) -> list[list[float]]:
        """Return its measured points, or raise if they are not complete."""
        place = self.started.place(0, where)
        if self.open or (self.hits and self.announced and len(self.hits) != self.announced):
            raise MalformedInputError(
                f"{len(self.hits)} hits in feature {self.name}",
                where=place,
                expected=f"{self.announced}, and then ENDMEAS/",
            )
        if self.is_point and not self.actual and not self.hits:
            raise MalformedInputError(
                f"{self.started.text[:SHOWN]!r} was not measured",
                where=place,
                expected="ACTL/ or HIT/ with an actual place",
            )
        return self.actual if self.is_point and self.actual else self.hits


def recognises(head: bytes) -> bool:
    """Return whether one of the first lines is a statement of a PC-DMIS routine."""
    return bool(_OPENING.search(opening_text(head)))


def read(source: Source, units: str | None = None) -> PointSet:
    """Return the actual points of a routine, compensated for the tip, frame `machine`.

    Parameters
    ----------
    source : Source
    units : str, optional
        Unit of length; mm by default, the text does not state it.

    Raises
    ------
    MalformedInputError
        With file, line, column and the offending text.

    Notes
    -----
    Comments, moves, alignments, dimensions and the places of features that are no points are passed over.
    Such features without hits, which add no point at all, are told in `passed_over`.
    """
    where = source.where
    scale = scale_to_mm("", units, where)
    lines = decoded(source.raw, where).split("\n")
    features: list[_Feature] = []
    for found in continued_statements(lines):
        match = _FEATURE.match(found.text)
        if match is not None:
            features.append(_Feature(match[1], bool(_POINT.match(match[2])), found))
            if "POLAR" in match[2].upper():
                raise MalformedInputError(
                    f"{found.text[:SHOWN]!r} has polar coordinates",
                    where=found.place(0, where),
                    expected="CARTESIAN",
                )
        if not features:
            continue
        _take(features[-1], found, where)
    points = [(one.name, point) for one in features for point in one.points(where)]
    others = [
        (one.started.starts[0][1], one.started.text, "a feature that is no point, without hits")
        for one in features
        if not one.is_point and not one.hits
    ]
    if not points:
        raise no_points(where, "features with ACTL/ or HIT/ places")
    if lines[-1].strip() and "<" not in lines[-1] and not lines[-1].strip().endswith("/"):
        raise cut_off(where, len(lines), "an end of line after the last statement")
    return PointSet.of(
        [[value * scale for value in point] for _, point in points],
        kind=PointKind.CONTACT,
        ids=numbers_of_names([name for name, _ in points]),
        source=where,
        passed_over=told(where, others),
    )


def _take(feature: _Feature, found: Statement, where: str) -> None:
    """Add what a statement says to the feature that is open."""
    text = found.text
    for match in _ACTUAL.finditer(text):
        feature.actual.append(_place(found, match.end(), where))
    if _HIT.match(text):
        triples = _triples(found, where)
        if len(triples) < 3:
            raise MalformedInputError(
                f"{found.text[:SHOWN]!r} has no actual place",
                where=found.place(0, where),
                expected="HIT/..., <nominal>, <direction>, <actual>",
                remedy="run the routine, then save it as text",
            )
        feature.hits.append(triples[-1])
    elif announced := _MEASURED.match(text):
        feature.announced, feature.open = int(announced[1]), True
    elif text.upper().startswith("ENDMEAS"):
        feature.open = False


def _place(found: Statement, start: int, where: str) -> list[float]:
    """Return x, y, z of ``<x,y,z>,<i,j,k>``, or of bare numbers up to the next word."""
    text = found.text
    if text[start : start + 1] == "<":
        return _triples(found, where, start)[0]
    stop = _NEXT_WORD.search(text, start)
    end = stop.start() if stop is not None else len(text)
    return list(checked_point(numbers(found, where, start, end), found, where))


def _triples(found: Statement, where: str, start: int = 0) -> list[list[float]]:
    """Return the numbers in each ``<>``: three, or more where a feature has a diameter too."""
    text = found.text
    spans = list(_TRIPLE.finditer(text, start))
    if text.count("<", start) != len(spans) or text.count(">", start) != len(spans):
        raise MalformedInputError(
            f"{text[start:][:SHOWN]!r} is not complete", where=found.place(start, where), expected="<x,y,z>"
        )
    triples = [numbers(found, where, span.start(1), span.end(1)) for span in spans]
    for span, triple in zip(spans, triples, strict=True):
        if len(triple) != 3:
            raise MalformedInputError(
                f"{len(triple)} numbers in {span[0][:SHOWN]!r}",
                where=found.place(span.start(), where),
                expected="<x,y,z>",
            )
    return triples
