"""Where the points lie that did not steer the fit, and why: a mark and a count for each reason."""

from __future__ import annotations

from pathlib import Path
from typing import Final, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from cmm_align.model import Alignment, DeviationMap, PointStatus
from cmm_align.report.canvas import INK, SOFT, STYLE, WIDTH_IN, draw_aperture, dress, save, signed, thin
from cmm_align.report.chart import HEAD_IN, chart_sheet
from cmm_align.report.map_picture import map_size
from cmm_align.surfaces.protocol import Array, Bounds, Mask
from cmm_align.units import UM_PER_MM

MOST_MARKS: Final = 3000
"""Of each kind; of more only so many are drawn, evenly through the file, and that is said."""
MOST_LISTED: Final = 8
"""Outliers with their deviation at the right, the largest first."""

_MAP_WIDTH: Final = 0.59
_MAX_MAP_IN: Final = 6.6
_LEFT: Final = 0.095
_KEY_IN: Final = 6.86
_ROOM: Final = 0.03
_BEYOND: Final = 0.12
"""Room around the part for points beside it, as a share of its longer side."""


class Mark(NamedTuple):
    """How points of one status are drawn."""

    words: str
    marker: str
    colour: str
    size: float
    filled: bool


MARKS: Final[dict[PointStatus, Mark]] = {
    PointStatus.USED: Mark("steered the fit", ".", "#8592a0", 2.6, True),
    PointStatus.EDGE: Mark("in the band along the edge", "s", "#2f6fb5", 3.2, True),
    PointStatus.APART: Mark("apart: outside the fit region", "D", "#7d5ba6", 3.0, True),
    PointStatus.NOT_REACHED: Mark("the ball does not reach there", "^", "#a37400", 4.5, True),
    PointStatus.OUTSIDE: Mark("outside the nominal", "x", "#1d2733", 5.0, False),
    PointStatus.OUTLIER: Mark("outlier", "o", "#c2410c", 6.0, False),
}
"""In the order in which they are drawn: the rarest on top. Shape and colour tell them apart."""


def draw_outliers(
    deviation_map: DeviationMap, path: Path | str, title: str = "Points", source: str = ""
) -> None:
    """Write where the points lie that did not steer the fit, by reason.

    Parameters
    ----------
    deviation_map : DeviationMap
    path : path
        Written as SVG where its suffix says so, else as PNG.
    title, source : str
        Headline, and the name of the file behind the map.
    """
    m, alignment = deviation_map, deviation_map.alignment
    nominal, b = alignment.nominal, alignment.nominal.surface.bounds
    anyone = bool((alignment.status == PointStatus.OUTSIDE).any())
    room = (_BEYOND if anyone else _ROOM) * max(b.x_max - b.x_min, b.y_max - b.y_min)
    wide = Bounds(b.x_min - room, b.x_max + room, b.y_min - room, b.y_max + room)
    x, y, _ = nominal.surface_from_part.apply(alignment.contact_part_mm).T
    beside = (x < wide.x_min) | (x > wide.x_max) | (y < wide.y_min) | (y > wide.y_max)
    with mpl.rc_context(STYLE):
        width_in, map_in = map_size(wide, _MAP_WIDTH * WIDTH_IN, _MAX_MAP_IN)
        n_not = int(np.count_nonzero(alignment.status != PointStatus.USED))
        share = 100.0 * n_not / len(alignment.status)
        lines = [
            "points by what they did in the fit; those that did not steer it are marked",
            f"{thin(n_not)} of {thin(len(alignment.status))} did not steer it ({share:.2g} %); "
            f"{thin(int(np.count_nonzero(~alignment.judged)))} do not count in the numbers",
        ]
        listed = bool((alignment.status == PointStatus.OUTLIER).any())
        figure, height_in = chart_sheet(m, max(map_in, 4.6 if listed else 2.4), title, source, lines)
        bottom = (height_in - HEAD_IN - map_in) / height_in
        left = _LEFT + max(0.0, 0.5 * (_MAP_WIDTH - width_in / WIDTH_IN))
        axes = figure.add_axes((left, bottom, width_in / WIDTH_IN, map_in / height_in))
        blank = axes.imshow([[0.0]], extent=(b.x_min, b.x_max, b.y_min, b.y_max), alpha=0.0)
        draw_aperture(axes, nominal, blank, hatched=False)
        _draw_marks(axes, alignment, x, y)
        dress(axes, nominal)
        axes.set(xlim=(wide.x_min, wide.x_max), ylim=(wide.y_min, wide.y_max))
        row = _key(figure, alignment, height_in)
        if beside.any():
            row = _say(figure, height_in, row, f"{thin(int(beside.sum()))} beyond the picture", SOFT)
        if max(np.bincount(alignment.status)) > MOST_MARKS:
            row = _say(figure, height_in, row, "where many, a sample is drawn", SOFT)
        _list(figure, alignment, x, y, height_in, row + 0.6)
        save(figure, path)


