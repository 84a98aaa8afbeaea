"""Feature tables of Zeiss CALYPSO (``*_fet.txt``): tabs, names in the first line, rows that may be shorter.

Columns are found by name. Rows of points give their actual x, y, z; nominal ones and the direction are not
used. Tables of characteristics (``*_chr.txt``) hold no points.
"""

from __future__ import annotations

from typing import Final

from cmm_align.errors import MalformedInputError, UnitsError
from cmm_align.formats.decoding import decoded
from cmm_align.formats.source import Source, scale_to_mm, told
from cmm_align.formats.statements import SHOWN, cut_off, no_points, numbers_of_names, opening_text
from cmm_align.formats.tab_table import Row, lengths, names_of, rows_of
from cmm_align.model import PointKind, PointSet

_OURS: Final = {"planid", "partnb", "idsymbol", "idtype", "featureid"}
_KIND: Final = ("idsymbol", "idtype", "type")
_POINTS: Final = {"spacepoint", "point"}
_AXES: Final = ("x", "y", "z")
_DIRECTION: Final = ("nx", "ny", "nz")
_END: Final = "END"


def recognises(head: bytes) -> bool:
    """Return whether the first line has the names of a CALYPSO table, with tabs between them."""
    return len(_OURS & set(names_of(opening_text(head).split("\n")[0]))) > 1


def read(source: Source, units: str | None = None) -> PointSet:
    """Return the actual points of a table, compensated for the tip, frame `machine`.

    Parameters
    ----------
    source : Source
        Its hint `decimal` says what a comma means where the table leaves it open.
    units : str, optional
        Unit of length where the file states none; mm by default.

    Raises
    ------
    MalformedInputError
        With file, line, column and the offending text; also if what a comma means cannot be told.
    UnitsError
        If the file states several units, or another one than `units`.

    Notes
    -----
    Rows of features that are no points are left out, and told in `passed_over`.
    """
    where = source.where
    lines = decoded(source.raw, where).split("\n")
    index = names_of(lines[0])
    if not set(_AXES) <= set(index):
        raise MalformedInputError(
            "the table has no columns x, y, z",
            where=f"{where}:1:1",
            expected="the table of features (*_fet.txt); characteristics (*_chr.txt) are no points",
        )
    kinds = [index[name] for name in _KIND if name in index]
    rows = [row for row in rows_of(lines, where) if row.cell(0) != _END]
    points = [row for row in rows if any(row.cell(k).lower() in _POINTS for k in kinds)]
    others = [row for row in rows if not any(row.cell(k).lower() in _POINTS for k in kinds)]
    if not points:
        raise no_points(where, "rows of SpacePoint or Point")
    if lines[-1].strip() not in {"", _END}:
        raise cut_off(where, len(lines), "an end of line after the last row")
    unit = _unit(points, index, where)
    directed = all(name in index for name in _DIRECTION)
    for row in points if directed else ():
        _check_direction(row, index, where, source.hints.decimal)
    return PointSet.of(
        lengths(points, [index[axis] for axis in _AXES], where, source.hints.decimal)
        * scale_to_mm(unit, units, where),
        kind=PointKind.CONTACT,
        ids=numbers_of_names([row.cell(index["id"]) for row in points]) if "id" in index else None,
        source=where,
        passed_over=told(where, [(row.line, row.text, "a feature that is no point") for row in others]),
    )


def _unit(rows: list[Row], index: dict[str, int], where: str) -> str:
    """Return the one unit of all rows; empty if none is stated."""
    if "unit" not in index:
        return ""
    first = rows[0].cell(index["unit"])
    for row in rows:
        if (found := row.cell(index["unit"])) != first:
            raise UnitsError(
                f"unit {found[:SHOWN]!r} after {first[:SHOWN]!r}",
                where=row.place(index["unit"], where),
                expected="one unit",
            )
    return first


def _check_direction(row: Row, index: dict[str, int], where: str, decimal: str | None) -> None:
    columns = [index[name] for name in _DIRECTION]
    if any(row.cell(k) for k in columns):
        lengths([row], columns, where, decimal)
