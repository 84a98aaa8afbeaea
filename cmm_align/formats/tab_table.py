"""Tables with tabs between the columns, names in the first line, and lengths as people print them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np

from cmm_align.errors import MalformedInputError
from cmm_align.formats.number_signs import Field, number_of, signs_of
from cmm_align.surfaces.protocol import Array


class Row(NamedTuple):
    """A line of a table."""

    line: int
    """Its number, from 1."""
    fields: tuple[str, ...]
    """As written, with the blanks around them."""

    @property
    def text(self) -> str:
        """The line."""
        return "\t".join(self.fields)

    def cell(self, k: int) -> str:
        """Return a field without blanks; empty where the row is shorter."""
        return self.fields[k].strip() if k < len(self.fields) else ""

    def column(self, k: int) -> int:
        """Return where in its line, from 1, a field starts; the end of the line if the row is shorter."""
        before = sum(len(text) + 1 for text in self.fields[:k])
        if k >= len(self.fields):
            return before
        blanks = len(self.fields[k]) - len(self.fields[k].lstrip()) if self.fields[k].strip() else 0
        return before + blanks + 1

    def place(self, k: int, where: str) -> str:
        """Return ``file:line:column`` of a field."""
        return f"{where}:{self.line}:{self.column(k)}"


def names_of(line: str) -> dict[str, int]:
    """Return where the columns of a first line are, by their names in lower case."""
    names = [name.strip().lower() for name in line.split("\t")]
    return {name: k for k, name in reversed(list(enumerate(names))) if name}


def rows_of(lines: Sequence[str], where: str) -> list[Row]:
    """Return the rows below the names; blank lines are passed over.

    Raises
    ------
    MalformedInputError
        If a row has more fields than there are names.
    """
    width = lines[0].count("\t") + 1
    rows = [Row(n, tuple(line.split("\t"))) for n, line in enumerate(lines[1:], 2) if line.strip()]
    for row in rows:
        if len(row.fields) > width and any(text.strip() for text in row.fields[width:]):
            raise MalformedInputError(
                f"{len(row.fields)} columns", where=row.place(width, where), expected=f"{width}, as in line 1"
            )
    return rows


def lengths(rows: Sequence[Row], columns: Sequence[int], where: str, decimal: str | None = None) -> Array:
    """Return the lengths in some columns; what a comma in them means is decided once for all of them.

    Parameters
    ----------
    rows : sequence of Row
    columns : sequence of int
    where : str
        Name of the file.
    decimal : str, optional
        Decimal sign by the word of the user.

    Returns
    -------
    ndarray, shape (len(rows), len(columns))
        In the unit of the file.

    Raises
    ------
    MalformedInputError
        If a field is no number, or may be two of them: see `signs_of`.
    """
    cells = [[Field(row.cell(k), row.place(k, where)) for k in columns] for row in rows]
    signs = signs_of(chain.from_iterable(cells), chain.from_iterable(cells), decimal)
    values = [
        [
            number_of(cell.text, row.column(k), signs, f"{where}:{row.line}")
            for cell, k in zip(line, columns, strict=True)
        ]
        for row, line in zip(rows, cells, strict=True)
    ]
    return np.array(values, dtype=np.float64).reshape(len(rows), len(columns))
