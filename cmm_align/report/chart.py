"""What the pictures with two plain axes have in common: the sheet, the look of the axes, limits in them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cmm_align.model import DeviationMap
from cmm_align.report.canvas import RULE, WIDTH_IN, footer, header, sheet
from cmm_align.report.map_picture import head_numbers, origin, version
from cmm_align.report.wishes import Limits
from cmm_align.surfaces.protocol import Array

HEAD_IN: Final = 1.1
FOOT_IN: Final = 0.84
BELOW: Final = "#2f6fb5"
ABOVE: Final = "#b9501a"
"""Ink for missing and for excess material; of the colours of a deviation."""
PALE: Final = "#b4bdc7"
LIMIT: Final = "#1d2733"
GRID: Final = "#e9ecef"

FARTHEST_LIMITS: Final = 2.5
"""Limits farther than so many times the deviations would leave no room for these, and are told only."""


def chart_sheet(
    deviation_map: DeviationMap, body_in: float, title: str, source: str, lines: Sequence[str]
) -> tuple[Figure, float]:
    """Return a sheet with head and foot written, and its height in inches.

    Parameters
    ----------
    deviation_map : DeviationMap
    body_in : float
        Height between head and foot, inches.
    title, source : str
        As for a map.
    lines : sequence of str
        Up to two, under the title.
    """
    height_in = HEAD_IN + body_in + FOOT_IN
    figure = sheet(height_in)
    header(figure, title, lines, head_numbers(deviation_map.statistics), height_in)
    nominal, spacing_mm = deviation_map.alignment.nominal, deviation_map.spacing_mm
    footer(figure, [source, *origin(nominal), f"grid {spacing_mm:.4g} mm", version()], height_in)
    return figure, height_in


def chart(
    figure: Figure, left_in: float, bottom_in: float, width_in: float, high_in: float, grid: str = "y"
) -> Axes:
    """Return axes at a place of the sheet, inches: two spines, and a quiet grid along x, y or both."""
    height_in = figure.get_figheight()
    box = (left_in / WIDTH_IN, bottom_in / height_in, width_in / WIDTH_IN, high_in / height_in)
    axes = figure.add_axes(box)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    if grid:
        axes.grid(visible=True, axis="both" if grid == "both" else "y" if grid == "y" else "x", color=GRID)
    axes.set_axisbelow(True)
    return axes


def draw_limits(axes: Axes, limits: Limits | None, *, upright: bool) -> None:
    """Draw tolerance limits as dashed lines: upright across an axis of deviations along x, else level."""
    for value in () if limits is None else (limits.low_um, limits.high_um):
        line = axes.axvline if upright else axes.axhline
        line(value, color=LIMIT, linewidth=1.1, linestyle=(0, (5, 3)), zorder=4)


def point_deviations(deviation_map: DeviationMap) -> Array:
    """Return the deviations of the points that count, shape (n,), mm."""
    alignment = deviation_map.alignment
    values: Array = alignment.deviation_mm[alignment.judged]
    return values[np.isfinite(values)]


def rule(axes: Axes, *, upright: bool = False) -> None:
    """Draw the line of zero deviation: level, or upright."""
    (axes.axvline if upright else axes.axhline)(0.0, color=RULE, linewidth=0.9, zorder=1)


def with_limits(limit: float, limits: Limits) -> float:
    """Return half the range of an axis of deviations, um, with room for limits not far beyond it."""
    farthest = 1.08 * max(abs(limits.low_um), abs(limits.high_um))
    return max(limit, farthest) if farthest <= FARTHEST_LIMITS * limit else limit
