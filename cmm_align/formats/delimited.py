"""Points as text: columns between commas, semicolons, tabs or blanks.

The clean case goes through NumPy's C reader; it is trusted only after a look at the characters, because
it would take more than we do. Whatever it refuses goes to `delimited_scan`, which says where and why.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import islice
from typing import Final, TypeAlias

import numpy as np

from cmm_align.errors import MalformedInputError
from cmm_align.formats.decoding import decoded
from cmm_align.formats.delimited_layout import Layout, fields_of, is_passed_over, layout_of
from cmm_align.formats.delimited_scan import data_lines, scan
from cmm_align.formats.source import Source, scale_to_mm
from cmm_align.model import PointSet
from cmm_align.surfaces.protocol import Array, Mask

PlaceOf: TypeAlias = Callable[[int, int], str]
"""Gives file, line and column of a field, by its row and column in the table."""

_UNIT_LENGTH: Final = (0.9, 1.1)
_MAX_EXACT_ID: Final = 2.0**53


def recognises(head: bytes) -> bool:
    """Return whether a file may be text: the last guess, taken if no other format knows the file."""
    return bool(head)


def read(source: Source, units: str | None = None) -> PointSet:
    """Return the points of a delimited text.

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
    layout = layout_of(lines, where)
    stated = _stated_unit(layout, where)
    scale = scale_to_mm(stated, units, where)
    table = _fast(lines, layout)
    if table is None:
        table = scan(lines, layout, where)
    index = layout.columns.index
    place = partial(_place, lines, layout, where)
    if not layout.named and "k" in index:
        _check_normals(table, place)
    if "sigma" in index:
        _refuse(table[:, index["sigma"]] <= 0.0, table, index["sigma"], "sigma", "above 0", place)
    if "weight" in index:
        _check_weights(table, index["weight"], place)
    points = table[:, [index["x"], index["y"], index["z"]]] if len(index) > 3 or layout.named else table
    ids = _whole(table, index["id"], place) if "id" in index else None
    return PointSet.of(
        points if scale == 1.0 else points * scale,
        kind=layout.header.kind,
        frame=layout.header.frame,
        ids=ids,
        source=where,
        sigma_mm=table[:, index["sigma"]] * scale if "sigma" in index else None,
        weight=table[:, index["weight"]] if "weight" in index else None,
    )


def _stated_unit(layout: Layout, where: str) -> str:
    header, columns = layout.header.units, layout.columns.units
    if header and columns:
        scale_to_mm(header, columns, where)
    return header or columns


def _fast(lines: Sequence[str], layout: Layout) -> Array | None:
    """Return the table, or None where the exact scan has to decide."""
    data = list(lines[layout.first :])
    if not _is_plain(data, layout):
        data = [line for line in data if not is_passed_over(line)]  # comments between the points
        if not _is_plain(data, layout):
            return None
    if layout.decimal == ",":
        data = "\n".join(data).replace(",", ".").split("\n")
    try:
        table = np.loadtxt(data, delimiter=layout.separator, comments=None, ndmin=2)
    except ValueError:
        return None
    if table.shape[1] != layout.columns.count or not np.isfinite(table).all():
        return None
    return table


def _is_plain(data: Sequence[str], layout: Layout) -> bool:
    """Return whether there are only characters of which NumPy and we make the same numbers."""
    allowed = "0123456789+-eE \n" + layout.decimal + (layout.separator or "\t")
    text = "\n".join(data)
    return text.isascii() and not text.encode("ascii").translate(None, allowed.encode())


def _check_normals(table: Array, place: PlaceOf) -> None:
    length = np.linalg.norm(table[:, 3:6], axis=1)
    wrong = (length < _UNIT_LENGTH[0]) | (length > _UNIT_LENGTH[1])
    if wrong.any():
        row = int(np.argmax(wrong))
        raise MalformedInputError(
            f"columns 4 to 6 are no unit vector (length {length[row]:.3g})",
            where=place(row, 3),
            expected="x y z i j k, or a line that names the columns",
        )


def _check_weights(table: Array, column: int, place: PlaceOf) -> None:
    _refuse(table[:, column] < 0.0, table, column, "weight", "0 or more", place)
    if not table[:, column].any():
        raise MalformedInputError("all weights are 0", where=place(0, column), expected="some above 0")


def _whole(table: Array, column: int, place: PlaceOf) -> Array:
    values = table[:, column]
    wrong = (values != np.round(values)) | (np.abs(values) > _MAX_EXACT_ID)
    _refuse(wrong, table, column, "id", "a whole number", place)
    return values.astype(np.int64)


def _refuse(wrong: Mask, table: Array, column: int, name: str, expected: str, place: PlaceOf) -> None:
    """Raise at the first wrong value of a column, if there is one."""
    if wrong.any():
        row = int(np.argmax(wrong))
        raise MalformedInputError(
            f"{name} {table[row, column]:.12g}", where=place(row, column), expected=expected
        )


def _place(lines: Sequence[str], layout: Layout, where: str, row: int, column: int) -> str:
    number, line = next(islice(data_lines(lines, layout), row, None))
    return f"{where}:{number}:{fields_of(line, layout.separator)[column][1]}"
