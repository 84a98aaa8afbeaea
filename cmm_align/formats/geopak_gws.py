"""Scanned contours of Mitutoyo GEOPAK (.gws): a tag ``#nn:`` before every line.

``#03:`` is a point, ``#12:`` a point with its probing direction. The plane of ``#04:`` decides the order of
the three columns: with YZ(X) they are y, z, x. Without a header the plane is XY(Z).
"""

from __future__ import annotations

import re
from typing import Final

from cmm_align.errors import MalformedInputError
from cmm_align.formats.decoding import decoded
from cmm_align.formats.source import Source, scale_to_mm
from cmm_align.formats.statements import SHOWN, cut_off, no_points, numbers, opening_text, statement
from cmm_align.model import PointSet

_TAG: Final = re.compile(r"\s*#(\d\d):")
_REMARK, _NAME, _POINT, _PLANE, _CLOSED, _UNIT, _DIRECTED = "00", "02", "03", "04", "05", "06", "12"
_COUNT: Final = {_POINT: 3, _DIRECTED: 6}
_ORDER: Final = {"XY(Z)": (0, 1, 2), "YZ(X)": (2, 0, 1), "ZX(Y)": (1, 2, 0)}
"""Columns of x, y and z in each plane."""


def recognises(head: bytes) -> bool:
    """Return whether the first line that is not blank starts with a tag."""
    return bool(_TAG.match(opening_text(head).lstrip()))


def read(source: Source, units: str | None = None) -> PointSet:
    """Return the points of all contours of a file, frame `machine`; the format does not state their kind.

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
        If the file states another unit than `units`.
    """
    where = source.where
    lines = decoded(source.raw, where).split("\n")
    order, scale = _ORDER["XY(Z)"], scale_to_mm("", units, where)
    points: list[list[float]] = []
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        here = f"{where}:{number}"
        match = _TAG.match(line)
        if match is None:
            raise MalformedInputError(
                f"{line.strip()[:SHOWN]!r}", where=f"{here}:1", expected="a tag as #03:"
            )
        tag, rest = match[1], line[match.end() :].strip()
        if tag in _COUNT:
            values = numbers(statement([(number, 1, line)]), where, match.end(), separator=None)
            if len(values) != _COUNT[tag]:
                raise MalformedInputError(
                    f"{len(values)} numbers in {line.strip()[:SHOWN]!r}",
                    where=f"{here}:{match.end() + 1}",
                    expected=f"{_COUNT[tag]} after #{tag}:",
                )
            points.append([values[k] * scale for k in order])
        elif tag == _PLANE:
            order = _order(rest, f"{here}:{match.end() + 1}")
        elif tag == _UNIT:
            scale = scale_to_mm(rest, units, f"{here}:{match.end() + 1}")
        elif tag not in {_REMARK, _NAME, _CLOSED}:
            raise MalformedInputError(
                f"the tag in {line.strip()[:SHOWN]!r} is not known",
                where=f"{here}:1",
                expected="#00, #02 to #06 or #12",
            )
    if not points:
        raise no_points(where, "lines with #03: or #12:")
    if lines[-1].strip():
        raise cut_off(where, len(lines), "an end of line after the last point")
    return PointSet.of(points, source=where)


def _order(plane: str, where: str) -> tuple[int, int, int]:
    found = _ORDER.get("".join(plane.upper().split()))
    if found is None:
        raise MalformedInputError(
            f"plane {plane[:SHOWN]!r}", where=where, expected="XY(Z), YZ(X) or ZX(Y); polar ones are not read"
        )
    return found
