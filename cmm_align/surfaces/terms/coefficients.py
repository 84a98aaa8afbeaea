"""Reading the coefficients of a term: keys that are an index, or two, and their values."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final

from cmm_align.errors import MalformedInputError
from cmm_align.toml_table import number

MAX_ORDER: Final = 200
"""Highest power or order of a term: above it, doubles carry no meaning and a typing error is likely."""


def by_index(
    table: Mapping[str, Any], where: str, *, lowest: int = 0, highest: int = MAX_ORDER, step: int = 1
) -> tuple[tuple[int, float], ...]:
    """Return ``(index, value)``, sorted, of coefficients such as ``{ "4" = 1e-6 }``.

    Parameters
    ----------
    lowest, highest, step : int
        The indices allowed: ``lowest, lowest + step, ... highest``.

    Raises
    ------
    MalformedInputError
        If there are none, or an index or value is wrong.
    """
    example = f'coefficients = {{ "{lowest + step}" = C, ... }}'
    wanted = f"an index of {lowest}, {lowest + step} ... {highest}"
    found: dict[int, float] = {}
    for key, value in entries(table, where, example):
        index = integer(key)
        if not lowest <= index <= highest or (index - lowest) % step:
            raise MalformedInputError(f"coefficient {key!r}", where=where, expected=wanted)
        if index in found:
            raise MalformedInputError(f"coefficient {key!r} is given twice", where=where)
        found[index] = value
    return tuple(sorted(found.items()))


def by_pair(table: Mapping[str, Any], where: str) -> tuple[tuple[int, int, float], ...]:
    """Return ``(i, j, value)``, sorted, of coefficients such as ``{ "2,0" = 1e-6 }``.

    Raises
    ------
    MalformedInputError
        If there are none, or a pair or value is wrong.
    """
    found: dict[tuple[int, int], float] = {}
    for key, value in entries(table, where, 'coefficients = { "i,j" = C, ... }'):
        pair = tuple(integer(part.strip()) for part in key.split(","))
        if len(pair) != 2 or min(pair) < 0 or max(pair) > MAX_ORDER:
            raise MalformedInputError(
                f"coefficient {key!r}",
                where=where,
                expected=f'two integers of 0 ... {MAX_ORDER}, as "2,0"',
            )
        i, j = pair
        if (i, j) in found:
            raise MalformedInputError(f"coefficient {key!r} is given twice", where=where)
        found[i, j] = value
    return tuple((i, j, value) for (i, j), value in sorted(found.items()))


def entries(table: Mapping[str, Any], where: str, example: str) -> Iterator[tuple[str, float]]:
    """Yield key and value of every coefficient.

    Raises
    ------
    MalformedInputError
        If there are none (the message shows the example), or a value is not a finite number.
    """
    values = table.get("coefficients")
    if not isinstance(values, Mapping) or not values:
        raise MalformedInputError("no coefficients", where=where, expected=example)
    for key in values:
        yield key, number(values, key, where=f"{where}:coefficients")


def integer(text: str) -> int:
    """Return the whole number that a text spells in digits, or -1 if it does not."""
    plain = text.isascii() and text.isdigit() and len(text) <= len(str(MAX_ORDER)) + 1
    return int(text) if plain else -1


def positive(table: Mapping[str, Any], key: str, where: str, default: float | None = None) -> float:
    """Return a number that must be above zero, such as a normalisation radius.

    Raises
    ------
    MalformedInputError
        If it is missing and has no default, or is not above zero.
    """
    value = number(table, key, where=where, default=default)
    if value <= 0.0:
        raise MalformedInputError(f"{key} = {value:g}", where=where, expected=f"{key} > 0")
    return value
