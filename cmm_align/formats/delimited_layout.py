"""How a delimited text is laid out: separator, signs in its numbers, and which column is what."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

from cmm_align.errors import MalformedInputError, UnitsError
from cmm_align.formats.column_names import AXES, Columns, given_columns, read_columns, role_of
from cmm_align.formats.delimited_lines import (
    PAIRED,
    data_lines,
    fields_of,
    opening_lines,
    sample_lines,
    words_of,
    wrong_count,
)
from cmm_align.formats.delimited_preamble import Opening, is_number_like, opening_of, unit_row
from cmm_align.formats.number_signs import Field, Signs, signs_of
from cmm_align.formats.points_header import Header
from cmm_align.formats.source import NO_HINTS, Hints

_COMMA_NUMBER: Final = re.compile(r"[+-]?\d+(?:,\d+)?(?:[eEdD][+-]?\d+)?", re.ASCII)
_GROUPED_NUMBER: Final = re.compile(r"[+-]?(?:\d+|\d{1,3}(?:,\d{3})+)\.\d*", re.ASCII)
_COMMA_BETWEEN_DIGITS: Final = re.compile(r"\d,\d")
_INTEGER: Final = re.compile(r"\s*[+-]?\d+\s*", re.ASCII)
_LETTER: Final = re.compile(r"[^\W\d_]")
_UNNAMED: Final = {3: ("x", "y", "z"), 6: ("x", "y", "z", "i", "j", "k")}
_WORDS: Final = frozenset({"unit"})
"""Columns that hold words."""

Sample = Sequence[tuple[int, str]]


class Layout(NamedTuple):
    """The layout of a delimited text."""

    first: int
    """Number, from 0, of the first line with data."""
    start: int
    """Its place in the text."""
    separator: str | None
    """Between columns; None for any run of blanks, `PAIRED` for every second comma."""
    signs: Signs
    columns: Columns
    named: bool
    header: Header
    numbers: tuple[str, ...]
    """Meanings of the columns that hold numbers, in the order of their table."""
    units: str
    """Unit that a line above the data states."""
    announced: tuple[int, int] | None
    """Number of points that a line announces, and the number from 0 of that line."""

    @property
    def used(self) -> list[int]:
        """Columns that hold numbers, in the order of their table."""
        return [self.columns.index[name] for name in self.numbers]


def layout_of(text: str, where: str, hints: Hints = NO_HINTS) -> Layout:
    """Return the layout of a text, decided once.

    Parameters
    ----------
    text : str
    where : str
        Name of the file.
    hints : Hints
        What the user says of it.

    Raises
    ------
    MalformedInputError
        If there are no points, the text can be read in two ways, or it is not what the user says.
    UnitsError
        If it states several units.
    """
    lines = opening_lines(text)
    opening = opening_of(lines, where)
    sample = sample_lines(lines, opening.first, where)
    if not sample:
        raise MalformedInputError("there are no points in it", where=where, expected="lines of x, y, z")
    separator = separator_of(sample)
    if separator == "," and hints.decimal == ",":
        separator = PAIRED
        _refuse_unpaired(sample, where)
    count = len(fields_of(sample[0][1], separator))
    named, units = _named(opening, sample, separator, count, where)
    columns = _columns(sample, separator, count, named, where, hints)
    if units is not None:
        columns = _with_units(columns, units, f"{where}:{opening.first}:1")
    start = sum(len(line) + 1 for line in lines[: opening.first])
    signs = Signs(",") if separator == PAIRED else Signs()
    words = _WORDS | {name for name in ("id", "quality") if _is_words(sample, separator, columns, name)}
    numbers = tuple(name for name in columns.index if name not in words)
    layout = Layout(
        opening.first,
        start,
        separator,
        signs,
        columns,
        named is not None,
        opening.header,
        numbers,
        opening.units,
        opening.announced,
    )
    if separator in {",", PAIRED}:
        return layout
    whole = _fields(data_lines(text, start, opening.first + 1), layout, where)
    of_sample = _fields(((number + 1, line) for number, line in sample), layout, where)
    return layout._replace(signs=signs_of(of_sample, whole, hints.decimal))


def _fields(lines: Iterator[tuple[int, str]], layout: Layout, where: str) -> Iterator[Field]:
    """Give the fields of the columns with lengths."""
    lengths = [layout.columns.index[name] for name in (*AXES, "sigma") if name in layout.numbers]
    for number, line in lines:
        fields = fields_of(line, layout.separator)
        if len(fields) == layout.columns.count:
            for k in lengths:
                yield Field(fields[k][0], f"{where}:{number}:{fields[k][1]}")


def separator_of(sample: Sample) -> str | None:
    """Return what stands between the columns; None for blanks."""
    text = "\n".join(line for _, line in sample)
    if ";" in text:
        return ";"
    if "\t" in text and ("," not in text or _COMMA_BETWEEN_DIGITS.search(text)):
        return "\t"
    if "," not in text:
        return None
    parts = [line.split() for _, line in sample]
    numeric = [[part for part in row if is_number_like(part)] for row in parts]
    for pattern in (_COMMA_NUMBER, _GROUPED_NUMBER):
        if all(len(row) > 2 and all(pattern.fullmatch(part) for part in row) for row in numeric):
            return None
    return ","


def _named(
    opening: Opening, sample: Sample, separator: str | None, count: int, where: str
) -> tuple[tuple[list[str], str, list[str]] | None, list[str] | None]:
    """Return the names of the columns, their place and the roles above them, and a row of units."""
    headings = list(opening.headings)
    units = None
    if headings:
        units = unit_row(headings[-1][1], _of_row(headings[-1][1], separator))
        if units is not None and len(units) in {1, count}:
            headings.pop()
        else:
            units = None
    if not headings:
        return None, units
    number, line = headings[-1]
    words = words_of(line, separator, count)
    if len(words) == count - 1 and _names_points(words):
        words = [*words, ""]  # a separator at the end of the rows only
    here = f"{where}:{number + 1}:1"
    found = [word for word in words if not is_number_like(word)]
    if number in opening.comments:
        if len(words) != count or not _names_points(words):
            return None, units
    elif len(words) != count or len(found) < len(words):
        if _names_points(words):
            first, data = sample[0]
            raise wrong_count(fields_of(data, separator), len(words), data, f"{where}:{first + 1}")
        return None, units
    roles: list[str] = []
    if len(headings) > 1:
        above = [text for text, _ in fields_of(headings[-2][1], _of_row(headings[-2][1], separator))]
        if len(above) <= count and any(role_of(text) is not None for text in above):
            roles = _spread(above, count)
    return (words, here, roles), units


def _of_row(line: str, separator: str | None) -> str | None:
    """Return the separator of a line above the data, which may not have that of the data."""
    return separator if separator is not None and separator != PAIRED and separator in line else None


def _spread(above: Sequence[str], count: int) -> list[str]:
    """Return the role of each column under headings that stand over the first of theirs."""
    roles, role = [], ""
    for k in range(count):
        text = above[k] if k < len(above) else ""
        if text:
            role = role_of(text) or ""
        roles.append(role)
    return roles


def _names_points(words: Sequence[str]) -> bool:
    try:
        read_columns(words, "")
    except MalformedInputError:
        return False
    return True


def _columns(
    sample: Sample,
    separator: str | None,
    count: int,
    named: tuple[list[str], str, list[str]] | None,
    where: str,
    hints: Hints,
) -> Columns:
    number, line = sample[0]
    here = f"{where}:{number + 1}:1"
    if hints.columns is not None:
        given = given_columns(hints.columns)
        if given.count != count:
            raise MalformedInputError(
                f"{count} columns in {line.strip()[:40]!r}",
                where=here,
                expected=f"{given.count}, as --columns {hints.columns}",
            )
        if named is not None and _names_points(named[0]):
            stated = read_columns(*named)
            if any(stated.index[axis] != given.index[axis] for axis in AXES):
                raise MalformedInputError(
                    f"the names {' '.join(named[0])[:60]!r} are not those of --columns {hints.columns}",
                    where=named[1],
                    expected="x, y and z in the same columns",
                    remedy="leave --columns out, or mend the file",
                )
            return Columns(given.index, count, stated.units, stated.is_nominal)
        return given
    if named is not None:
        return read_columns(*named)
    fields = [text for text, _ in fields_of(line, separator)]
    filled = count
    while filled > 3 and all(not _text(row, separator, filled - 1) for _, row in sample):
        filled -= 1  # separators at the end of every row
    first = int(filled - 1 in _UNNAMED and not is_number_like(fields[0]) and bool(fields[0]))
    names = _UNNAMED.get(filled - first)
    if names is None or (separator == "," and filled in {4, 6} and _only_integers(sample)):
        raise _unknown_columns(line, separator, filled, here, sample)
    index = {name: k for k, name in enumerate(names, first)}
    return Columns({"id": 0, **index} if first else index, count)


def _text(line: str, separator: str | None, k: int) -> str:
    fields = fields_of(line, separator)
    return fields[k][0] if k < len(fields) else "short"


def _unknown_columns(
    line: str, separator: str | None, count: int, here: str, sample: Sample
) -> MalformedInputError:
    if separator == "," and count in {4, 6} and _only_integers(sample):
        return MalformedInputError(
            f"{line.strip()[:40]!r} has two readings: {count} whole numbers, {count // 2} decimal commas",
            where=here,
            expected="a decimal point, or ; between columns",
            remedy='say it with --decimal , or name the columns with --columns "id,x,y,z"',
        )
    return MalformedInputError(
        f"{count} column{'s' if count > 1 else ''} in {line.strip()[:40]!r}",
        where=here,
        expected="3 (x y z) or 6 (x y z i j k), or a line with their names",
        remedy='name them with --columns "id,x,y,z" (- for a column that is not wanted)' if count > 3 else "",
    )


def _refuse_unpaired(sample: Sample, where: str) -> None:
    """Refuse commas between the columns that the word of the user makes decimal, and cannot be."""
    for number, line in sample:
        if any("," not in text for text, _ in fields_of(line, PAIRED)) or "." in line:
            raise MalformedInputError(
                f"{line.strip()[:40]!r} has commas between its columns",
                where=f"{where}:{number + 1}:1",
                expected="every second comma decimal, as --decimal , says",
            )


def _is_words(sample: Sample, separator: str | None, columns: Columns, name: str) -> bool:
    """Return whether a column holds words; decided by its first fields."""
    k = columns.index.get(name)
    if k is None:
        return False
    texts = [_text(line, separator, k) for _, line in sample]
    return any(_LETTER.search(text) or not is_number_like(text) for text in texts)


def _with_units(columns: Columns, units: Sequence[str], where: str) -> Columns:
    """Return columns with the units of the row below their names."""
    if len(units) == 1 and len(units) != columns.count:
        units = [units[0]] * columns.count
    lengths = {*AXES, "sigma"}
    below = {name: units[k] for name, k in columns.index.items() if name in lengths and units[k]}
    if any(columns.units.get(name, unit) != unit for name, unit in below.items()):
        raise UnitsError(
            "two units for one column", where=where, expected="the same in its name and below it"
        )
    return Columns(columns.index, columns.count, {**columns.units, **below}, columns.is_nominal)


def _only_integers(sample: Sample) -> bool:
    return all(_INTEGER.fullmatch(part) for _, line in sample for part in line.split(","))
