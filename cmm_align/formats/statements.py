"""Text read statement by statement: pieces of lines joined, strict numbers, and the place of each."""

from __future__ import annotations

import math
import re
from bisect import bisect_right
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from typing import Final, NamedTuple

from cmm_align.errors import InputError, MalformedInputError
from cmm_align.formats.decoding import decoded

SHOWN: Final = 60
"""Characters of a line that a message shows."""

_FIRST_LINES: Final = 5
_NUMBER: Final = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][+-]?\d+)?", re.ASCII)
_OTHER: Final = re.compile(r"[^0-9+\-.eEdD, \t\n]")
_EXPONENT: Final = str.maketrans("dD", "ee")
_NAME_WITH_NUMBER: Final = re.compile(r"(\D*)(\d{1,18})", re.ASCII)


class Statement(NamedTuple):
    """Pieces of lines that belong together."""

    text: str
    r"""The pieces, with ``\n`` between them: no number runs across two lines."""
    starts: tuple[tuple[int, int, int], ...]
    """For each piece: its place in `text`, its line and its column, both from 1."""

    def place(self, offset: int, where: str) -> str:
        """Return ``file:line:column`` of a character of the text."""
        first, line, column = self.starts[bisect_right(self.starts, offset, key=lambda s: s[0]) - 1]
        return f"{where}:{line}:{column + offset - first}"


def statement(pieces: Iterable[tuple[int, int, str]]) -> Statement:
    """Return the statement of some pieces, each with its line and column from 1."""
    starts, texts, offset = [], [], 0
    for line, column, text in pieces:
        starts.append((offset, line, column))
        texts.append(text)
        offset += len(text) + 1
    return Statement("\n".join(texts), tuple(starts))


def opening_text(head: bytes) -> str:
    """Return the first bytes of a file as text; empty if they are none."""
    try:
        return decoded(head, "")
    except InputError:
        return ""


def first_lines(head: bytes) -> list[str]:
    """Return the first few lines of a file that are not blank; none if it is no text."""
    lines = (line for line in opening_text(head).split("\n") if line.strip())
    return list(islice(lines, _FIRST_LINES))


def continued_statements(lines: Sequence[str]) -> Iterator[Statement]:
    """Give the statements of a DMIS text: ``$`` ends a line that goes on in the next, ``$$`` is a comment."""
    pieces: list[tuple[int, int, str]] = []
    for number, line in enumerate(lines, 1):
        stripped = line.strip()
        if not stripped or stripped.startswith("$$"):
            continue
        goes_on = stripped.endswith("$")
        pieces.append((number, len(line) - len(line.lstrip()) + 1, stripped.removesuffix("$")))
        if not goes_on:
            yield statement(pieces)
            pieces = []
    if pieces:
        yield statement(pieces)


def numbers(
    found: Statement, where: str, start: int = 0, stop: int | None = None, separator: str | None = ","
) -> list[float]:
    """Return the numbers between `start` and `stop` of a statement.

    Parameters
    ----------
    found : Statement
    where : str
        Name of the file.
    start, stop : int
        Part of the text.
    separator : str, optional
        Between the numbers; None for any run of blanks.

    Raises
    ------
    MalformedInputError
        At the first word that is no finite number, by file, line and column.
    """
    text = found.text[start:stop]
    if not _OTHER.search(text):  # of these characters float() makes the numbers that we accept, and no others
        try:
            values = [float(word) for word in text.translate(_EXPONENT).split(separator)]
        except ValueError:
            values = [math.nan]
        if all(map(math.isfinite, values)):
            return values
    return [_strict(word, found.place(start + k, where)) for word, k in _words(text, separator)]


def _words(text: str, separator: str | None) -> Iterator[tuple[str, int]]:
    """Give the words of a text without the blanks around them, each with its place."""
    if separator is None:
        yield from ((match[0], match.start()) for match in re.finditer(r"\S+", text))
        return
    offset = 0
    for part in text.split(separator):
        word = part.strip()
        yield word, offset + (len(part) - len(part.lstrip()) if word else part.rfind("\n") + 1)
        offset += len(part) + len(separator)


def _strict(word: str, place: str) -> float:
    if not word:
        raise MalformedInputError("an empty field", where=place, expected="a number")
    if not _NUMBER.fullmatch(word):
        both = ": the comma may mean decimals or thousands" if "," in word else ""
        raise MalformedInputError(
            f"{word[:SHOWN]!r} is not a number{both}",
            where=place,
            expected="a number",
            remedy="write a decimal point and no thousands separators" if both else "",
        )
    value = float(word.translate(_EXPONENT))
    if not math.isfinite(value):
        raise MalformedInputError(f"{word[:SHOWN]!r} is too large", where=place, expected="a finite number")
    return value


def checked_point(values: Sequence[float], found: Statement, where: str) -> Sequence[float]:
    """Return x, y, z of three numbers, or of six of which the last three are a direction.

    Raises
    ------
    MalformedInputError
        If there are more or fewer.
    """
    if len(values) not in {3, 6}:
        raise MalformedInputError(
            f"{len(values)} number{'' if len(values) == 1 else 's'} in {found.text.strip()[:SHOWN]!r}",
            where=found.place(0, where),
            expected="x y z, or x y z i j k",
        )
    return values[:3]


def numbers_of_names(names: Sequence[str]) -> list[int] | None:
    """Return 7 for ``P7`` and so on; None unless all names are one word with different numbers."""
    matches = [_NAME_WITH_NUMBER.fullmatch(name) for name in names]
    found = [match for match in matches if match is not None]
    whole = [int(match[2]) for match in found]
    same = len({match[1] for match in found}) == 1
    return whole if same and len(whole) == len(names) == len(set(whole)) else None


def no_points(where: str, expected: str, remedy: str = "") -> MalformedInputError:
    """Return the error of a file without points."""
    return MalformedInputError("there are no points in it", where=where, expected=expected, remedy=remedy)


def cut_off(where: str, last: int, expected: str) -> MalformedInputError:
    """Return the error of a file that does not end as its format wants, `last` being its last line."""
    return MalformedInputError(
        "the file ends too early: it may have been cut off",
        where=f"{where}:{last}:1",
        expected=expected,
        remedy="export it again, or add the end if nothing is missing",
    )
