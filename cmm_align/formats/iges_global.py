"""The global section of an IGES file: marks between parameters, unit and scale."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final, NamedTuple

from cmm_align.errors import MalformedInputError, UnitsError
from cmm_align.units import MM_PER

_UNIT_OF_FLAG: Final = {"1": "inch", "2": "mm", "6": "m", "9": "um", "10": "cm"}
_BY_NAME: Final = "3"
_STRING: Final = re.compile(r"\s*(\d+)H", re.ASCII)
_SCALE, _FLAG, _NAME = 12, 13, 14
"""Places of the parameters, from 0."""


class Global(NamedTuple):
    """What the section states."""

    separator: str = ","
    end: str = ";"
    unit: str = ""
    """Empty where there is no such section."""


def read_global(lines: Sequence[str], where: str) -> Global:
    """Return what the global section states.

    Parameters
    ----------
    lines : sequence of str
        Lines with G in column 73.
    where : str
        Name of the file.

    Raises
    ------
    MalformedInputError
        If the points are in a drawing's scale.
    UnitsError
        If the unit is not known.
    """
    fields = _fields("".join(line[:72].ljust(72) for line in lines))
    fields += [""] * (_NAME + 1 - len(fields))
    scale, flag, name = fields[_SCALE] or "1", fields[_FLAG] or "1", fields[_NAME].lower()
    if not re.fullmatch(r"1(?:\.0*)?(?:[eEdD][+-]?0+)?", scale):
        raise MalformedInputError(f"model scale {scale}", where=where, expected="1, places in full size")
    unit = name if flag == _BY_NAME else _UNIT_OF_FLAG.get(flag, "")
    if unit not in MM_PER:
        raise UnitsError(
            f"unit {flag} {name!r} of the global section", where=where, expected="inch, mm, m, um or cm"
        )
    return Global(fields[0] or ",", fields[1] or ";", unit)


def _fields(text: str) -> list[str]:
    """Part the parameters; a text is written ``5Habcde`` and may hold the marks."""
    fields: list[str] = []
    separator, end, at = ",", ";", 0
    while at < len(text):
        match = _STRING.match(text, at)
        stop = match.end() + int(match[1]) if match is not None else at
        value = text[match.end() : stop] if match is not None else ""
        while stop < len(text) and text[stop] not in {separator, end}:
            value += "" if match is not None else text[stop]
            stop += 1
        fields.append(value if match is not None else value.strip())
        if len(fields) == 1 and value:
            separator = value[0]
        if len(fields) == 2 and value:
            end = value[0]
        if stop >= len(text) or (text[stop] == end and text[stop] != separator and len(fields) > 1):
            break
        at = stop + 1
    return fields
