"""Reading values out of a TOML table so that every mistake is named, with its place.

Used for job settings, prescriptions and machine profiles alike.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Mapping
from typing import Any

from cmm_align.errors import CmmAlignError, MalformedInputError


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return the remedy that names the nearest known word, or nothing if none is known."""
    near = difflib.get_close_matches(word, sorted(known), n=1, cutoff=0.0)
    return f"did you mean {near[0]!r}?" if near else ""


def check_keys(
    table: Mapping[str, Any],
    known: Iterable[str],
    *,
    where: str,
    error: type[CmmAlignError] = MalformedInputError,
) -> None:
    """Refuse a key that is not known.

    Raises
    ------
    CmmAlignError
        Of class `error`, at the first unknown key.
    """
    names = set(known)
    for key in table:
        if key not in names:
            raise error(f"unknown key {key!r}", where=where, remedy=did_you_mean(key, names))


def number(table: Mapping[str, Any], key: str, *, where: str, default: float | None = None) -> float:
    """Return a finite number of a table.

    Raises
    ------
    MalformedInputError
        If it is missing and has no default, or is not a finite number.
    """
    value = table.get(key, default)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        found = f"{key} = {value!r}" if key in table else f"{key} is missing"
        raise MalformedInputError(found, where=where, expected=f"{key} = a number")
    return float(value)


def numbers(table: Mapping[str, Any], key: str, *, where: str, count: int | None = None) -> list[float]:
    """Return a list of finite numbers of a table, of `count` entries where that is given.

    Raises
    ------
    MalformedInputError
        If it is missing, of another length, or holds something else.
    """
    values = table.get(key)
    if not isinstance(values, list) or (count is not None and len(values) != count):
        wanted = f"{key} = a list of {'' if count is None else f'{count} '}numbers"
        raise MalformedInputError(f"{key} = {values!r}", where=where, expected=wanted)
    return [number({key: value}, key, where=where) for value in values]
