"""A map against its tolerance: green is within, blue below, red above, in steps of the tolerance."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.patches import Rectangle
from matplotlib.path import Path as MplPath

from cmm_align.errors import GeometryError
from cmm_align.model import DeviationMap
from cmm_align.report.canvas import (
    INK,
    SOFT,
    STYLE,
    WIDTH_IN,
    draw_aperture,
    dress,
    hatched_patch,
    save,
)
from cmm_align.report.chart import HEAD_IN, chart_sheet, point_deviations
from cmm_align.report.field import cell_middles, draw_field, unknown_inside
from cmm_align.report.map_picture import map_size, mark_extremes
from cmm_align.report.wishes import Limits
from cmm_align.report.wording import minus
from cmm_align.surfaces.protocol import Array
from cmm_align.units import UM_PER_MM

BAND_COLOURS: Final = ("#1b4f8f", "#6fa3d8", "#c4e0c6", "#e9f4e6", "#c4e0c6", "#e8925c", "#8f3410")
"""From far below to far above; light within, so that what is out shows in grey print too."""
_SIGNS: Final = {0: "--", 1: "--", 5: "++", 6: "++"}
"""Hatches of what is out: they tell below from above where there is no colour."""
_SIGN_INK: Final = (1.0, 1.0, 1.0, 0.75)
_FAR_UM: Final = 1e12
_KEY_IN: Final = 6.86
_MAP_WIDTH: Final = 0.59
_MAX_MAP_IN: Final = 7.2
_LEFT: Final = 0.095
_HATCH_PIXELS: Final = 300


def draw_bands(
    deviation_map: DeviationMap,
    path: Path | str,
    title: str = "Tolerance bands",
    source: str = "",
    *,
    limits: Limits | None = None,
) -> None:
    """Write the map in the colours of a tolerance, with the share of the map in each band.

    Parameters
    ----------
    deviation_map : DeviationMap
    path : path
        Written as SVG where its suffix says so, else as PNG.
    title, source : str
        Headline, and the name of the file behind the map.
    limits : Limits
        Least and largest deviation allowed.

    Raises
    ------
    GeometryError
        Without limits.
    """
    if limits is None:
        raise GeometryError(
            "there is no tolerance of single deviations to colour the map by",
            remedy="give a tolerance, as --tolerance-pv 10um",
        )
    m = deviation_map
    nominal, b = m.alignment.nominal, m.alignment.nominal.surface.bounds
    edges = band_edges(limits)
    with mpl.rc_context(STYLE):
        width_in, map_in = map_size(b, _MAP_WIDTH * WIDTH_IN, _MAX_MAP_IN)
        points = point_deviations(m) * UM_PER_MM
        out = float(np.mean((points < limits.low_um) | (points > limits.high_um)))
        lines = [f"deviation against the {limits.words}", f"{100.0 * out:.1f} % of the single points are out"]
        figure, height_in = chart_sheet(m, max(map_in, 3.3), title, source, lines)
        bottom = (height_in - HEAD_IN - map_in) / height_in
        left = _LEFT + max(0.0, 0.5 * (_MAP_WIDTH - width_in / WIDTH_IN))
        axes = figure.add_axes((left, bottom, width_in / WIDTH_IN, map_in / height_in))
        image = draw_field(axes, nominal, m.x_mm, m.y_mm, m.deviation_mm, float(np.abs(edges).max()))
        colours = ListedColormap(list(BAND_COLOURS)).with_extremes(bad=(0.0, 0.0, 0.0, 0.0))
        image.set_cmap(colours)
        image.set_norm(BoundaryNorm([-_FAR_UM, *edges, _FAR_UM], len(BAND_COLOURS)))
        outline = draw_aperture(axes, nominal, image)
        _hatch(axes, image, edges, outline)
        dress(axes, nominal)
        mark_extremes(axes, m.statistics, b)
        _key(figure, m, edges, height_in)
        save(figure, path)


def band_edges(limits: Limits) -> Array:
    """Return the borders of the bands, shape (6,), um: half of the tolerance, all of it, and twice."""
    middle, half = 0.5 * (limits.low_um + limits.high_um), 0.5 * (limits.high_um - limits.low_um)
    return np.array([middle + share * half for share in (-2.0, -1.0, -0.5, 0.5, 1.0, 2.0)])


def _hatch(axes: Axes, image: AxesImage, edges: Array, outline: MplPath) -> None:
    """Hatch what is out with signs: minus below, plus above."""
    shown: Array = np.ma.filled(np.ma.asarray(image.get_array()), np.nan)
    ny, nx = shown.shape
    every = max(1, max(nx, ny) // _HATCH_PIXELS)
    left, right, low, high = image.get_extent()
    x, y = (places[::every] for places in cell_middles((ny, nx), (left, right, low, high)))
    values = shown[::every, ::every]
    for levels, sign in (([-_FAR_UM, edges[1]], "--"), ([edges[4], _FAR_UM], "++")):
        if np.nanmin(values) < levels[1] and np.nanmax(values) > levels[0]:
            signs = axes.contourf(x, y, values, levels=levels, colors="none", hatches=[sign], zorder=3)
            signs.set(edgecolor=_SIGN_INK, linewidth=0.0)
            signs.set_clip_path(outline, transform=axes.transData)


def _key(figure: Figure, m: DeviationMap, edges: Array, height_in: float) -> None:
    """Draw a swatch of each band with its limits and its share of the nodes, the highest on top."""
    nodes = m.deviation_mm[np.isfinite(m.deviation_mm)] * UM_PER_MM
    shares = np.histogram(nodes, [-np.inf, *edges, np.inf])[0] / len(nodes)
    names = [f"below {minus(edges[0])}"]
    names += [f"{minus(a)} to {minus(b)}" for a, b in pairwise(edges)]
    names.append(f"above {minus(edges[-1])}")
    top_in = height_in - HEAD_IN - 0.12
    for x_in, text, side in ((0.0, "deviation, µm", "left"), (2.2, "of the map", "right")):
        x, y = (_KEY_IN + x_in) / WIDTH_IN, top_in / height_in
        figure.text(x, y, text, fontsize=9, color=SOFT, ha=side, va="center")
    for row, k in enumerate(reversed(range(len(names)))):
        y_in = top_in - 0.42 - 0.33 * row
        patch = Rectangle(
            (_KEY_IN / WIDTH_IN, (y_in - 0.12) / height_in),
            0.42 / WIDTH_IN,
            0.24 / height_in,
            transform=figure.transFigure,
            facecolor=BAND_COLOURS[k],
            edgecolor=_SIGN_INK,
            hatch=_SIGNS.get(k),
            linewidth=0.0,
        )
        figure.add_artist(patch)
        within = 2 <= k <= 4
        for x_in, text, side in ((0.54, names[k], "left"), (2.2, f"{100.0 * shares[k]:.1f} %", "right")):
            x, y = (_KEY_IN + x_in) / WIDTH_IN, y_in / height_in
            weight = "bold" if not within and shares[k] > 0.0 else "normal"
            figure.text(x, y, text, fontsize=9, color=INK, ha=side, va="center", weight=weight)
    last_in = top_in - 0.42 - 0.33 * len(names)
    if unknown_inside(m.alignment.nominal, m.x_mm, m.y_mm, m.deviation_mm):
        patch = hatched_patch()
        patch.set_bounds(_KEY_IN / WIDTH_IN, (last_in - 0.12) / height_in, 0.42 / WIDTH_IN, 0.24 / height_in)
        patch.set_transform(figure.transFigure)
        figure.add_artist(patch)
        at = ((_KEY_IN + 0.54) / WIDTH_IN, last_in / height_in)
        figure.text(*at, "not measured", fontsize=9, color=INK, va="center")
        last_in -= 0.33
    y = (last_in - 0.08) / height_in
    words = "green: within the limits\nblue, \N{MINUS SIGN}: too low;  red, +: too high"
    figure.text(_KEY_IN / WIDTH_IN, y, words, fontsize=8, color=SOFT, va="center", linespacing=1.5)
