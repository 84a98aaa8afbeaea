"""The picture of a measuring plan: its points on the part, in the order of travel."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from cmm_align.model import Nominal
from cmm_align.report.canvas import (
    INK,
    RULE,
    SOFT,
    STYLE,
    WIDTH_IN,
    draw_aperture,
    dress,
    footer,
    header,
    save,
    sheet,
)
from cmm_align.report.map_picture import map_size, origin, version
from cmm_align.surfaces.protocol import Array, Mask

BASE_INK: Final = "#0b4a8f"
DENSE_INK: Final = "#b5471b"

_HEAD_IN: Final = 0.95
_FOOT_IN: Final = 1.0
_POINT_AREA: Final = 0.10
"""Area of a dot as a share of the area that belongs to its point."""


def draw_plan(
    nominal: Nominal,
    places_mm: Array,
    dense: Mask,
    numbers: Sequence[tuple[str, str]],
    path: Path | str,
    title: str = "Measuring plan",
    source: str = "",
) -> None:
    """Write the points of a measuring plan on the outline of the part, 1410 pixels wide.

    Parameters
    ----------
    nominal : Nominal
    places_mm : ndarray, shape (n, 2), mm, frame `surface`
        In the order of travel.
    dense : ndarray of bool, shape (n,)
        Points in or beside feature regions.
    numbers : sequence of (label, value)
        Up to three for the head of the page.
    path : path
        Written as SVG where its suffix says so, else as PNG.
    title : str
        Headline; shown as it is.
    source : str
        Name of the file of the nominal, for the foot of the sheet.
    """
    b = nominal.surface.bounds
    with mpl.rc_context(STYLE):
        width_in, map_in = map_size(b, 0.86 * WIDTH_IN, 7.6)
        height_in = map_in + _HEAD_IN + _FOOT_IN
        figure = sheet(height_in)
        wide, tall = width_in / WIDTH_IN, map_in / height_in
        axes = figure.add_axes((0.088 + 0.5 * (0.86 - wide), _FOOT_IN / height_in, wide, tall))
        blank = axes.imshow([[0.0]], extent=(b.x_min, b.x_max, b.y_min, b.y_max), alpha=0.0)
        draw_aperture(axes, nominal, blank, hatched=False)
        axes.plot(places_mm[:, 0], places_mm[:, 1], color=RULE, linewidth=0.5, zorder=2)
        area_pt = (width_in * 72.0) * (map_in * 72.0) / max(len(places_mm), 1)
        size = float(np.clip(_POINT_AREA * area_pt, 0.4, 14.0))
        for mask, ink in ((~dense, BASE_INK), (dense, DENSE_INK)):
            axes.scatter(places_mm[mask, 0], places_mm[mask, 1], s=size, color=ink, linewidths=0, zorder=3)
        axes.plot(*places_mm[0], marker="o", ms=7, mfc="white", mec=INK, mew=1.3, zorder=5, clip_on=False)
        axes.plot(*places_mm[-1], marker="s", ms=6, mfc=INK, mec="white", mew=1.0, zorder=5, clip_on=False)
        dress(axes, nominal)
        _legend(figure, dense, height_in)
        header(
            figure,
            title,
            ["contact points on the nominal, in the order of travel"],
            list(numbers),
            height_in,
        )
        footer(figure, [source, *origin(nominal), version()], height_in)
        save(figure, path)


def _legend(figure: Figure, dense: Mask, height_in: float) -> None:
    """Say what the dots and marks are, at the foot of the page."""
    n_dense = int(np.count_nonzero(dense))
    dots = [(BASE_INK, f"{len(dense) - n_dense} at the base spacing")]
    if n_dense:
        dots.append((DENSE_INK, f"{n_dense} in feature regions, five times as dense"))
    marks = [Line2D([], [], ls="", marker="o", ms=4, mfc=ink, mec="none") for ink, _ in dots]
    marks.append(Line2D([], [], ls="", marker="o", ms=6, mfc="white", mec=INK))
    marks.append(Line2D([], [], ls="", marker="s", ms=5, mfc=INK, mec="white"))
    figure.legend(
        marks,
        [*(word for _, word in dots), "first", "last"],
        loc="lower left",
        bbox_to_anchor=(0.055, 0.27 / height_in),
        ncols=4,
        frameon=False,
        fontsize=8.5,
        labelcolor=SOFT,
        handletextpad=0.2,
        columnspacing=1.6,
    )
