"""Numbers as people print them: decimal comma or point, and marks between thousands.

What the marks of a file mean is decided once for the whole file; a number that does not fit is refused.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator
from functools import lru_cache
from typing import Final, NamedTuple

from cmm_align.errors import MalformedInputError

_NUMBER: Final = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][+-]?\d+)?", re.ASCII)
_NOT_FINITE: Final = re.compile(r"[+-]?(?:nan|inf|infinity)|1[.,]#\w+", re.IGNORECASE)
_ONLY_BETWEEN_THOUSANDS: Final = "'’\u2009\u202f\u00a0"
_MAY_BE_THOUSANDS: Final = re.compile(r"[+-]?[1-9]\d{0,2}(?:,\d{3})+", re.ASCII)
_SHOWN: Final = 40


class Signs(NamedTuple):
    """What the marks in the numbers of a file are."""

    decimal: str = "."
    group: str = ""
    """Comma or point between thousands; others there can mean nothing else."""
    told: bool = False
    """Whether the user said so: then a number needs no decimals to show what its marks are."""

    @property
    def plain(self) -> bool:
        """Whether the numbers are as Python writes them."""
        return self.decimal == "."


class Field(NamedTuple):
    """A field with its place."""

    text: str
    where: str
    """``file:line:column``."""


def signs_of(sample: Iterable[Field], whole: Iterator[Field], told: str | None) -> Signs:
    """Return the signs of a file.

    Parameters
    ----------
    sample : iterable of Field
        Numbers of the first rows.
    whole : iterator of Field
        All numbers, asked for only where the first ones leave it open.
    told : str, optional
        Decimal sign by the word of the user.

    Raises
    ------
    MalformedInputError
        If the numbers have comma and point but none of them shows which is which, or only commas that may
        be decimal or between thousands.
    """
    if told:
        return Signs(told, "," if told == "." else ".", told=True)
    fields = list(sample)
    for text, _ in fields:
        if "," in text and "." in text:
            decimal = max(",.", key=text.rfind)
            return Signs(decimal, "," if decimal == "." else ".")
    comma = next((one for one in fields if "," in one.text), None)
    if comma is None:
        return Signs()
    grouped = all(_MAY_BE_THOUSANDS.fullmatch(one.text) for one in fields if "," in one.text)
    mixed = any("." in one.text for one in fields)
    if mixed and not grouped:
        raise MalformedInputError(
            f"a comma and a point in the numbers, here {comma.text[:_SHOWN]!r}",
            where=comma.where,
            expected="one decimal sign",
            remedy="say which with --decimal , or --decimal .",
        )
    if not mixed and any(map(_shows_decimals, whole)):
        return Signs(",")
    raise MalformedInputError(
        f"{comma.text[:_SHOWN]!r} has two readings: {comma.text.replace(',', '.', 1)} with a decimal comma,"
        f" {comma.text.replace(',', '')} with commas between thousands",
        where=comma.where,
        expected="a number that shows which",
        remedy="say it with --decimal , or --decimal .",
    )


def _shows_decimals(one: Field) -> bool:
    """Return whether a number of a file without points shows that its commas are not between thousands."""
    if "," in one.text:
        return not _MAY_BE_THOUSANDS.fullmatch(one.text)
    return len(one.text.lstrip("+-")) > 3


@lru_cache
def _grouped(mark: str, decimal: str, needs_decimals: bool) -> re.Pattern[str]:
    """Return what a number with marks between its thousands looks like."""
    rest = rf"{re.escape(decimal)}\d*" + ("" if needs_decimals else "|")
    return re.compile(rf"[+-]?\d{{1,3}}(?:{re.escape(mark)}\d{{3}})+(?:{rest})", re.ASCII)


def _ungrouped(text: str, signs: Signs) -> str:
    """Return a number without marks between thousands; as it is if they do not stand where they should."""
    for mark in (signs.group, *_ONLY_BETWEEN_THOUSANDS):
        if mark and mark in text:
            pattern = _grouped(mark, signs.decimal, mark == signs.group and not signs.told)
            return text.replace(mark, "") if pattern.fullmatch(text) else text
    return text


def number_of(text: str, column: int, signs: Signs, here: str) -> float:
    """Return the number that a field at a place (from 1) of the line `here` holds.

    Raises
    ------
    MalformedInputError
        If it is empty, not a number, or not finite.
    """
    where = f"{here}:{column}"
    if not text:
        raise MalformedInputError("an empty field", where=where, expected="a number")
    plain = text if text.isascii() and text.isdigit() else _ungrouped(text, signs)
    if signs.decimal == ",":
        if "." in plain:
            by = "as --decimal says" if signs.told else "as in the lines before"
            raise MalformedInputError(
                f"{text[:_SHOWN]!r} is not a number", where=where, expected=f"a decimal comma, {by}"
            )
        plain = plain.replace(",", ".")
    if not _NUMBER.fullmatch(plain):
        if _NOT_FINITE.fullmatch(plain):
            raise MalformedInputError(
                f"{text[:_SHOWN]!r} is not finite",
                where=where,
                expected="a number",
                remedy="remove this point",
            )
        remedy = "write a decimal point and no thousands separators" if "," in text else ""
        raise MalformedInputError(
            f"{text[:_SHOWN]!r} is not a number", where=where, expected="a number", remedy=remedy
        )
    value = float(plain.replace("d", "e").replace("D", "e"))
    if not math.isfinite(value):
        raise MalformedInputError(f"{text[:_SHOWN]!r} is too large", where=where, expected="a finite number")
    return value
