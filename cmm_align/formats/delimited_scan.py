"""The exact reading of a delimited text, field by field, that says where and why it fails.

It is several times slower than `delimited`'s way, and runs only where that one gives up.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from cmm_align.errors import MalformedInputError
from cmm_align.formats.delimited_layout import MAX_LINE, Layout, fields_of, is_passed_over
from cmm_align.surfaces.protocol import Array

_NUMBER: Final = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][+-]?\d+)?", re.ASCII)
_NOT_FINITE: Final = re.compile(r"[+-]?(?:nan|inf|infinity)|1\.#\w+", re.IGNORECASE)


def data_lines(lines: Sequence[str], layout: Layout) -> Iterator[tuple[int, str]]:
    """Give the lines that hold points, each with its number from 1."""
    for number in range(layout.first, len(lines)):
        if not is_passed_over(lines[number]):
            yield number + 1, lines[number]


def scan(lines: Sequence[str], layout: Layout, where: str) -> Array:
    """Return the columns of a text, NaN in columns that mean nothing to us.

    Returns
    -------
    ndarray, shape (N, layout.columns.count)
        In the unit of the file.

    Raises
    ------
    MalformedInputError
        At the first field that is not as it should be, by file, line and column.
    """
    used = sorted(layout.columns.index.values())
    count = layout.columns.count
    rows: list[list[float]] = []
    plain = _plain_row(layout)
    for number, line in data_lines(lines, layout):
        if plain is not None and len(line) <= MAX_LINE and plain.fullmatch(line):
            values = [float(part) for part in line.split(layout.separator)]
            if all(map(math.isfinite, values)):
                rows.append(values)
                continue
        here = f"{where}:{number}"
        if len(line) > MAX_LINE:
            raise MalformedInputError(
                f"a line of {len(line)} characters", where=f"{here}:1", expected=f"at most {MAX_LINE}"
            )
        fields = fields_of(line, layout.separator)
        if len(fields) != count:
            raise wrong_count(fields, count, line, here)
        row = [math.nan] * count
        for k in used:
            row[k] = number_of(*fields[k], layout.decimal, here)
        rows.append(row)
    return np.array(rows, dtype=np.float64).reshape(-1, count)


def _plain_row(layout: Layout) -> re.Pattern[str] | None:
    """Return what a whole row of plain numbers looks like: most rows need no closer look."""
    if layout.decimal == "," or len(layout.columns.index) != layout.columns.count:
        return None
    blank = r"\s*" if layout.separator is None else "[ ]*"
    number = blank + r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
    between = r"(?=\s)" if layout.separator is None else r"[ ]*" + re.escape(layout.separator)
    return re.compile(between.join([number] * layout.columns.count) + r"\s*", re.ASCII)


def wrong_count(fields: list[tuple[str, int]], count: int, line: str, here: str) -> MalformedInputError:
    """Return the error of a line with too many or too few fields."""
    extra = len(fields) > count
    column = fields[count][1] if extra else len(line.rstrip()) + 1
    what = f"{len(fields)} columns"
    if extra and not fields[count][0]:
        what += " (a separator at the end?)"
    return MalformedInputError(
        f"{what} in {line.strip()[:60]!r}", where=f"{here}:{column}", expected=f"{count}"
    )


def number_of(text: str, column: int, decimal: str, here: str) -> float:
    """Return the number that a field at a place (from 1) of the line `here` holds.

    Raises
    ------
    MalformedInputError
        If it is empty, not a number, or not finite.
    """
    where = f"{here}:{column}"
    if not text:
        raise MalformedInputError("an empty field", where=where, expected="a number")
    if decimal == "," and "." in text:
        raise MalformedInputError(
            f"{text[:40]!r} is not a number", where=where, expected="a decimal comma, as in the lines before"
        )
    plain = text.replace(",", ".") if decimal == "," else text
    if not _NUMBER.fullmatch(plain):
        if _NOT_FINITE.fullmatch(plain):
            raise MalformedInputError(
                f"{text[:40]!r} is not finite", where=where, expected="a number", remedy="remove this point"
            )
        remedy = "write a decimal point and no thousands separators" if "," in text else ""
        raise MalformedInputError(
            f"{text[:40]!r} is not a number", where=where, expected="a number", remedy=remedy
        )
    value = float(plain.replace("d", "e").replace("D", "e"))
    if not math.isfinite(value):
        raise MalformedInputError(f"{text[:40]!r} is too large", where=where, expected="a finite number")
    return value
