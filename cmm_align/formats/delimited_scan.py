"""The numbers of a delimited text, block by block.

A block that is clean goes through NumPy's C reader; it is trusted only after a look at the characters and the
columns, because it would take more than we do. Whatever it refuses is read field by field, several times
slower, with words for where and why.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from cmm_align.errors import MalformedInputError
from cmm_align.formats.delimited_layout import Layout
from cmm_align.formats.delimited_lines import (
    MAX_LINE,
    PAIRED,
    blocks,
    data_lines,
    fields_of,
    is_passed_over,
    too_long,
    wrong_count,
)
from cmm_align.formats.number_signs import number_of
from cmm_align.surfaces.protocol import Array

_DIGITS: Final = "0123456789+-eE \n"
_TAB, _NEWLINE, _BLANK = b"\t\n "


def table_of(text: str, layout: Layout, where: str) -> Array:
    """Return the numbers of a text.

    Parameters
    ----------
    text : str
    layout : Layout
    where : str
        Name of the file.

    Returns
    -------
    ndarray, shape (N, len(layout.numbers))
        In the unit of the file.

    Raises
    ------
    MalformedInputError
        At the first field that is not as it should be, by file, line and column.
    """
    parts = []
    for number, block in blocks(text, layout.start, layout.first + 1):
        fast = _fast(block, layout)
        parts.append(scan(block, layout, where, number) if fast is None else fast)
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def words_in(text: str, layout: Layout, name: str) -> list[str]:
    """Return the fields of a column of words; `table_of` has seen before that all rows have it."""
    k = layout.columns.index[name]
    return [fields_of(line, layout.separator)[k][0] for _, line in rows_of(text, layout)]


def rows_of(text: str, layout: Layout) -> Iterator[tuple[int, str]]:
    """Give the lines with points, each with its number from 1."""
    return data_lines(text, layout.start, layout.first + 1)


def scan(block: str, layout: Layout, where: str, first: int = 1) -> Array:
    """Return the numbers of some lines, field by field.

    Parameters
    ----------
    block : str
        Whole lines.
    layout : Layout
    where : str
        Name of the file.
    first : int
        Number, from 1, of the first of the lines.

    Returns
    -------
    ndarray, shape (n, len(layout.numbers))

    Raises
    ------
    MalformedInputError
        At the first field that is not as it should be, by file, line and column.
    """
    used, count = layout.used, layout.columns.count
    rows: list[list[float]] = []
    for number, line in data_lines(block, 0, first):
        here = f"{where}:{number}"
        if len(line) > MAX_LINE:
            raise too_long(line, here)
        fields = fields_of(line, layout.separator)
        if len(fields) != count:
            raise wrong_count(fields, count, line, here)
        if layout.separator == PAIRED and (alone := next((f for f in fields if "," not in f[0]), None)):
            raise MalformedInputError(
                f"{alone[0][:40]!r} has no decimals",
                where=f"{here}:{alone[1]}",
                expected="every second comma to be decimal",
            )
        rows.append([number_of(*fields[k], layout.signs, here) for k in used])
    return np.array(rows, dtype=np.float64).reshape(-1, len(used))


def _fast(block: str, layout: Layout) -> Array | None:
    """Return the numbers of some lines, or None where the exact scan has to decide."""
    if layout.separator == PAIRED:
        return None
    if not _is_clean(block, layout):
        data = [line for line in block.split("\n") if not is_passed_over(line)]  # comments between the points
        block = "\n".join(data) + "\n"
        if not data or not _is_clean(block, layout):
            return None
    if layout.signs.decimal == ",":
        block = block.replace(",", ".")
    lines = block.removesuffix("\n").split("\n")
    if max(map(len, lines)) > MAX_LINE:
        return None
    used = None if _all_used(layout) else layout.used
    try:
        table = np.loadtxt(lines, delimiter=layout.separator, comments=None, ndmin=2, usecols=used)
    except ValueError:
        return None
    if table.shape[1] != len(layout.numbers) or not math.isfinite(table.sum()):
        return None
    return table


def _all_used(layout: Layout) -> bool:
    return layout.used == list(range(layout.columns.count))


def _is_clean(block: str, layout: Layout) -> bool:
    """Return whether NumPy and we make the same numbers of these lines, if it makes any."""
    if _all_used(layout):
        allowed = _DIGITS + layout.signs.decimal + (layout.separator or "\t")
        return block.isascii() and not block.encode("ascii").translate(None, allowed.encode())
    if layout.signs.decimal == "," and "." in block:
        return False
    return (block.isascii() or layout.separator is not None) and _is_regular(block, layout)


def _is_regular(block: str, layout: Layout) -> bool:
    """Return whether every line has as many fields as it should: NumPy leaves columns out unseen."""
    raw = np.frombuffer((block if block.endswith("\n") else block + "\n").encode(), dtype=np.uint8)
    ends = raw == _NEWLINE
    if layout.separator is None:
        inside = ~(ends | (raw == _BLANK) | (raw == _TAB))
        marks = inside & ~np.concatenate([[False], inside[:-1]])  # first characters of fields
        width = layout.columns.count + 1
    else:
        marks = raw == ord(layout.separator)
        width = layout.columns.count
    is_end = ends[np.flatnonzero(marks | ends)]
    if len(is_end) % width:
        return False
    by_line = is_end.reshape(-1, width)
    return bool(by_line[:, -1].all() and not by_line[:, :-1].any())


def first_place(text: str, layout: Layout, where: str, row: int, name: str) -> str:
    """Return file, line and column of a field, by the row and the meaning of its column."""
    for k, (number, line) in enumerate(rows_of(text, layout)):
        if k == row:
            return f"{where}:{number}:{fields_of(line, layout.separator)[layout.columns.index[name]][1]}"
    return where


def lines_at(text: str, layout: Layout, rows: Sequence[int]) -> list[tuple[int, str]]:
    """Return the lines of some rows, given in their order, each with its number from 1."""
    wanted = set(rows)
    return [one for k, one in enumerate(rows_of(text, layout)) if k in wanted] if wanted else []
