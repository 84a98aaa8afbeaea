"""Units: the only place that knows 1e-3, 25.4 or pi/180. Inside, everything is mm and rad."""

from __future__ import annotations

import math
import re
from typing import Final

from cmm_align.errors import UnitsError

MM_PER: Final[dict[str, float]] = {
    "nm": 1e-6,
    "um": 1e-3,
    "µm": 1e-3,
    "μm": 1e-3,
    "mm": 1.0,
    "cm": 10.0,
    "m": 1000.0,
    "in": 25.4,
    "inch": 25.4,
}
"""Millimetres per unit of length."""

UM_PER_MM: Final = 1e3
NM_PER_MM: Final = 1e6
URAD_PER_RAD: Final = 1e6
DEG_PER_RAD: Final = 180.0 / math.pi
RAD_PER_DEG: Final = math.pi / 180.0

_LENGTH = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*([a-zA-Zµμ]*)\s*")


def mm_per(unit: str, *, where: str = "") -> float:
    """Return the length of one `unit` in mm.

    Raises
    ------
    UnitsError
        If the unit is not known.
    """
    try:
        return MM_PER[unit.strip().lower()]
    except KeyError:
        raise UnitsError(
            f"unknown unit {unit!r}", where=where, expected="one of mm, um, nm, m, inch"
        ) from None


def parse_length_mm(text: str) -> float:
    """Return a length such as ``1.5``, ``1.5mm``, ``1500um`` or ``0.059in`` in mm; bare means mm.

    Raises
    ------
    UnitsError
        If the text is not a number with a known unit.

    Examples
    --------
    >>> parse_length_mm("1500um")
    1.5
    """
    match = _LENGTH.fullmatch(text)
    if match is None:
        raise UnitsError(f"{text!r} is not a length", expected="a number with a unit, as 1.5mm")
    number, unit = match.groups()
    return float(number) * mm_per(unit or "mm")
