"""A section of the page: rows under a heading, in the signs that a page can show."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

Row = tuple[str, ...]

_MICRO: Final = re.compile(r"(?<![^\s(])u(?=(?:m|rad)\b)")
_MINUS: Final = re.compile(r"(?<![^\s(±])-(?=\d)")


@dataclass(frozen=True, slots=True)
class Section:
    """One table of the page.

    Attributes
    ----------
    title : str
    rows : tuple of Row
        The first word of a row is its label.
    head : Row
        Headings of the columns; empty for a list of labels and words.
    note : str
        A sentence under the table.
    on_paper : bool
        Whether it is printed; the page that is printed is one sheet.
    """

    title: str
    rows: tuple[Row, ...]
    head: Row = ()
    note: str = ""
    on_paper: bool = True


def shown(text: str) -> str:
    """Return our own words with the signs that a page can show: µ, a true minus, ≤ and ≥."""
    text = _MICRO.sub("µ", text).replace("<=", "≤").replace(">=", "≥")
    return _MINUS.sub("\N{MINUS SIGN}", " ".join(text.split()))