def _draw_marks(axes: Axes, alignment: Alignment, x: Array, y: Array) -> None:
    """Draw a mark for each point; of many an even sample."""
    for order, (status, mark) in enumerate(MARKS.items()):
        pick = np.flatnonzero(alignment.status == status)
        pick = pick[:: max(1, -(-len(pick) // MOST_MARKS))]
        axes.plot(
            x[pick],
            y[pick],
            linestyle="",
            marker=mark.marker,
            ms=mark.size,
            mec=mark.colour,
            mfc=mark.colour if mark.filled else "none",
            mew=0.0 if mark.filled else 1.4,
            zorder=5 + order,
            rasterized=len(pick) > 500,
        )


def _key(figure: Figure, alignment: Alignment, height_in: float) -> float:
    """Write each reason with its mark and count; return the row after it."""
    row = 0.0
    for status, mark in reversed(MARKS.items()):
        count = int(np.count_nonzero(alignment.status == status))
        y = (height_in - HEAD_IN - 0.15 - 0.27 * row) / height_in
        colour = INK if count else SOFT
        size = max(1.25 * mark.size, 5.0)
        handle = Line2D(
            [(_KEY_IN + 0.06) / WIDTH_IN],
            [y],
            marker=mark.marker,
            ms=size,
            mec=mark.colour,
            mfc=mark.colour if mark.filled else "none",
            mew=0.0 if mark.filled else 1.4,
            transform=figure.transFigure,
        )
        figure.add_artist(handle)
        figure.text((_KEY_IN + 0.2) / WIDTH_IN, y, mark.words, fontsize=8.5, color=colour, va="center")
        number = (
            {"fontsize": 9, "weight": "bold"} if count and status != PointStatus.USED else {"fontsize": 9}
        )
        figure.text(
            (_KEY_IN + 2.25) / WIDTH_IN, y, thin(count), color=colour, ha="right", va="center", **number
        )
        row += 1.0
    return row


def _say(figure: Figure, height_in: float, row: float, text: str, colour: str) -> float:
    """Write one line at the right; return the row after it."""
    y = (height_in - HEAD_IN - 0.15 - 0.27 * row) / height_in
    figure.text((_KEY_IN + 0.2) / WIDTH_IN, y, text, fontsize=8, color=colour, va="center")
    return row + 1.0


def _list(figure: Figure, alignment: Alignment, x: Array, y: Array, height_in: float, row: float) -> None:
    """Write the largest outliers with id, place and deviation."""
    wrong: Mask = (alignment.status == PointStatus.OUTLIER) & np.isfinite(alignment.deviation_mm)
    pick = np.flatnonzero(wrong)
    if len(pick) == 0:
        return
    pick = pick[np.argsort(-np.abs(alignment.deviation_mm[pick]), kind="stable")][:MOST_LISTED]
    rows = [("outlier", "x, y, mm", "µm")]
    for k in pick:
        um = float(alignment.deviation_mm[k]) * UM_PER_MM
        digits = 1 if abs(um) < 1000.0 else 0
        rows.append((f"no. {alignment.ids[k]}", f"{signed(x[k], 1)}, {signed(y[k], 1)}", signed(um, digits)))
    for number, texts in enumerate(rows):
        at = (height_in - HEAD_IN - 0.15 - 0.27 * row - 0.23 * number) / height_in
        for x_in, text, side in zip((0.0, 1.62, 2.25), texts, ("left", "right", "right"), strict=True):
            colour = SOFT if number == 0 else INK
            figure.text(
                (_KEY_IN + x_in) / WIDTH_IN, at, text, fontsize=8.5, color=colour, ha=side, va="center"
            )
