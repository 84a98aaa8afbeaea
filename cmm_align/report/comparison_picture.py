"""Before, after and difference of one part, side by side, with the outline of what changed."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle

from cmm_align.model import Change, Comparison, DeviationMap, Statistics
from cmm_align.report.canvas import (
    INK,
    SIGN,
    SOFT,
    STYLE,
    WIDTH_IN,
    Chip,
    draw_aperture,
    draw_scale,
    dress,
    footer,
    hatched_patch,
    header,
    legend,
    limit_um,
    save,
    sheet,
    three_digits,
)
from cmm_align.report.field import draw_field, unknown_inside
from cmm_align.report.map_picture import map_size, mark_extremes, origin, version
from cmm_align.surfaces.protocol import Array
from cmm_align.units import UM_PER_MM

OWN_SCALE: Final = 0.5
"""A difference smaller than this share of the common scale gets one of its own."""
_LEFT: Final = 0.062
_RIGHT: Final = 0.90
_GAP: Final = 0.025
_SCALE_ROOM: Final = 0.075
"""Width of a colour bar between the maps."""
_HEAD_IN: Final = 1.95
_FOOT_IN: Final = 1.04
_MAX_MAP_IN: Final = 5.0
_WORSE: Final = Chip("WORSE", "#b3261e")
_BETTER: Final = Chip("BETTER", "#1d7a3e")
_SAME: Final = Chip("NO CHANGE", "#66727f")
_OTHER: Final = Chip("CHANGED", "#8a5a00")


def draw_comparison(
    deviation_map: DeviationMap, path: Path | str, title: str = "What changed", source: str = ""
) -> None:
    """Write before, after and difference side by side.

    The first two share one zero-centred scale; the difference too, unless it is less than half as large: then
    it has its own, and the sheet says so.

    Parameters
    ----------
    deviation_map : DeviationMap
        With its comparison.
    path : path
        Written as SVG where its suffix says so, else as PNG.
    title : str
        Headline; shown as it is.
    source : str
        Name of the later measurement, for the foot of the sheet.
    """
    c = deviation_map.comparison
    if c is None:
        return
    change, nominal = c.change, deviation_map.alignment.nominal
    b = nominal.surface.bounds
    common, own = limit_um(c.before_mm, c.after_mm), limit_um(c.difference_mm)
    apart = own < OWN_SCALE * common
    own = own if apart else max(common, own)
    common = common if apart else own
    taken = 2 * _GAP + (_SCALE_ROOM if apart else 0.0)
    room = (_RIGHT - _LEFT - taken) / 3
    with mpl.rc_context(STYLE):
        width_in, map_in = map_size(b, room * WIDTH_IN, _MAX_MAP_IN)
        height_in = map_in + _HEAD_IN + _FOOT_IN
        figure = sheet(height_in)
        bottom, tall, wide = _FOOT_IN / height_in, map_in / height_in, width_in / WIDTH_IN
        left, hidden = _LEFT, 0
        marks: list[tuple[Artist, str]] = []
        panels: list[tuple[str, Array, Statistics, float]] = [
            ("before", c.before_mm, change.before, common),
            ("after", c.after_mm, change.after, common),
            ("difference, after \N{MINUS SIGN} before", c.difference_mm, change.difference, own),
        ]
        for k, (name, field, statistics, limit) in enumerate(panels):
            axes = figure.add_axes((left, bottom, wide, tall))
            image = draw_field(axes, nominal, c.x_mm, c.y_mm, field, limit)
            draw_aperture(axes, nominal, image)
            dress(axes, nominal, y_label=k == 0)
            mark_extremes(axes, statistics, b, size=8.0)
            above = bottom + tall
            figure.text(left, above + 0.34 / height_in, name, fontsize=11, weight="bold")
            figure.text(left, above + 0.10 / height_in, _numbers(statistics), fontsize=10, color=SOFT)
            hidden += unknown_inside(nominal, c.x_mm, c.y_mm, field)
            if k == 2 or (k == 1 and apart):
                scale = (left + wide + 0.012, bottom + 0.06 * tall, 0.012, 0.74 * tall)
                draw_scale(figure, image, scale, limit)
                left += _SCALE_ROOM if k == 1 else 0.0
            if k == 2:
                marks = _marked(axes, c)
                right = left + wide
            left += room + _GAP
        if hidden:
            marks.append((hatched_patch(), "not known to both"))
        legend(figure, marks, right, height_in)
        lines = [
            f"{SIGN}; the difference has a scale of its own" if apart else f"one scale for all; {SIGN}",
            *_folded(change),
        ]
        numbers = [("form changed on", f"{100.0 * change.share_changed:.0f} %")]
        header(figure, title, lines, numbers, height_in, _chip(change))
        earlier = f"before: {Path(change.earlier).name}" if change.earlier else ""
        footer(
            figure,
            [source, earlier, *origin(nominal), f"common grid {change.spacing_mm:.3g} mm", version()],
            height_in,
        )
        save(figure, path)


def _numbers(s: Statistics) -> str:
    """Return PV and RMS in one line."""
    return f"PV {three_digits(s.pv_mm * UM_PER_MM)}    RMS {three_digits(s.rms_mm * UM_PER_MM)} µm"


def _folded(change: Change) -> list[str]:
    """Return the verdict in three lines at most: what, better or worse, what is left."""
    words = [
        text.replace("->", "\N{RIGHTWARDS ARROW}").replace(" um", " µm").replace(" -", " \N{MINUS SIGN}")
        for text in change.words
    ]
    return [words[0], "; ".join(words[1:-1]), words[-1]] if len(words) > 2 else words


def _chip(change: Change) -> Chip:
    """Return the verdict in one word."""
    if not change.real:
        return _SAME
    return _WORSE if change.worse_than_before else _BETTER if change.better_than_before else _OTHER


def _marked(axes: Axes, c: Comparison) -> list[tuple[Artist, str]]:
    """Outline what changed, dot what did not, and return the marks for the legend."""
    if not c.changed.any():
        return []
    steps = c.x_mm[1] - c.x_mm[0], c.y_mm[1] - c.y_mm[0]
    x = np.concatenate([c.x_mm[:1] - steps[0], c.x_mm, c.x_mm[-1:] + steps[0]])
    y = np.concatenate([c.y_mm[:1] - steps[1], c.y_mm, c.y_mm[-1:] + steps[1]])
    same = np.isfinite(c.difference_mm) & ~c.changed
    if same.any():
        axes.contourf(
            x,
            y,
            np.pad(same.astype(np.float64), 1),
            levels=[0.5, 1.5],
            colors=["none"],
            hatches=["...."],
            zorder=4,
        )
    axes.contour(
        x, y, np.pad(c.changed.astype(np.float64), 1), levels=[0.5], colors=[INK], linewidths=0.9, zorder=5
    )
    marks: list[tuple[Artist, str]] = [(Line2D([], [], color=INK, linewidth=0.9), "form changed")]
    if same.any():
        dotted = Rectangle((0, 0), 1, 1, facecolor="white", edgecolor="#8b96a1", hatch="....", linewidth=0.5)
        marks.append((dotted, "within the noise"))
    return marks
