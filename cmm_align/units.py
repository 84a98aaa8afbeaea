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

RAD_PER: Final[dict[str, float]] = {
    "urad": 1e-6,
    "µrad": 1e-6,
    "μrad": 1e-6,
    "mrad": 1e-3,
    "um/mm": 1e-3,
    "µm/mm": 1e-3,
    "μm/mm": 1e-3,
    "rad": 1.0,
    "arcsec": math.pi / 648000.0,
    "arcmin": math.pi / 10800.0,
    "deg": math.pi / 180.0,
}
"""Radians per unit of angle or of small slope."""

UM_PER_MM: Final = 1e3
M_PER_MM: Final = 1e-3
REFERENCE_C: Final = 20.0
"""Temperature at which a part has its size, degrees C: ISO 1."""
NM_PER_MM: Final = 1e6
MRAD_PER_RAD: Final = 1e3
URAD_PER_RAD: Final = 1e6
DEG_PER_RAD: Final = 180.0 / math.pi
RAD_PER_DEG: Final = math.pi / 180.0
ARCSEC_PER_RAD: Final = 3600.0 * DEG_PER_RAD
PPM: Final = 1e6
"""Parts per million in one."""

_LENGTH = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*([a-zA-Zµμ]*)\s*")
_ANGLE = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*([a-zA-Zµμ/]*)\s*")
_NUMBER = r"(\d+\.?\d*|\.\d+)"
_MPE = re.compile(rf"{_NUMBER}(\+(?:{_NUMBER}[*·]?)?[Ll](?:/{_NUMBER}(?:mm)?)?)?")


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


def states_unit(text: str) -> bool:
    """Return whether a number is written with a unit, known or not."""
    match = _ANGLE.fullmatch(text)
    return match is None or bool(match.group(2))


def parse_angle_rad(text: str) -> float:
    """Return an angle or a small slope such as ``0.5mrad``, ``20arcsec`` or ``0.5um/mm`` in rad.

    Raises
    ------
    UnitsError
        If the text is not a number with a known unit.

    Examples
    --------
    >>> parse_angle_rad("0.5mrad")
    0.0005
    """
    match = _ANGLE.fullmatch(text)
    unit = match.group(2).lower() if match is not None else ""
    if match is None or unit not in RAD_PER:
        raise UnitsError(
            f"{text!r} is not an angle with a known unit",
            expected="a number with one of mrad, urad, um/mm, rad, deg, arcmin, arcsec",
        )
    return float(match.group(1)) * RAD_PER[unit]


def parse_mpe(text: str) -> tuple[float, float]:
    """Return A and K of a statement of length error, MPE(L) = A + L/K um, L in mm.

    Parameters
    ----------
    text : str
        ``0.7+L/400``, ``1.5+3L/1000``, ``0.7+0.0025*L`` or ``1.2``; with or without um, brackets, the sign ±,
        and a comma for the point.

    Returns
    -------
    constant_um : float
        A.
    divisor : float
        K, mm of length per um; infinite where the limit does not grow with the length.

    Raises
    ------
    UnitsError
        If the text is none of these, or allows no error at all.

    Examples
    --------
    >>> parse_mpe("0.7um + L/400")
    (0.7, 400.0)
    """
    tight = re.sub(r"(?<![\d.])\s+|\s+(?![\d.])", "", text)  # a blank inside a number is a mistake
    bare = re.sub(r"[uµμ]m", "", tight).replace(",", ".").removeprefix("±")
    bare = re.sub(r"^\((.*)\)$", r"\1", bare)
    match = _MPE.fullmatch(bare)
    thousands = re.search(r"[1-9]\d*,\d{3}(?!\d)", tight)  # or a decimal comma: a factor of 1000
    if match is not None and thousands is None:
        constant, linear, factor, divisor = match.groups()
        a, k = float(constant), float(divisor or 1.0)
        slope = float(factor or 1.0) / k if linear and k > 0.0 else 0.0
        if k > 0.0 and 0.0 < a + slope < math.inf:
            return a, 1.0 / slope if slope > 0.0 else math.inf
    raise UnitsError(
        f"{text!r} is no statement of length error",
        expected="um with the length L in mm, as 0.7+L/400 or 1.5+3L/1000",
    )
