"""Points of IGES files without surfaces: entity 116, and 106 (copious data) with places in space.

Lines of 80 columns with the section's letter in column 73; parameters stand in columns 1 to 64 and end with
a mark. A file of parameter lines only, as some programs write it, is read too. Source: Initial Graphics
Exchange Specification IGES 5.3, US Product Data Association, 1996.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import groupby
from typing import Final, NamedTuple

import numpy as np

from cmm_align.errors import MalformedInputError
from cmm_align.formats.decoding import decoded
from cmm_align.formats.iges_global import Global, read_global
from cmm_align.formats.source import Source, scale_to_mm, told
from cmm_align.formats.statements import SHOWN, Statement, cut_off, no_points, numbers, statement
from cmm_align.model import PointKind, PointSet

_LINE: Final = 80
_POINT, _COPIOUS = 116, 106
_SURFACES: Final = frozenset({108, 114, 118, 120, 122, 128, 140, 143, 144, 186, 190, 192, 194, 196, 198, 510})
_CURVES: Final = frozenset({100, 102, 104, 110, 112, 126, 130})
_PLACES: Final = frozenset({1, 2, 3, 11, 12, 13})
"""Forms of 106 that are points, or lines through points; the others are marks on drawings."""
_WIDTH: Final = {1: 2, 2: 3, 3: 6}
"""Numbers of a point for each flag of 106; with 1 the height is one for all."""
_WHOLE: Final = re.compile(r"\s*[+-]?\d*\s*", re.ASCII)
_FIRST_OF_PARAMETERS: Final = re.compile(rb"\s*1(?:16|06)\s*,")


class Entity(NamedTuple):
    """What the directory says about an entity."""

    kind: int
    form: int
    is_moved: bool
    """Whether a matrix places it elsewhere."""


class _Section(NamedTuple):
    number: int
    text: str


def recognises(raw: bytes) -> bool:
    """Return whether a whole file is IGES, holds points and holds no surface."""
    first = raw.split(b"\n", 1)[0].rstrip(b"\r")
    starts = len(first) == _LINE and first[72:73] == b"S" and first[73:].strip().isdigit()
    if not starts and not (first[72:73] == b"P" and _FIRST_OF_PARAMETERS.match(first)):
        return False
    lines = raw.split(b"\n")
    kinds = {line[:8].strip() for line in [one for one in lines if one[72:73] == b"D"][::2]}
    if not kinds:
        kinds = {line.split(b",")[0].strip() for line in lines if line[72:73] == b"P"}
    known = {int(kind) for kind in kinds if kind.isdigit()}
    return bool(known & {_POINT, _COPIOUS}) and not known & _SURFACES


def read(source: Source, units: str | None = None) -> PointSet:
    """Return the points of a file in the order of its parameters, on the part's surface.

    Parameters
    ----------
    source : Source
    units : str, optional
        Unit of length where the file states none; mm by default.

    Raises
    ------
    MalformedInputError
        With file, line, column and the offending text; also if points are placed by a matrix or in the
        scale of a drawing, which are not applied.
    UnitsError
        If the file states another unit than `units`, or one that is not known.

    Notes
    -----
    Curves, and entities 106 that are marks of drawings, are left out and told in `passed_over`. Colours,
    texts and the like are passed over.
    """
    where = source.where
    sections = _sections(decoded(source.raw, where).split("\n"), where)
    stated = read_global([line for _, line in sections["G"]], where) if sections["G"] else Global()
    directory = _directory(sections["D"], where)
    points: list[Sequence[float]] = []
    others: list[tuple[int, str, str]] = []
    for pointer, group in groupby(sections["P"], lambda one: one.text[64:72].strip()):
        found, kind = _parameters(list(group), stated, where)
        entity = directory.get(pointer) if directory else Entity(kind, 2, False)
        if entity is None or entity.kind != kind:
            raise MalformedInputError(
                f"{found.text[:SHOWN]!r} is not what the directory has at {pointer}",
                where=found.place(0, where),
                expected="the same entity in both sections",
            )
        if kind in _CURVES or (kind == _COPIOUS and entity.form not in _PLACES):
            why = "a curve, no point" if kind in _CURVES else f"form {entity.form} of 106 is no points"
            others.append((found.starts[0][1], found.text, why))
        if kind not in {_POINT, _COPIOUS}:
            continue
        if entity.is_moved:
            raise MalformedInputError(
                f"{found.text[:SHOWN]!r} is placed by a matrix",
                where=found.place(0, where),
                expected="points in their final place",
                remedy="export them without transformations",
            )
        if kind == _POINT:
            points += _single(found, stated, where)
        elif entity.form in _PLACES:
            points += _copious(found, stated, where)
    if not points:
        raise no_points(where, "entities 116 or 106")
    scale = scale_to_mm(stated.unit, units, where)
    return PointSet.of(
        np.array(points) * scale,
        kind=PointKind.CONTACT,
        source=where,
        passed_over=told(where, others),
    )


def _sections(lines: Sequence[str], where: str) -> dict[str, list[_Section]]:
    """Part the lines by their letter, and compare their numbers with those in the last line."""
    sections: dict[str, list[_Section]] = {letter: [] for letter in "SGDPT"}
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        letter = line[72:73]
        if letter not in sections or not letter:
            raise MalformedInputError(
                f"{line.strip()[:SHOWN]!r}",
                where=f"{where}:{number}:{min(len(line) + 1, 73)}",
                expected="S, G, D, P or T in column 73",
            )
        sections[letter].append(_Section(number, line))
    if sections["S"] or sections["T"]:
        if not sections["T"]:
            raise cut_off(where, len(lines), "the section T as its last line")
        number, last = sections["T"][0]
        for k, letter in enumerate("SGDP"):
            announced = last[8 * k + 1 : 8 * k + 8].strip()
            if last[8 * k : 8 * k + 1] != letter or announced.lstrip("0") != f"{len(sections[letter])}":
                raise MalformedInputError(
                    f"{len(sections[letter])} lines in section {letter}",
                    where=f"{where}:{number}:{8 * k + 1}",
                    expected=f"{last[8 * k : 8 * k + 8].strip()!r}, as its last line says",
                )
    return sections


def _directory(lines: Sequence[_Section], where: str) -> dict[str, Entity]:
    """Return the entities of section D by the number of their first line."""
    directory = {}
    for (number, first), (_, second) in zip(lines[::2], lines[1::2], strict=False):
        fields = [first[k : k + 8].strip() or "0" for k in range(0, 72, 8)]
        form = second[32:40].strip() or "0"
        if not all(text.lstrip("-").isdigit() for text in (fields[0], fields[6], form)):
            raise MalformedInputError(
                f"{first[:72].strip()[:SHOWN]!r}", where=f"{where}:{number}:1", expected="whole numbers"
            )
        directory[first[73:].strip()] = Entity(int(fields[0]), int(form), int(fields[6]) != 0)
    return directory


def _parameters(group: Sequence[_Section], stated: Global, where: str) -> tuple[Statement, int]:
    """Return the parameters of an entity up to their end mark, and the number of its kind."""
    whole = statement([(number, 1, line[:64]) for number, line in group])
    stop = whole.text.find(stated.end)
    if stop < 0:
        raise MalformedInputError(
            f"{whole.text.strip()[:SHOWN]!r} is not complete",
            where=whole.place(0, where),
            expected=f"{stated.end!r} at its end",
        )
    kind = whole.text[:stop].split(stated.separator)[0].strip()
    if not kind.isdigit():
        raise MalformedInputError(
            f"{whole.text.strip()[:SHOWN]!r}", where=whole.place(0, where), expected="the number of an entity"
        )
    return Statement(whole.text[:stop], whole.starts), int(kind)


def _single(found: Statement, stated: Global, where: str) -> list[Sequence[float]]:
    """Return the place of 116; its last parameter, the pointer, may be left out, but no other one."""
    words = found.text.split(stated.separator)[1:]
    whole = [bool(_WHOLE.fullmatch(word)) for word in words]
    if len(words) == 3 and whole[2] and not all(whole):
        raise MalformedInputError(
            f"{found.text.strip()[:SHOWN]!r}: the last number may be z or a pointer",
            where=found.place(0, where),
            expected="116, x, y, z, pointer",
        )
    return _taken(found, 1, 3, 3, stated, where)


def _copious(found: Statement, stated: Global, where: str) -> list[Sequence[float]]:
    words = found.text.split(stated.separator)
    flag, count = (word.strip() for word in [*words, "", ""][1:3])
    if flag not in {"1", "2", "3"} or not count.isdigit():
        raise MalformedInputError(
            f"{found.text.strip()[:SHOWN]!r}", where=found.place(0, where), expected="106, 1 to 3, count, ..."
        )
    width = _WIDTH[int(flag)]
    if flag != "1":
        return _taken(found, 3, width, width * int(count), stated, where)
    height, *rest = _taken(found, 3, 1, 1 + 2 * int(count), stated, where)
    plane = [one[0] for one in rest]
    return [(x, y, height[0]) for x, y in zip(plane[::2], plane[1::2], strict=True)]


def _taken(
    found: Statement, first: int, width: int, count: int, stated: Global, where: str
) -> list[Sequence[float]]:
    """Return `count` numbers after the first words, `width` by `width`; whole numbers behind are pointers."""
    words = found.text.split(stated.separator)
    rest = words[first + count :]
    if len(words) < first + count or not all(_WHOLE.fullmatch(word) for word in rest):
        raise MalformedInputError(
            f"{len(words) - first} numbers in {found.text.strip()[:SHOWN]!r}",
            where=found.place(0, where),
            expected=f"{count}, then pointers",
        )
    start = sum(len(word) + 1 for word in words[:first])
    stop = start + sum(len(word) + 1 for word in words[first : first + count]) - 1
    values = numbers(found, where, start, stop, stated.separator)
    return [values[k : k + min(width, 3)] for k in range(0, count, width)]
