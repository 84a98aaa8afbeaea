"""The data of measuring commands of I++ DME: one point by names, or blocks of points without names."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Final, NamedTuple, TypeAlias

from cmm_align.dialects.axes import Axes, axes_of, direction_of, is_within_reach, placed
from cmm_align.dialects.events import Hit
from cmm_align.dialects.ipp_grammar import POINT_NAMES, numbers_in
from cmm_align.dialects.line import Fault
from cmm_align.dialects.profile import MachineProfile

_WORST: Final = 100.0
_WORDS: Final = ("x", "y", "z", "i", "j", "k", "q", "er")
ANOTHER_TIP_MM: Final = 0.01
"""Calibrated radii of one tip scatter by micrometres with the direction of touch; tips differ by tenths."""

_NAMES: Final = (b"X", b"Y", b"Z", b"IJK", b"IJK", b"IJK", b"Q", b"ER")
_SORTED_HINT: Final = 'is it in this column? Some servers sort them by name: set columns = "q,x,y,z"'

Found: TypeAlias = Hit | Fault | str
"""A point, why there is none, or a remark."""


class Reading(NamedTuple):
    """How points are read, and the tip that took the first of them."""

    axes: Axes
    worst_quality: float
    columns: tuple[str, ...]
    """Of a scan: what each number of a point means."""
    tip_radius_mm: float
    """Stated by the profile, else by the first point; 0 while unknown."""
    places: tuple[int, ...] | None
    """Of x, y, z, i, j, k, q, er in a point of a scan, or its width; None without x, y, z."""

    def reporting(self, columns: tuple[str, ...]) -> Reading:
        """Return the same for scans that report other columns."""
        complete = {"x", "y", "z"} <= set(columns)
        width = len(columns)
        places = tuple(columns.index(word) if word in columns else width for word in _WORDS)
        return self._replace(columns=columns, places=places if complete else None)


def reading_of(profile: MachineProfile) -> Reading:
    """Return how the points of a profile's machine are read."""
    reading = Reading(axes_of(profile), profile.worst_quality, (), profile.tip_radius_mm, None)
    return reading.reporting(profile.column_words)


def named_point(
    reading: Reading, values: dict[bytes, tuple[float, ...]], body: bytes
) -> tuple[Reading, tuple[Found, ...]]:
    """Return the point in the named values of a data line.

    Parameters
    ----------
    values : dict
        Name to numbers, as `ipp_grammar.named_numbers` gives them.
    body : bytes
        Where they were found.
    """
    missing = [name.decode("ascii") for name in (b"X", b"Y", b"Z") if name not in values]
    if missing:
        return reading, (Fault(0, f"a point without {' and '.join(missing)}"),)
    for name, width in POINT_NAMES.items():
        if len(values.get(name, ())) not in {0, width}:
            why = f"{name.decode('ascii')} with {len(values[name])} numbers, expected {width}"
            return reading, (Fault(body.find(name + b"("), why),)
    (x,), (y,), (z,) = values[b"X"], values[b"Y"], values[b"Z"]
    (quality,), (radius_mm,) = values.get(b"Q", (0.0,)), values.get(b"ER", (0.0,))
    i, j, k = values.get(b"IJK", (0.0, 0.0, 0.0))
    reading, found = _checked(reading, (x, y, z), (i, j, k), quality, radius_mm)
    return reading, _at(found, lambda place: body.find(_NAMES[place] + b"("))


def scanned_points(reading: Reading, body: bytes) -> tuple[Reading, tuple[Found, ...]]:
    """Return the points of a block of numbers; none at all if their count does not fit."""
    numbers = numbers_in(body)
    if isinstance(numbers, Fault):
        return reading, (numbers,)
    columns, width = reading.columns, len(reading.columns)
    places = reading.places
    if places is None:
        return reading, (Fault(0, f"the scan report {', '.join(columns)} holds no x, y, z"),)
    if len(numbers) % width:
        why = f"{len(numbers)} numbers are no multiple of the {width} of a point: {', '.join(columns)}"
        return reading, (Fault(0, why),)
    x, y, z, i, j, k, q, er = places
    events: list[Found] = []
    for first in range(0, len(numbers), width):
        n = (*numbers[first : first + width], 0.0)  # what is not there is zero, which says nothing
        reading, found = _checked(reading, (n[x], n[y], n[z]), (n[i], n[j], n[k]), n[q], n[er])
        events += _at(found, partial(_place_in_block, body, first, places))
    return reading, tuple(events)


def _at(found: tuple[Found, ...], offset_of: Callable[[int], int]) -> tuple[Found, ...]:
    """Return the same with the offset of a fault in the body, instead of the number of a word."""
    if isinstance(found[0], Fault):
        return (Fault(offset_of(found[0].offset), found[0].why),)
    return found


def _place_in_block(body: bytes, first: int, places: tuple[int, ...], word: int) -> int:
    before = body.split(b",")[: first + places[word]]
    return sum(len(part) + 1 for part in before)


def _checked(
    reading: Reading,
    xyz: tuple[float, float, float],
    ijk: tuple[float, float, float],
    quality: float,
    radius_mm: float,
) -> tuple[Reading, tuple[Found, ...]]:
    """Return a point from its numbers, or why it is none; zeros say nothing, save for a coordinate.

    The offset of a fault is the number of the word in `_WORDS` that it is about.
    """
    axes, worst_quality, _, known_mm, _ = reading
    point_mm, direction = placed(axes, xyz), direction_of(axes, ijk)
    word, why = 0, ""
    if not is_within_reach(point_mm):
        why = f"further away than any machine reaches: {point_mm} mm"
    elif not (0.0 <= quality <= _WORST and quality == round(quality)):
        word, why = 6, f"Q = {quality:g} is no quality from 0 to 100; {_SORTED_HINT}"
    elif quality > worst_quality:
        word, why = 6, f"Q = {quality:g}: the machine itself calls this point bad"
    elif radius_mm and known_mm and not abs(radius_mm - known_mm) <= ANOTHER_TIP_MM:
        word, why = 7, f"ER = {radius_mm:g} mm, expected {known_mm:g}: another tip"
    elif isinstance(direction, str):
        word, why = 3, direction
    if why or isinstance(direction, str):
        return reading, (Fault(word, why),)
    hit = Hit(*point_mm, direction)
    if radius_mm and not known_mm:
        remark = f"effective tip radius {radius_mm:g} mm"
        return reading._replace(tip_radius_mm=radius_mm), (remark, hit)
    return reading, (hit,)
