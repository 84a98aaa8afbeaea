"""Regions on a map: which part of the nominal is told, and which part steered the fit."""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from cmm_align.model import Alignment
from cmm_align.report.canvas import INK
from cmm_align.surfaces.region import region_from_text

_STEPS: Final = 900
_WIDTH: Final = 1.1
_DASHED: Final = (0.0, (5.0, 3.0))
_DOTTED: Final = (0.0, (1.0, 2.0))
"""Strokes and gaps, in line widths."""


def draw_regions(axes: Axes, alignment: Alignment) -> list[tuple[Artist, str]]:
    """Draw the report region dashed and the fit region dotted, and return what the lines mean.

    Parameters
    ----------
    axes : Axes
        In mm, frame `surface`.
    alignment : Alignment
        Regions that it does not have are not drawn.
    """
    surface, report = alignment.nominal.surface, alignment.report
    b = surface.bounds
    step = max(b.x_max - b.x_min, b.y_max - b.y_min) / _STEPS
    x = np.arange(b.x_min - 2.0 * step, b.x_max + 2.5 * step, step)
    y = np.arange(b.y_min - 2.0 * step, b.y_max + 2.5 * step, step)
    x_grid, y_grid = np.meshgrid(x, y)
    marks: list[tuple[Artist, str]] = []
    for text, line, word in (
        (report.report_region_text, _DASHED, "report region"),
        (report.fit_region_text, _DOTTED, "fit region"),
    ):
        if not text:
            continue
        region = region_from_text(text, surface)
        inside = region.contains(x_grid.ravel(), y_grid.ravel()).reshape(x_grid.shape)
        if inside.any() and not inside.all():
            axes.contour(
                x,
                y,
                inside.astype(float),
                levels=[0.5],
                colors=[INK],
                linewidths=_WIDTH,
                linestyles=[line],
                zorder=5,
            )
            marks.append((Line2D([], [], color=INK, linewidth=_WIDTH, linestyle=line), word))
    return marks
