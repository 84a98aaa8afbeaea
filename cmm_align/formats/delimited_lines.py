"""Lines of a delimited text and the fields in them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Final

from cmm_align.errors import MalformedInputError

COMMENT_MARKS: Final = ("#", "%", "!", "//")
MAX_LINE: Final = 65536
PAIRED: Final = ",,"
"""Separator of a text whose commas are by turns decimal and between the columns."""
_SAMPLE_LINES: Final = 50
_BLOCK: Final = 1 << 20
_BLANKS: Final = re.compile(r"[^ \t]+")
_TWO_BLANKS: Final = re.compile(r" {2,}|\t+")


def is_passed_over(line: str) -> bool:
    """Return whether a line is blank or a comment."""
    stripped = line.lstrip()
    return not stripped or stripped.startswith(COMMENT_MARKS)


def fields_of(line: str, separator: str | None) -> list[tuple[str, int]]:
    """Return the fields of a line, each with the place (from 1) where it starts.

    Parameters
    ----------
    line : str
    separator : str, optional
        Between the fields; None for any run of blanks, `PAIRED` for every second comma.
    """
    if separator is None:
        return [(match[0], match.start() + 1) for match in _BLANKS.finditer(line)]
    parts = line.split(separator if separator != PAIRED else ",")
    if separator == PAIRED:
        parts = [",".join(parts[k : k + 2]) for k in range(0, len(parts), 2)]
    fields, start = [], 0
    for part in parts:
        text = part.strip()
        fields.append((text, start + 1 + (len(part) - len(part.lstrip()) if text else 0)))
        start += len(part) + 1
    return fields


def words_of(line: str, separator: str | None, count: int) -> list[str]:
    """Return the names in a line above the data: as many as there are columns, if some separator gives them.

    Parameters
    ----------
    line : str
        Without the mark of a comment.
    separator : str, optional
        Of the data.
    count : int
        Of columns of the data.
    """
    marks = [mark for mark in (separator, ";", "\t", ",") if mark not in {None, PAIRED} and mark in line]
    ways = [[text for text, _ in fields_of(line, mark)] for mark in marks]
    ways += [[text.strip() for text in _TWO_BLANKS.split(line.strip())], line.split()]
    return next((words for words in ways if len(words) == count), ways[0])


def blocks(text: str, start: int, number: int) -> Iterator[tuple[int, str]]:
    """Give a text in pieces of whole lines, each with the number from 1 of its first line.

    Parameters
    ----------
    text : str
    start : int
        Where to begin: the start of a line.
    number : int
        Number of that line, from 1.
    """
    while start < len(text):
        end = text.find("\n", start + _BLOCK) + 1 or len(text)
        block = text[start:end]
        yield number, block
        number += block.count("\n")
        start = end


def data_lines(text: str, start: int = 0, number: int = 1) -> Iterator[tuple[int, str]]:
    """Give the lines that are neither blank nor comments, each with its number from 1."""
    for first, block in blocks(text, start, number):
        for k, line in enumerate(block.split("\n"), first):
            if not is_passed_over(line):
                yield k, line


def opening_lines(text: str) -> list[str]:
    """Return the lines at the beginning of a text, by which its layout is found."""
    for _, block in blocks(text, 0, 1):
        return block.removesuffix("\n").split("\n")
    return []


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
            raise too_long(line, f"{where}:{number + 1}")
        if not is_passed_over(line):
            sample.append((number, line))
        if len(sample) == _SAMPLE_LINES:
            break
    return sample


def too_long(line: str, here: str) -> MalformedInputError:
    """Return the error of a line that no table of points has."""
    return MalformedInputError(
        f"a line of {len(line)} characters", where=f"{here}:1", expected=f"at most {MAX_LINE}"
    )


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
