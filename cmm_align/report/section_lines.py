"""Straight sections of a map: what the user typed, and the deviations along it."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

import numpy as np

from cmm_align.errors import UnitsError, UsageError
from cmm_align.model import DeviationMap
from cmm_align.report.wording import minus
from cmm_align.surfaces.protocol import Array, Bounds
from cmm_align.units import parse_length_mm

Place = tuple[float, float]

SAMPLES_PER_STEP: Final = 4.0
MOST_SAMPLES: Final = 4000
_WANTED: Final = "x=0, y=5mm or X1,Y1:X2,Y2 as -20,0:20,10"


@dataclass(frozen=True, slots=True)
class SectionLine:
    """A straight line over the part, in frame `surface`."""

    name: str
    start_mm: Place
    end_mm: Place
    axis: str = ""
    """The coordinate that changes along it, where only one does."""


@dataclass(frozen=True, slots=True)
class Profile:
    """Deviations along a section; each array of shape (n,).

    Attributes
    ----------
    arc_mm : ndarray, shape (n,), mm
        Length along the nominal: from the start, or from where the coordinate that changes is 0.
    deviation_mm, sigma_mm : ndarray, shape (n,), mm
        Between the nodes of the map, NaN where one of them is unknown.
    """

    arc_mm: Array
    deviation_mm: Array
    sigma_mm: Array


def middle_lines(bounds: Bounds) -> tuple[SectionLine, SectionLine]:
    """Return the two lines through the middle of the aperture, along y and along x."""
    middle = 0.5 * (bounds.x_min + bounds.x_max), 0.5 * (bounds.y_min + bounds.y_max)
    x, y = (round(value, 6) + 0.0 for value in middle)  # to 1 nm, and never minus zero
    return section_line(f"x={x:.9g}", bounds), section_line(f"y={y:.9g}", bounds)


def section_line(text: str, bounds: Bounds) -> SectionLine:
    """Return the line that a text names.

    Parameters
    ----------
    text : str
        ``x=0``, ``y=5mm`` (across the whole part), or ``X1,Y1:X2,Y2``; a bare number is in mm.
    bounds : Bounds
        Of the part.

    Raises
    ------
    UsageError
        If it names no line, or one that misses the part.
    """
    b, plain = bounds, re.sub(r"\s+", "", text)
    upright = re.fullmatch(r"([xy])=(.+)", plain)
    if upright is not None:
        along, value = upright[1], _length(upright[2], text)
        low, high = (b.x_min, b.x_max) if along == "x" else (b.y_min, b.y_max)
        if not low <= value <= high:
            raise UsageError(
                f"the section {text!r} misses the part", expected=f"{along} from {low:.4g} to {high:.4g} mm"
            )
        name = f"{along} = {minus(value)} mm"
        if along == "x":
            return SectionLine(name, (value, b.y_min), (value, b.y_max), "y")
        return SectionLine(name, (b.x_min, value), (b.x_max, value), "x")
    ends = re.fullmatch(r"([^,:]+),([^,:]+):([^,:]+),([^,:]+)", plain)
    if ends is None:
        raise UsageError(f"{text!r} is no section", expected=_WANTED)
    x1, y1, x2, y2 = (_length(word, text) for word in ends.groups())
    if (x1, y1) == (x2, y2):
        raise UsageError(f"the section {text!r} has no length", expected="two places")
    if not _meets(b, (x1, y1), (x2, y2)):
        raise UsageError(
            f"the section {text!r} misses the part",
            expected=f"x from {b.x_min:.4g} to {b.x_max:.4g}, y from {b.y_min:.4g} to {b.y_max:.4g} mm",
        )
    x, y, u, v = (minus(value) for value in (x1, y1, x2, y2))
    name = f"({x}, {y}) to ({u}, {v}) mm"
    return SectionLine(name, (x1, y1), (x2, y2))


def profile_along(deviation_map: DeviationMap, line: SectionLine) -> Profile:
    """Return the deviations along a line, linear between the nodes; beyond them nothing is known.

    Parameters
    ----------
    deviation_map : DeviationMap
    line : SectionLine
    """
    m = deviation_map
    (x1, y1), (x2, y2) = line.start_mm, line.end_mm
    length = float(np.hypot(x2 - x1, y2 - y1))
    step = min(m.x_mm[1] - m.x_mm[0], m.y_mm[1] - m.y_mm[0]) / SAMPLES_PER_STEP
    share = np.linspace(0.0, 1.0, int(np.clip(length / step, 50, MOST_SAMPLES)) + 1)
    x, y = x1 + share * (x2 - x1), y1 + share * (y2 - y1)
    surface = m.alignment.nominal.surface
    inside = surface.contains(x, y)
    z = np.full(len(x), np.nan)
    z[inside] = surface.jet(x[inside], y[inside]).z
    rise = np.nan_to_num(np.diff(z))
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(length * np.diff(share), rise))])
    if line.axis:
        along = x if line.axis == "x" else y
        if along[0] < 0.0 < along[-1]:
            arc -= float(np.interp(0.0, along, arc))
    return Profile(arc, _between(m, m.deviation_mm, x, y), _between(m, m.sigma_mm, x, y))


def _between(m: DeviationMap, field: Array, x: Array, y: Array) -> Array:
    """Return a field between its nodes, bilinear; NaN beyond them and beside an unknown one."""
    u = (x - m.x_mm[0]) / (m.x_mm[1] - m.x_mm[0])
    v = (y - m.y_mm[0]) / (m.y_mm[1] - m.y_mm[0])
    iu = np.clip(np.floor(u), 0, len(m.x_mm) - 2).astype(np.intp)
    iv = np.clip(np.floor(v), 0, len(m.y_mm) - 2).astype(np.intp)
    fu, fv = u - iu, v - iv
    slack = 1e-9 * max(field.shape)
    beyond = (np.minimum(fu, fv) < -slack) | (np.maximum(fu, fv) > 1.0 + slack)
    total = np.zeros(len(x))
    for du, wu in ((0, 1.0 - fu), (1, fu)):
        for dv, wv in ((0, 1.0 - fv), (1, fv)):
            weight = wu * wv
            total += np.where(np.abs(weight) > slack, weight * field[iv + dv, iu + du], 0.0)
    return np.asarray(np.where(beyond, np.nan, total), dtype=np.float64)


def _meets(b: Bounds, start: Place, end: Place) -> bool:
    """Return whether a stretch has a place within the bounds."""
    share = np.linspace(0.0, 1.0, 2001)
    x, y = (start[k] + share * (end[k] - start[k]) for k in (0, 1))
    return bool(((x >= b.x_min) & (x <= b.x_max) & (y >= b.y_min) & (y <= b.y_max)).any())


def _length(word: str, text: str) -> float:
    """Return a length of a section's text in mm."""
    try:
        return parse_length_mm(word)
    except UnitsError:
        raise UsageError(f"{word!r} in the section {text!r} is no length", expected=_WANTED) from None
