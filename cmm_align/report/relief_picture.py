"""A map as a relief: the deviation as height, much exaggerated, seen from one side in the colours of the map.

The view is an axonometric one: x, y and height are projected along parallel rays, so that lengths along each
axis can be measured. Cells are drawn from the back to the front, lit from the upper left.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap

from cmm_align.model import DeviationMap
from cmm_align.report.canvas import (
    RULE,
    SIGN,
    SOFT,
    STYLE,
    WIDTH_IN,
    draw_scale,
    limit_um,
    save,
    signed,
)
from cmm_align.report.chart import FOOT_IN, chart_sheet
from cmm_align.report.deviation_colours import deviation_colours
from cmm_align.report.field import cell_middles, resampled
from cmm_align.report.wording import minus
from cmm_align.surfaces.protocol import Array, Bounds
from cmm_align.units import UM_PER_MM

AZIMUTH_DEG: Final = 28.0
"""By which the part is turned about z: +x then points to the right and to the front."""
ELEVATION_DEG: Final = 32.0
HEIGHT: Final = 0.22
"""Height of half the range of colours, as a share of the longer side of the part."""
CELLS: Final = 220
"""Along the longer side."""
_LIGHT: Final = np.array([-0.55, -0.35, 0.76])
_WIDE_IN: Final = 7.8
_HIGHEST_IN: Final = 6.4


def draw_relief(
    deviation_map: DeviationMap,
    path: Path | str,
    title: str = "Relief",
    source: str = "",
    *,
    scale_um: float = 0.0,
) -> None:
    """Write the deviation as a relief over the plane of the part.

    Parameters
    ----------
    deviation_map : DeviationMap
        Unknown nodes are left out: one looks through holes onto the ground.
    path : path
        Written as SVG where its suffix says so, else as PNG.
    title, source : str
        Headline, and the name of the file behind the map.
    scale_um : float
        The colours reach from minus to plus this, and the exaggeration follows it; 0 for those of the map.
    """
    m, b = deviation_map, deviation_map.alignment.nominal.surface.bounds
    limit = scale_um or limit_um(m.deviation_mm)
    longer = max(b.x_max - b.x_min, b.y_max - b.y_min)
    times = HEIGHT * longer / (limit / UM_PER_MM)
    with mpl.rc_context(STYLE):
        lines = [f"deviation as height; {SIGN}", f"heights are exaggerated {_round(times)} times"]
        floor = -1.05 * HEIGHT * longer
        left, right, low, high = _frame(b, floor, longer)
        wide_in = min(_WIDE_IN, _HIGHEST_IN * (right - left) / (high - low))
        body_in = wide_in * (high - low) / (right - left)
        figure, height_in = chart_sheet(m, body_in, title, source, lines)
        left_in = 0.5 * (_WIDE_IN - wide_in) + 0.35
        box = (left_in / WIDTH_IN, FOOT_IN / height_in, wide_in / WIDTH_IN, body_in / height_in)
        axes = figure.add_axes(box)
        axes.axis("off")
        _ground(axes, b, floor)
        _surface(axes, m, limit, times)
        _heights(axes, b, limit, times)
        axes.set(xlim=(left, right), ylim=(low, high))
        image = mpl.image.AxesImage(axes, cmap=_colours())
        image.set_clim(-limit, limit)
        image.set_data(np.zeros((1, 1)))
        tall_in = min(2.6, 0.7 * body_in)
        bar = (8.35 / WIDTH_IN, (FOOT_IN + 0.5 * (body_in - tall_in)) / height_in, 0.017, tall_in / height_in)
        draw_scale(figure, image, bar, limit)
        save(figure, path)


def at(x: float, y: float, z: float) -> tuple[float, float]:
    """Return the place on the sheet of one point in space, mm."""
    right, up = projected(np.array([x]), np.array([y]), np.array([z]))
    return float(right[0]), float(up[0])


def projected(x: Array, y: Array, z: Array) -> tuple[Array, Array]:
    """Return the places on the sheet of points in space; all of one shape, mm.

    Parameters
    ----------
    x, y, z : ndarray, same shapes, mm
        Frame `surface`, z the exaggerated height.

    Returns
    -------
    right, up : ndarray, same shape, mm
    """
    turn, tilt = np.deg2rad(AZIMUTH_DEG), np.deg2rad(ELEVATION_DEG)
    right = x * np.cos(turn) + y * np.sin(turn)
    depth = -x * np.sin(turn) + y * np.cos(turn)
    return right, depth * np.sin(tilt) + z * np.cos(tilt)


def _frame(b: Bounds, floor: float, longer: float) -> tuple[float, float, float, float]:
    """Return left, right, low and high of what is drawn, with room for its labels, mm on the sheet."""
    x, y, z = np.meshgrid([b.x_min, b.x_max], [b.y_min, b.y_max], [floor, HEIGHT * longer])
    right, up = projected(x.ravel(), y.ravel(), z.ravel())
    left, low = float(right.min()) - 0.19 * longer, float(up.min()) - 0.06 * longer
    return left, float(right.max()) + 0.10 * longer, low, float(up.max())


def _surface(axes: Axes, m: DeviationMap, limit: float, times: float) -> None:
    """Draw the cells whose four corners are known, the farthest first."""
    nominal = m.alignment.nominal
    values, extent = resampled(nominal, m.x_mm, m.y_mm, m.deviation_mm, CELLS)
    every = max(1, max(values.shape) // CELLS)
    x, y = (places[::every] for places in cell_middles(values.shape, extent))
    x_grid, y_grid = np.meshgrid(x, y)
    inside = nominal.surface.contains(x_grid.ravel(), y_grid.ravel()).reshape(x_grid.shape)
    e = np.ma.filled(values[::every, ::every], np.nan)
    there = inside & np.isfinite(e)
    known = there[:-1, :-1] & there[1:, :-1] & there[:-1, 1:] & there[1:, 1:]
    z = np.where(there, e, 0.0) * times
    middle = 0.25 * (z[:-1, :-1] + z[1:, :-1] + z[:-1, 1:] + z[1:, 1:])
    rise_x = 0.5 * (z[:-1, 1:] - z[:-1, :-1] + z[1:, 1:] - z[1:, :-1]) / (x[1] - x[0])
    rise_y = 0.5 * (z[1:, :-1] - z[:-1, :-1] + z[1:, 1:] - z[:-1, 1:]) / (y[1] - y[0])
    normal = np.stack([-rise_x, -rise_y, np.ones_like(rise_x)], axis=-1)
    light = (normal @ _LIGHT) / (np.linalg.norm(normal, axis=-1) * np.linalg.norm(_LIGHT))
    shade = np.clip(0.72 + 0.36 * light, 0.45, 1.0)
    colour = _colours()(0.5 + 0.5 * np.clip(middle / times * UM_PER_MM / limit, -1.0, 1.0))
    colour[..., :3] *= shade[..., None]
    colour[..., 3] = known
    right, up = projected(x_grid, y_grid, z)
    # Seen from the front at the left, larger y lie farther off, and so do smaller x.
    axes.pcolormesh(right[::-1], up[::-1], colour[::-1], rasterized=True, zorder=3, antialiased=False)


def _ground(axes: Axes, b: Bounds, floor: float) -> None:
    """Draw the rectangle of the part below the relief, with a few coordinates along its front edges."""
    corners_x = np.array([b.x_min, b.x_max, b.x_max, b.x_min])
    corners_y = np.array([b.y_min, b.y_min, b.y_max, b.y_max])
    right, up = projected(corners_x, corners_y, np.full(4, floor))
    axes.fill(right, up, facecolor="#f3f5f7", edgecolor=RULE, lw=0.9, zorder=1)
    longer = max(b.x_max - b.x_min, b.y_max - b.y_min)
    gap = 0.035 * longer
    for axis, low, high in (("x", b.x_min, b.x_max), ("y", b.y_min, b.y_max)):
        for value in _ticks(low, high, longer):
            x, y = (value, b.y_min) if axis == "x" else (b.x_max, value)
            ax, ay = (0.0, -gap) if axis == "x" else (gap, 0.0)
            start, end = at(x, y, floor), at(x + 0.5 * ax, y + 0.5 * ay, floor)
            axes.plot([start[0], end[0]], [start[1], end[1]], color=RULE, lw=0.9, zorder=1)
            place = at(x + 1.3 * ax, y + 1.3 * ay, floor)
            axes.text(*place, minus(value), fontsize=9, color=SOFT, ha="center", va="center")
        middle = 0.5 * (low + high)
        x, y = (middle, b.y_min - 3.4 * gap) if axis == "x" else (b.x_max + 3.4 * gap, middle)
        axes.text(*at(x, y, floor), f"{axis}, mm", fontsize=9, color=SOFT, ha="center", va="center")


def _heights(axes: Axes, b: Bounds, limit: float, times: float) -> None:
    """Draw a scale of heights at the left corner."""
    longer = max(b.x_max - b.x_min, b.y_max - b.y_min)
    x, y = b.x_min - 0.05 * longer, b.y_min
    digits = 0 if limit >= 10.0 and float(limit).is_integer() else 1 if limit >= 1.0 else 3
    places = [(value, at(x, y, value / UM_PER_MM * times)) for value in (-limit, 0.0, limit)]
    for value, (right, up) in places:
        axes.plot([right - 0.012 * longer, right], [up, up], color=SOFT, lw=0.9)
        words = f"{signed(value, digits)} µm"
        axes.text(right - 0.025 * longer, up, words, fontsize=9, color=SOFT, ha="right", va="center")
    axes.plot([p[0] for _, p in places], [p[1] for _, p in places], color=SOFT, lw=0.9)


def _ticks(low: float, high: float, longer: float) -> list[float]:
    """Return a few round coordinates between two ends."""
    from matplotlib.ticker import MaxNLocator

    most = max(2, round(6 * (high - low) / longer))
    return [
        float(t) for t in MaxNLocator(most, steps=[1, 2, 5, 10]).tick_values(low, high) if low <= t <= high
    ]


def _colours() -> ListedColormap:
    """Return the colours of a deviation."""
    return ListedColormap(deviation_colours(), name="deviation")


def _round(times: float) -> str:
    """Return a factor with two digits that count."""
    unit = 10.0 ** (np.floor(np.log10(times)) - 1.0)
    value = round(times / unit) * unit
    return f"{value:,.0f}".replace(",", "\N{THIN SPACE}") if value >= 10.0 else f"{value:.2g}"
