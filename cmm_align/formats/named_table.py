"""Tables with names in the first line: what reads limits, weights and datum points.

Separators, decimal comma, comments and encodings are those of delimited points. Columns nobody asks for are
passed over.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple, TypeVar

import numpy as np

from cmm_align.errors import MalformedInputError, UnitsError
from cmm_align.formats.column_names import name_and_unit
from cmm_align.formats.decoding import decoded
from cmm_align.formats.delimited_layout import separator_of
from cmm_align.formats.delimited_lines import fields_of, is_passed_over, sample_lines, wrong_count
from cmm_align.formats.delimited_preamble import is_number_like
from cmm_align.formats.number_signs import Field, Signs, number_of, signs_of
from cmm_align.formats.source import load
from cmm_align.model import IntArray, frozen_array
from cmm_align.surfaces.protocol import Array
from cmm_align.units import mm_per

_NO_VALUE: Final = {"", "-", "nan", "inf", "+inf", "-inf", "infinity", "-infinity"}
_MAX_ID: Final = 2.0**53
_Key = TypeVar("_Key", int, str)


class Row(NamedTuple):
    """A line of a table."""

    here: str
    """File and line."""
    fields: list[tuple[str, int]]
    """Each with the place in the line, from 1, where it starts."""

    def place(self, column: int) -> str:
        """Return file, line and column of a field."""
        return f"{self.here}:{self.fields[column][1]}"


class Table(NamedTuple):
    """A table as text."""

    columns: dict[str, int]
    """Where they are, by bare name: in lower case, without unit, blanks, points and underscores."""
    units: dict[str, str]
    """Unit of length that each name states; empty where it states none."""
    rows: list[Row]
    signs: Signs
    where: str


def read_table(path: Path | str, needed: Sequence[str]) -> Table:
    """Return a table that has at least the columns needed.

    Parameters
    ----------
    path : path
    needed : sequence of str
        Names of columns, without units.

    Raises
    ------
    MissingFileError, MalformedInputError
        If it cannot be read, a column is missing or there twice, or a row has another number of fields.
    """
    source = load(path)
    where = source.where
    lines = decoded(source.raw, where).split("\n")
    first = next((k for k, line in enumerate(lines) if not is_passed_over(line)), len(lines))
    sample = sample_lines(lines, first + 1, where)
    if not sample:
        raise MalformedInputError(
            "there are no rows in it", where=where, expected="a line of names, then a line for each point"
        )
    separator = separator_of(sample)
    names = fields_of(lines[first], _separator_of_names(lines[first], separator))
    columns: dict[str, int] = {}
    units: dict[str, str] = {}
    for position, (written, at) in enumerate(names):
        name, unit = name_and_unit(written)
        if name and name in columns:
            raise MalformedInputError(
                f"two columns {name}", where=f"{where}:{first + 1}:{at}", expected="each name once"
            )
        columns[name], units[name] = position, unit
    missing = [name for name in needed if name.replace("_", "") not in columns]
    if missing:
        raise MalformedInputError(
            f"no column {', '.join(missing)} in {lines[first].strip()[:60]!r}",
            where=f"{where}:{first + 1}:1",
            expected=f"a line of names: {', '.join(needed)}",
        )
    rows = []
    for number in range(first + 1, len(lines)):
        if is_passed_over(lines[number]):
            continue
        fields = fields_of(lines[number], separator)
        if len(fields) != len(names):
            raise wrong_count(fields, len(names), lines[number], f"{where}:{number + 1}")
        rows.append(Row(f"{where}:{number + 1}", fields))
    return Table(columns, units, rows, _signs(rows, separator), where)


def _separator_of_names(line: str, separator: str | None) -> str | None:
    """Return what stands between the names of the columns, which may not be what the data have."""
    return next((mark for mark in (separator, ";", "\t", ",") if mark is not None and mark in line), None)


def _signs(rows: Sequence[Row], separator: str | None) -> Signs:
    """Return the signs in the numbers of a table."""
    if separator == ",":
        return Signs()
    fields = [
        Field(text, f"{row.here}:{at}") for row in rows for text, at in row.fields if is_number_like(text)
    ]
    return signs_of(fields, iter(fields), None)


def ids_of(table: Table) -> IntArray:
    """Return the column `id`.

    Returns
    -------
    ndarray of int64, shape (n,)

    Raises
    ------
    MalformedInputError
        If one is no whole number, or there twice.
    """
    column = table.columns["id"]
    seen: dict[int, str] = {}
    for row in table.rows:
        value = number_of(*row.fields[column], table.signs, row.here)
        if value != round(value) or abs(value) > _MAX_ID:
            raise MalformedInputError(f"id {value:.12g}", where=row.place(column), expected="a whole number")
        _once(seen, int(value), f"id {int(value)}", row.place(column))
    ids: IntArray = frozen_array(list(seen), np.int64)
    return ids


def names_of(table: Table) -> tuple[str, ...]:
    """Return the column `name`.

    Raises
    ------
    MalformedInputError
        If one is empty, or there twice.
    """
    column = table.columns["name"]
    seen: dict[str, str] = {}
    for row in table.rows:
        name = row.fields[column][0].strip("\"'")
        if not name:
            raise MalformedInputError("an empty name", where=row.place(column), expected="a name")
        _once(seen, name, f"the name {name!r}", row.place(column))
    return tuple(seen)


def _once(seen: dict[_Key, str], key: _Key, words: str, place: str) -> None:
    """Note a key and its place; refuse it the second time."""
    if key in seen:
        raise MalformedInputError(
            f"{words} is there twice", where=place, expected=f"each once (first at {seen[key]})"
        )
    seen[key] = place


def numbers_of(table: Table, name: str) -> Array:
    """Return a column of numbers without a unit, shape (n,).

    Raises
    ------
    MalformedInputError
        If a field holds none, or the name of the column states a unit.
    """
    if table.units[name]:
        raise MalformedInputError(
            f"column {name} in {table.units[name]}", where=table.where, expected=f"{name}, without a unit"
        )
    column = table.columns[name]
    return np.array([number_of(*row.fields[column], table.signs, row.here) for row in table.rows])


def lengths_mm(table: Table, name: str, units: str | None, without: float | None = None) -> Array:
    """Return a column of lengths, shape (n,), mm.

    Parameters
    ----------
    table : Table
    name : str
        Bare name of the column.
    units : str, optional
        Unit of a column whose name states none.
    without : float, optional
        What an empty field, nan or inf stands for; such fields are refused without it.

    Raises
    ------
    UnitsError
        If there is no unit, or one that is not known.
    MalformedInputError
        If a field holds no number.
    """
    unit = table.units[name] or units
    if not unit:
        raise UnitsError(
            f"column {name} states no unit",
            where=table.where,
            expected=f"{name}_um, {name}_mm ...",
            remedy="name the unit, or give --units",
        )
    scale = mm_per(unit, where=table.where)
    column = table.columns[name]
    values = np.empty(len(table.rows))
    for k, row in enumerate(table.rows):
        text, at = row.fields[column]
        if without is not None and text.lower() in _NO_VALUE:
            values[k] = without
        else:
            values[k] = scale * number_of(text, at, table.signs, row.here)
    return values
