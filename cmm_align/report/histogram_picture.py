"""The histogram of a map: how its nodes and its points are distributed, beside the normal of the same RMS."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cmm_align.model import DeviationMap
from cmm_align.report.canvas import INK, SIGN, SOFT, STYLE, limit_um, save, signed, thin
from cmm_align.report.chart import (
    ABOVE,
    FOOT_IN,
    LIMIT,
    PALE,
    chart,
    chart_sheet,
    draw_limits,
    point_deviations,
    rule,
    with_limits,
)
from cmm_align.report.wishes import Limits
from cmm_align.surfaces.protocol import Array
from cmm_align.units import UM_PER_MM

MOST_BINS: Final = 60
LEAST_BINS: Final = 16
BINS_PER_ROOT: Final = 4.0
"""Bins over the cube root of the number of nodes: few nodes would only show their scatter."""
PERCENTILES: Final = (0.0, 1.0, 5.0, 25.0, 50.0, 75.0, 95.0, 99.0, 100.0)
"""Of the table; 0 and 100 are the extremes."""
DOTTED: Final = (0, (1.5, 1.5))
_BODY_IN: Final = 4.5
_STRIP_IN: Final = 0.62
_LEFT_IN: Final = 0.82
_WIDE_IN: Final = 5.75
_TABLE_IN: Final = 7.05


def draw_histogram(
    deviation_map: DeviationMap,
    path: Path | str,
    title: str = "Histogram",
    source: str = "",
    *,
    scale_um: float = 0.0,
    limits: Limits | None = None,
) -> None:
    """Write the histogram of the nodes and of the single points of a map.

    Parameters
    ----------
    deviation_map : DeviationMap
    path : path
        Written as SVG where its suffix says so, else as PNG.
    title, source : str
        Headline, and the name of the file behind the map.
    scale_um : float
        Half the range shown; 0 for all of it.
    limits : Limits, optional
        Least and largest deviation allowed; drawn as dashed lines.
    """
    m = deviation_map
    nodes = m.deviation_mm[np.isfinite(m.deviation_mm)] * UM_PER_MM
    points = point_deviations(m) * UM_PER_MM
    limit = scale_um or limit_um(nodes / UM_PER_MM, points / UM_PER_MM)
    if limits is not None and not scale_um:
        limit = with_limits(limit, limits)
    rms_um = m.statistics.rms_mm * UM_PER_MM
    with mpl.rc_context(STYLE):
        lines = [f"distribution of the deviations; {SIGN}"]
        if limits is not None:
            lines.append(f"{_within(points, limits):.1f} % of the points within the {limits.words}")
        figure, height_in = chart_sheet(m, _BODY_IN, title, source, lines)
        high_in = _BODY_IN - _STRIP_IN
        axes = chart(figure, _LEFT_IN, FOOT_IN + _STRIP_IN, _WIDE_IN, high_in)
        bins = 2 * int(np.clip(0.5 * BINS_PER_ROOT * np.cbrt(len(nodes)), LEAST_BINS // 2, MOST_BINS // 2))
        edges = np.linspace(-limit, limit, bins + 1)
        width = edges[1] - edges[0]
        axes.stairs(
            _shares(points, edges),
            edges,
            fill=True,
            color=PALE,
            zorder=2,
            label=f"single points, N {thin(len(points))}",
        )
        axes.stairs(
            _shares(nodes, edges), edges, color=INK, lw=1.6, zorder=3, label=f"nodes, N {thin(len(nodes))}"
        )
        if rms_um > 0.0:
            x = np.linspace(-limit, limit, 400)
            normal = 100.0 * width * np.exp(-0.5 * (x / rms_um) ** 2) / (rms_um * np.sqrt(2.0 * np.pi))
            axes.plot(
                x, normal, color=ABOVE, lw=1.4, ls=(0, (1.5, 1.5)), label="normal of the same RMS", zorder=4
            )
        rule(axes, upright=True)
        draw_limits(axes, limits, upright=True)
        if limits is not None:
            axes.plot([], [], color=LIMIT, lw=1.1, ls=(0, (5, 3)), label="limits")
        axes.set(xlim=(-limit, limit), ylim=(0.0, 1.08 * axes.get_ylim()[1]), ylabel="share of all, %")
        axes.tick_params(labelbottom=False)
        _strip(figure, points, nodes, limit)
        _table(figure, height_in, nodes, points)
        figure.legend(
            *axes.get_legend_handles_labels(),
            loc="lower left",
            bbox_to_anchor=((_TABLE_IN - 0.02) / figure.get_figwidth(), FOOT_IN / height_in),
            frameon=False,
            fontsize=8.5,
            labelcolor=SOFT,
            borderpad=0.0,
            borderaxespad=0.0,
        )
        save(figure, path)


def _shares(values: Array, edges: Array) -> Array:
    """Return the share of the values in each bin, percent; those beyond the edges are in none."""
    return np.asarray(100.0 * np.histogram(values, edges)[0] / len(values), dtype=np.float64)


def _within(points: Array, limits: Limits) -> float:
    """Return how many points keep the limits, percent."""
    return 100.0 * float(np.mean((points >= limits.low_um) & (points <= limits.high_um)))


def _strip(figure: Figure, points: Array, nodes: Array, limit: float) -> None:
    """Draw where the middle half (thick) and nine tenths (thin) of nodes and points lie, under the bars."""
    axes: Axes = chart(figure, _LEFT_IN, FOOT_IN, _WIDE_IN, _STRIP_IN, grid="")
    for y, values, colour in ((1.0, points, "#8f9aa6"), (0.0, nodes, INK)):
        low, first, median, third, high = np.percentile(values, [5.0, 25.0, 50.0, 75.0, 95.0])
        axes.plot([low, high], [y, y], color=colour, lw=1.2, solid_capstyle="butt")
        axes.plot([first, third], [y, y], color=colour, lw=5.0, solid_capstyle="butt")
        axes.plot(median, y, marker="o", ms=5.5, mfc="white", mec=colour, mew=1.3)
    axes.set(xlim=(-limit, limit), ylim=(-0.75, 1.75), yticks=[0.0, 1.0], xlabel="deviation, µm")
    axes.set_yticklabels(["nodes", "points"])
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)


def _table(figure: Figure, height_in: float, nodes: Array, points: Array) -> None:
    """Write percentiles of nodes and points at the right."""
    rows = [("percentile", "nodes", "points")]
    both = np.percentile(nodes, PERCENTILES), np.percentile(points, PERCENTILES)
    largest = max(float(np.abs(v).max()) for v in both)
    digits = 3 if largest < 1.0 else 2 if largest < 100.0 else 1
    for k, share in enumerate(PERCENTILES):
        name = {0.0: "lowest", 50.0: "median", 100.0: "highest"}.get(share, f"{share:g} %")
        rows.append((name, signed(float(both[0][k]), digits), signed(float(both[1][k]), digits)))
    top_in = FOOT_IN + _BODY_IN - 0.12
    for k, row in enumerate(rows):
        y = (top_in - 0.27 * k - (0.08 if k else 0.0)) / height_in
        for x_in, text, side in zip((0.0, 1.32, 2.02), row, ("left", "right", "right"), strict=True):
            colour, weight = (SOFT, "normal") if k == 0 or x_in == 0.0 else (INK, "normal")
            figure.text(
                (_TABLE_IN + x_in) / figure.get_figwidth(),
                y,
                text,
                ha=side,
                va="center",
                fontsize=9,
                color=colour,
                weight=weight,
            )
    y = (top_in - 0.27 * len(rows) - 0.02) / height_in
    words = "in µm; bars below the histogram:\nmiddle half (thick), 5 to 95 % (thin)"
    left = _TABLE_IN / figure.get_figwidth()
    figure.text(left, y, words, fontsize=8, color=SOFT, va="top", linespacing=1.4)
