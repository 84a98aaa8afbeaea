"""Numbers of a line to mm along the machine's axes, and the checks that any point has to pass."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from cmm_align.dialects.profile import MachineProfile
from cmm_align.units import mm_per

LARGEST_MM: Final = 2e5
"""No measuring machine reaches 200 m, and laser trackers stay below."""

UNIT_LENGTH: Final = (0.9, 1.1)
_NEARLY_WHOLE: Final = 1e-9


class Axes(NamedTuple):
    """How three numbers x, y, z of a line become mm: ``sign * number[source] * multiply / divide``.

    A factor of one over a whole number is kept as a division: so 1595 counts of 0.001 mm are the double
    nearest to 1.595, the same that a machine with a decimal point would have given.
    """

    source: tuple[int, int, int]
    multiply: tuple[float, float, float]
    divide: tuple[float, float, float]


def axes_of(profile: MachineProfile) -> Axes:
    """Return how the numbers of a profile's machine become mm."""
    unit_mm = mm_per(profile.units)
    terms: list[tuple[int, float, float]] = []
    for part in profile.axis_map.split(","):
        signed = part.strip()
        index = "xyz".index(signed[1])
        factor = profile.scale[index] * unit_mm
        parts = 1.0 / factor
        whole = parts > 1.5 and abs(parts - round(parts)) < _NEARLY_WHOLE * parts
        multiply = math.copysign(1.0 if whole else factor, -1.0 if signed[0] == "-" else 1.0)
        terms.append((index, multiply, float(round(parts)) if whole else 1.0))
    (i, a, p), (j, b, q), (k, c, r) = terms
    return Axes((i, j, k), (a, b, c), (p, q, r))


def placed(axes: Axes, numbers: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return the x, y, z of a line (numbers as sent) in mm along the machine's axes."""
    (i, j, k), (a, b, c), (p, q, r) = axes
    return numbers[i] * a / p, numbers[j] * b / q, numbers[k] * c / r


def turned(axes: Axes, numbers: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return the i, j, k of a line along the machine's axes."""
    (i, j, k), (a, b, c), _ = axes
    x, y, z = numbers[i], numbers[j], numbers[k]
    return x if a > 0.0 else -x, y if b > 0.0 else -y, z if c > 0.0 else -z


def is_within_reach(point_mm: tuple[float, float, float]) -> bool:
    """Return whether a point in mm is one that a machine can reach; false for what is not finite."""
    x, y, z = point_mm
    return -LARGEST_MM < x < LARGEST_MM and -LARGEST_MM < y < LARGEST_MM and -LARGEST_MM < z < LARGEST_MM


def direction_of(axes: Axes, numbers: tuple[float, float, float]) -> tuple[float, float, float] | str | None:
    """Return i, j, k along the machine's axes, None for three zeros (not stated), or why they are none."""
    length = math.hypot(*numbers)
    if length == 0.0:
        return None
    if not UNIT_LENGTH[0] <= length <= UNIT_LENGTH[1]:
        return f"i, j, k are no unit vector (length {length:.3g}): are the columns in this order?"
    return turned(axes, numbers)
