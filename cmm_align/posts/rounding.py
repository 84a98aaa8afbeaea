"""How many decimals a file needs so that rounding costs at most 1 nm."""

from __future__ import annotations

import math
from typing import Final

from cmm_align.errors import UsageError
from cmm_align.numerics.wheel import Wheel
from cmm_align.units import mm_per

MOST_MM: Final = mm_per("nm")
"""What rounding may cost, along the normal."""

ANY_WHEEL_MM: Final = 500.0
"""Radius to provide for where the wheel is not known."""

MOST_DECIMALS: Final = 12


def rounding_mm(decimals: int, unit_mm: float = 1.0) -> float:
    """Return the largest error along any direction of a point whose coordinates are rounded, mm.

    Each is wrong by half of its last decimal at most, so the point by the root of three times that.
    """
    return math.sqrt(3.0) * 0.5 * float(10.0**-decimals) * unit_mm


def least_decimals(unit_mm: float = 1.0) -> int:
    """Return the fewest decimals of coordinates in a unit of so many mm."""
    return _fewest(unit_mm)


def least_normal_decimals(wheel: Wheel | None) -> int:
    """Return the fewest decimals of normals: the radius times their rounding is at most 1 nm."""
    return _fewest(ANY_WHEEL_MM if wheel is None else wheel.radius_mm)


def check_decimals(decimals: int, least: int, what: str, where: str = "") -> int:
    """Return decimals that a user asks for.

    Raises
    ------
    UsageError
        If they are too few, or more than a float64 holds.
    """
    if not least <= decimals <= MOST_DECIMALS:
        raise UsageError(
            f"{decimals} decimals of {what}",
            where=where,
            expected=f"{least} to {MOST_DECIMALS}: rounding would cost more than 1 nm with fewer",
        )
    return decimals


def _fewest(scale_mm: float) -> int:
    """Return the decimals at which the rounding of a vector, times a length, is 1 nm at most."""
    return max(0, math.ceil(math.log10(math.sqrt(3.0) * 0.5 * scale_mm / MOST_MM) - 1e-9))
