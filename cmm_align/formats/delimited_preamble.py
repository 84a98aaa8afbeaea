"""What stands above the points of a delimited text: titles, dates, units, counts, names of columns."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final, NamedTuple

from cmm_align.errors import MalformedInputError, UnitsError
from cmm_align.formats.column_names import is_unit
from cmm_align.formats.delimited_lines import COMMENT_MARKS, fields_of, is_passed_over
from cmm_align.formats.points_header import MARK, Header, read_header
from cmm_align.units import MM_PER, mm_per

_BETWEEN: Final = re.compile(r"[;,\t ]+")
_NUMBER_LIKE: Final = re.compile(
    r"[\"']?[+\-−]?[.,]?\d|[+-]?(?:nan|inf|infinity)$|\*{2,}$|-{2,}$", re.IGNORECASE
)
_TIME_LIKE: Final = re.compile(r"\d+[:/]\d|\d+\.\d+\.\d|\d+-\d+-\d")
_RULER: Final = re.compile(r"[-=_*+|\s]{3,}")
_UNITS: Final = re.compile(
    r"(?:units?|einheit(?:en)?|ma(?:ß|ss)einheit)\s*[:=;\t ]\s*[\[(]?([a-zµμ]+)[\])]?\s*(?:[,;].*)?"
    r"|.*\b(?:dimensions|values|coordinates|ma(?:ß|ss)e|werte|koordinaten|angaben)\s+in\s+[\[(]?([a-zµμ]+)[\])]?\W*",
    re.IGNORECASE,
)
_COUNT: Final = re.compile(
    r"(?:(?:number|no\.?) of points|points|count|anzahl(?: (?:der )?(?:mess)?punkte)?|punkte|punktanzahl)"
    r"\s*[:=;\t ]\s*(\d{1,12})\W*",
    re.IGNORECASE,
)
_ALSO: Final = {
    **dict.fromkeys(("millimeter", "millimeters", "millimetre", "millimetres"), "mm"),
    **dict.fromkeys(("micron", "microns", "micrometer", "micrometers", "mikrometer"), "um"),
    **dict.fromkeys(("inches", "zoll"), "inch"),
    **dict.fromkeys(("meter", "meters", "metre", "metres"), "m"),
}


class Opening(NamedTuple):
    """What stands above the data."""

    header: Header
    headings: tuple[tuple[int, str], ...]
    """Lines of words, each with its number from 0; without the mark of a comment."""
    comments: frozenset[int]
    """Which of them are comments."""
    first: int
    """Number, from 0, of the first line with data."""
    units: str
    announced: tuple[int, int] | None
    """Number of points that a line announces, and the number of that line."""


def opening_of(lines: Sequence[str], where: str) -> Opening:
    """Return what stands above the data of a text.

    Parameters
    ----------
    lines : sequence of str
        Those at the beginning of the file.
    where : str
        Name of the file.

    Raises
    ------
    MalformedInputError
        If a line above the data looks like data that are damaged.
    UnitsError
        If several units are stated, or one that is not known.
    """
    header, units = Header(), ""
    headings: list[tuple[int, str]] = []
    comments: set[int] = set()
    count: tuple[int, int] | None = None
    for number, line in enumerate(lines):
        stripped = line.strip()
        here = f"{where}:{number + 1}:1"
        if stripped.startswith(MARK):
            header = read_header(stripped, here)
            continue
        if is_passed_over(line):
            text = stripped.lstrip("".join(COMMENT_MARKS)).strip()
            comments.add(number)
        elif count is None and stripped.isdigit() and _has_columns(lines, number + 1):
            count = int(stripped), number
            continue
        elif _starts_data(lines, number):
            return Opening(header, tuple(headings), frozenset(comments), number, units, count)
        else:
            text = stripped
            announced = _COUNT.fullmatch(text)
            count = (int(announced[1]), number) if announced else count
            if announced is None and not _RULER.fullmatch(text) and _is_damaged(text):
                raise MalformedInputError(
                    f"{text[:40]!r} is neither numbers nor names of columns",
                    where=here,
                    expected="columns x, y, z",
                    remedy="put # before it if it is no point",
                )
        if text and not _RULER.fullmatch(text):
            headings.append((number, text))
            units = _same_unit(units, _stated(text, here), here)
    return Opening(header, tuple(headings), frozenset(comments), len(lines), units, count)


def is_number_like(text: str) -> bool:
    """Return whether a field is a number, or may be one that is damaged or missing."""
    return bool(_NUMBER_LIKE.match(text)) and not _TIME_LIKE.match(text)


def unit_row(text: str, separator: str | None) -> list[str] | None:
    """Return the units of a line that has nothing else: a line below the names of columns."""
    written = [field for field, _ in fields_of(text, separator)]
    units = [is_unit(field) for field in written]
    empty = {"", "-", "[-]", "[]"}
    right = any(units) and all(units[k] or field in empty for k, field in enumerate(written))
    return units if right else None


def _tokens(line: str) -> list[str]:
    return [token for token in _BETWEEN.split(line.strip()) if token]


def _has_columns(lines: Sequence[str], start: int) -> bool:
    """Return whether the next line that is no comment has more than one field."""
    following = next((line for line in lines[start:] if not is_passed_over(line)), "")
    return len(_tokens(following)) > 1


def _starts_data(lines: Sequence[str], number: int) -> bool:
    tokens = _tokens(lines[number])
    like = sum(map(is_number_like, tokens))
    if like == len(tokens):
        return not _RULER.fullmatch(lines[number])
    if like < 3:
        return False
    following = [line for line in lines[number + 1 : number + 20] if not is_passed_over(line)][:2]
    return any(
        all(_shape(line, mark) == _shape(lines[number], mark) for line in following)
        and sum(_shape(lines[number], mark)) >= 3
        for mark in (";", "\t", ",", None)
    )


def _shape(line: str, mark: str | None) -> tuple[bool, ...]:
    """Return which fields of a line are numbers."""
    return tuple(is_number_like(text) for text, _ in fields_of(line.strip(), mark))


def _is_damaged(text: str) -> bool:
    """Return whether a line is more numbers than words."""
    tokens = _tokens(text)
    like = sum(map(is_number_like, tokens))
    return 2 * like > len(tokens) and ":" not in text and "=" not in text


def _stated(text: str, where: str) -> str:
    """Return the unit that a line states; empty if it states none."""
    match = _UNITS.fullmatch(text)
    if match is None:
        return ""
    word = (match[1] or match[2]).lower()
    word = _ALSO.get(word, word)
    if match[1] is None and word not in MM_PER:
        return ""  # a sentence that goes on
    mm_per(word, where=where)
    return word


def _same_unit(before: str, now: str, where: str) -> str:
    if before and now and MM_PER[before] != MM_PER[now]:
        raise UnitsError(f"{now} after {before}", where=where, expected="one unit")
    return before or now
