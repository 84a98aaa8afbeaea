"""Point tables of a laser tracker: tabs, padding, commas between thousands, a flag that enables each point.

Without a direction i, j, k the places are the centres of the reflector's ball, as the tracker measures them;
the column Probe is its diameter. Points whose flag is not set were taken out by the operator: they are left
out.
"""

from __future__ import annotations

from typing import Final

from cmm_align.errors import MalformedInputError
from cmm_align.formats.decoding import decoded
from cmm_align.formats.source import Source, scale_to_mm, told
from cmm_align.formats.statements import SHOWN, no_points, numbers_of_names, opening_text
from cmm_align.formats.tab_table import Row, lengths, names_of, rows_of
from cmm_align.model import PointKind, PointSet

_OURS: Final = {"enabled", "feature", "x", "y", "z", "device position"}
_AXES: Final = ("x", "y", "z")
_DIRECTION: Final = ("i", "j", "k")
_ENABLED: Final = {"checked": True, "unchecked": False}


def recognises(head: bytes) -> bool:
    """Return whether the first line has the names of a tracker's table, with tabs between them."""
    return set(names_of(opening_text(head).split("\n")[0])) >= _OURS


def read(source: Source, units: str | None = None) -> PointSet:
    """Return the enabled points of a table, frame `machine`; the others are told in `passed_over`.

    Parameters
    ----------
    source : Source
        Its hint `decimal` says what a comma means where the table leaves it open.
    units : str, optional
        Unit of length; mm by default, the file does not state it.

    Raises
    ------
    MalformedInputError
        With file, line, column and the offending text; also if what a comma means cannot be told.
    """
    where = source.where
    lines = decoded(source.raw, where).split("\n")
    index = names_of(lines[0])
    width = lines[0].rstrip().count("\t") + 1
    rows = rows_of(lines, where)
    for row in rows:
        if len(row.fields) < width:
            raise MalformedInputError(
                f"{len(row.fields)} columns", where=row.place(width, where), expected=f"{width}, as in line 1"
            )
    enabled = [row for row in rows if _is_enabled(row, index["enabled"], where)]
    others = [row for row in rows if not _is_enabled(row, index["enabled"], where)]
    if not enabled:
        raise no_points(where, "rows with the flag Checked")
    directions = [index[name] for name in _DIRECTION if name in index]
    directed = [row for row in enabled if any(row.cell(k) for k in directions)]
    lengths(directed, directions, where, source.hints.decimal)  # only to see that they are numbers
    return PointSet.of(
        lengths(enabled, [index[axis] for axis in _AXES], where, source.hints.decimal)
        * scale_to_mm("", units, where),
        kind=PointKind.UNSTATED if directed else PointKind.TIP_CENTRE,
        ids=numbers_of_names([row.cell(index["id"]) for row in enabled]) if "id" in index else None,
        source=where,
        passed_over=told(where, [(row.line, row.text, "its flag is not Checked") for row in others]),
    )


def _is_enabled(row: Row, k: int, where: str) -> bool:
    flag = _ENABLED.get(row.cell(k).lower())
    if flag is None:
        raise MalformedInputError(
            f"flag {row.cell(k)[:SHOWN]!r}", where=row.place(k, where), expected="Checked or Unchecked"
        )
    return flag
