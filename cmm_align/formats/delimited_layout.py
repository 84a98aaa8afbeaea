"""How a delimited text is laid out: separator, decimal sign, and which column is what."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final, NamedTuple

from cmm_align.errors import MalformedInputError
from cmm_align.formats.points_header import MARK, Columns, Header, read_columns, read_header

COMMENT_MARKS: Final = ("#", "%", "!", "//")
MAX_LINE: Final = 65536
_SAMPLE_LINES: Final = 50
_STARTS_AS_NUMBER: Final = re.compile(r"[+\-−]?[.,]?\d")
_COMMA_NUMBER: Final = re.compile(r"[+-]?\d+(?:,\d+)?(?:[eEdD][+-]?\d+)?", re.ASCII)
_COMMA_BETWEEN_DIGITS: Final = re.compile(r"\d,\d")
_INTEGER: Final = re.compile(r"\s*[+-]?\d+\s*", re.ASCII)
_UNNAMED: Final = {3: ("x", "y", "z"), 6: ("x", "y", "z", "i", "j", "k")}


class Layout(NamedTuple):
    """The layout of a delimited text."""

    first: int
    """Number, from 0, of the first line with data."""
    separator: str | None
    """Between columns; None for any run of blanks."""
    decimal: str
    columns: Columns
    named: bool
    header: Header


def is_passed_over(line: str) -> bool:
    """Return whether a line is blank or a comment."""
    stripped = line.lstrip()
    return not stripped or stripped.startswith(COMMENT_MARKS)


def fields_of(line: str, separator: str | None) -> list[tuple[str, int]]:
    """Return the fields of a line, each with the place (from 1) where it starts."""
    if separator is None:
        return [(match[0], match.start() + 1) for match in re.finditer(r"\S+", line)]
    fields, start = [], 0
    for part in line.split(separator):
        text = part.strip()
        fields.append((text, start + 1 + (len(part) - len(part.lstrip()) if text else 0)))
        start += len(part) + 1
    return fields


def layout_of(lines: Sequence[str], where: str) -> Layout:
    """Return the layout of a text, decided once from its first lines.

    Raises
    ------
    MalformedInputError
        If there are no points, or the text can be read in two ways.
    """
    header, names, first = _preamble(lines, where)
    sample = sample_lines(lines, first, where)
    if not sample:
        raise MalformedInputError("there are no points in it", where=where, expected="lines of x, y, z")
    separator, decimal = separator_of(sample, where)
    first_number, first_line = sample[0]
    here = f"{where}:{first_number + 1}"
    if names is not None:
        number, line = names
        parts = [text for text, _ in fields_of(line, separator_of_names(line, separator))]
        return Layout(first, separator, decimal, read_columns(parts, f"{where}:{number + 1}:1"), True, header)
    count = len(fields_of(first_line, separator))
    if separator == "," and count in {4, 6} and all(_all_integers(line) for _, line in sample):
        raise MalformedInputError(
            f"{first_line.strip()!r} has two readings: {count} whole numbers, {count // 2} decimal commas",
            where=f"{here}:1",
            expected="a decimal point, or ; between columns",
            remedy="name the columns in a first line (x,y,z,...) or write the file anew",
        )
    if count not in _UNNAMED:
        raise MalformedInputError(
            f"{count} column{'s' if count > 1 else ''} in {first_line.strip()[:40]!r}",
            where=f"{here}:1",
            expected="3 (x y z) or 6 (x y z i j k), or a line with their names",
        )
    columns = Columns({name: k for k, name in enumerate(_UNNAMED[count])}, count, "")
    return Layout(first, separator, decimal, columns, False, header)


def sample_lines(lines: Sequence[str], first: int, where: str) -> list[tuple[int, str]]:
    """Return the first lines with data, each with its number from 0.

    Parameters
    ----------
    lines : sequence of str
    first : int
        Number, from 0, of the line to begin with.
    where : str

    Raises
    ------
    MalformedInputError
        If one of them is too long for text of this kind.
    """
    sample: list[tuple[int, str]] = []
    for number in range(first, len(lines)):
        line = lines[number]
        if len(line) > MAX_LINE:
            raise MalformedInputError(
                f"a line of {len(line)} characters",
                where=f"{where}:{number + 1}:1",
                expected=f"at most {MAX_LINE}",
            )
        if not is_passed_over(line):
            sample.append((number, line))
        if len(sample) == _SAMPLE_LINES:
            break
    return sample


def _preamble(lines: Sequence[str], where: str) -> tuple[Header, tuple[int, str] | None, int]:
    header = Header()
    for number, line in enumerate(lines):
        stripped = line.strip()
        if stripped.startswith(MARK):
            header = read_header(stripped, f"{where}:{number + 1}:1")
        elif not is_passed_over(line):
            if _STARTS_AS_NUMBER.match(stripped) or stripped[0] in ",;":
                return header, None, number
            return header, (number, line), number + 1
    return header, None, len(lines)


def separator_of(sample: Sequence[tuple[int, str]], where: str) -> tuple[str | None, str]:
    """Return what stands between the columns (None: blanks) and the decimal sign.

    Raises
    ------
    MalformedInputError
        If both signs are in the numbers.
    """
    text = "\n".join(line for _, line in sample)
    for mark in (";", "\t"):
        if mark not in text:
            continue
        if "," not in text:
            return mark, "."
        if not _COMMA_BETWEEN_DIGITS.search(text):
            return ("," if mark == "\t" else mark), "."
        if "." in text:
            number, line = next((n, s) for n, s in sample if "," in s)
            raise MalformedInputError(
                f"a comma and a point in the numbers of {line.strip()[:40]!r}",
                where=f"{where}:{number + 1}:{line.index(',') + 1}",
                expected="one decimal sign and no thousands separators",
            )
        return mark, ","
    if "," not in text:
        return None, "."
    parts = sample[0][1].split()
    if "." not in text and len(parts) > 1 and all(_COMMA_NUMBER.fullmatch(part) for part in parts):
        return None, ","
    return ",", "."


def separator_of_names(line: str, separator: str | None) -> str | None:
    """Return what stands between the names of the columns, which may not be what the data have."""
    for mark in (separator, ";", "\t", ","):
        if mark is not None and mark in line:
            return mark
    return None


def _all_integers(line: str) -> bool:
    return all(_INTEGER.fullmatch(part) for part in line.split(","))
