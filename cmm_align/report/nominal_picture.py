"""The picture of a nominal: how steep and how bent it is, where its features are, what the ball reaches."""

from __future__ import annotations

from pathlib import Path
from typing import Final, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from cmm_align.model import Equidistant, Nominal
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
    plain,
    save,
    sheet,
)
from cmm_align.report.deviation_colours import deviation_colours
from cmm_align.report.map_picture import map_size, origin, version
from cmm_align.surfaces.features import THRESHOLD_PER_MM
from cmm_align.surfaces.geometry import gaussian_curvature_per_mm2, principal_curvatures, slope
from cmm_align.surfaces.protocol import Array
from cmm_align.units import DEG_PER_RAD, mm_per

ACROSS: Final = 640
"""Samples along the longer side of a map."""
REACH_COLOURS: Final = ("#dfe7ef", "#9fb2c4", "#e08a5a", "#8f2f10")
REACH_WORDS: Final = ("reached", "edge near", "held off by surroundings", "tighter than the ball")
FEATURE_INK: Final = "#8f2f10"

_LEFT: Final = 0.088
_COLUMN: Final = 0.355
_STEP: Final = 0.478
_GAP_IN: Final = 0.72
_HEAD_IN: Final = 1.3
_FOOT_IN: Final = 1.15
_MAX_MAP_IN: Final = 3.4
_SUPERSCRIPT: Final = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_SMALL_CURVATURE: Final = 2e-3
"""Below this, in 1/mm, curvatures are told in 1/m."""


class _Maps(NamedTuple):
    """Fields on a raster, shape (ny, nx); NaN outside."""

    x_mm: Array
    y_mm: Array
    slope_deg: Array
    gauss: Array
    least: Array
    most: Array
    reach: Array


class _Panel(NamedTuple):
    """One small map."""

    title: str
    unit: str
    values: Array
    signed: bool
    low: float
    high: float


def draw_nominal(
    nominal: Nominal,
    path: Path | str,
    title: str = "Nominal",
    threshold_per_mm: float = THRESHOLD_PER_MM,
    source: str = "",
) -> None:
    """Write six maps of a nominal, 1410 pixels wide.

    Slope, Gaussian and both principal curvatures (positive where concave towards the probe), the difference
    of these with the feature regions outlined, and what the ball reaches.

    Parameters
    ----------
    nominal : Nominal
        With its equidistant net; drawn in frame `surface`.
    path : path
        Written as SVG where its suffix says so, else as PNG.
    title : str
        Headline; shown as it is.
    threshold_per_mm : float
        Feature regions: principal curvatures that differ by more, 1/mm.
    source : str
        Name of the file of the nominal, for the foot of the sheet.
    """
    maps = _maps(nominal)
    b = nominal.surface.bounds
    panels, scale = _panels(maps)
    with mpl.rc_context(STYLE):
        width_in, map_in = map_size(b, _COLUMN * WIDTH_IN, _MAX_MAP_IN)
        height_in = _HEAD_IN + 3 * map_in + 2 * _GAP_IN + _FOOT_IN
        figure = sheet(height_in)
        for k in range(6):
            column, row = k % 2, k // 2
            left = _LEFT + _STEP * column + 0.5 * (_COLUMN - width_in / WIDTH_IN)
            bottom = 1.0 - (_HEAD_IN + (row + 1) * map_in + row * _GAP_IN) / height_in
            box = (left, bottom, width_in / WIDTH_IN, map_in / height_in)
            axes = figure.add_axes(box)
            if k < 5:
                image = _draw(axes, maps, panels[k])
                _bar(figure, image, box, panels[k])
                if k == 4:
                    _outline_features(axes, maps, threshold_per_mm, scale)
            else:
                image = _draw_reach(axes, maps, nominal)
            draw_aperture(axes, nominal, image, hatched=False)
            dress(axes, nominal, y_label=column == 0)
            if row < 2:
                axes.set_xlabel("")
            name = panels[k].title if k < 5 else f"reach of the ball, r = {nominal.tip_radius_mm:g} mm"
            axes.set_title(plain(name), loc="left", fontsize=10, weight="bold", color=INK, pad=7)
        header(
            figure,
            title,
            ["maps of the nominal; curvature + = concave towards the probe"],
            _numbers(nominal),
            height_in,
        )
        footer(figure, [source, *origin(nominal), version()], height_in)
        save(figure, path)


def _numbers(nominal: Nominal) -> list[tuple[str, str]]:
    """Return the numbers at the head."""
    q = nominal.quality
    if q is None:
        return []
    radius = q.min_concave_radius_mm
    share = "\N{EN DASH}"
    if q.n_not_reached is not None:
        share = f"{100.0 * (1.0 - q.n_not_reached / q.n_points):.4g} %"
    return [
        ("steepest", f"{q.max_slope_deg:.1f}°"),
        ("largest ball, mm", "any" if radius is None else _plain_number(radius)),
        ("nodes reached", share),
    ]


def _plain_number(value: float) -> str:
    """Return a number with three digits, thousands apart, without an exponent."""
    if value < 100.0:
        return f"{value:.3g}"
    return f"{float(f'{value:.3g}'):,.0f}".replace(",", "\N{THIN SPACE}")


def _maps(nominal: Nominal) -> _Maps:
    """Evaluate everything on a raster of its own: a picture needs no more nodes than pixels."""
    surface = nominal.surface
    b = surface.bounds
    pitch = max(b.x_max - b.x_min, b.y_max - b.y_min) / ACROSS
    x = np.linspace(b.x_min, b.x_max, max(2, round((b.x_max - b.x_min) / pitch) + 1))
    y = np.linspace(b.y_min, b.y_max, max(2, round((b.y_max - b.y_min) / pitch) + 1))
    px, py = (a.ravel() for a in np.meshgrid(x, y))
    fields = np.full((4, len(px)), np.nan)
    known = np.flatnonzero(surface.contains(px, py))
    with np.errstate(invalid="ignore"):
        jet = surface.jet(px[known], py[known])
        k = principal_curvatures(jet, nominal.side)
        fields[:, known] = (
            np.arctan(slope(jet)) * DEG_PER_RAD,
            gaussian_curvature_per_mm2(jet),
            k.least,
            k.most,
        )
    reach = np.full(len(px), np.nan)
    if nominal.equidistant is not None:
        reach[known] = _reach_at(nominal, nominal.equidistant, px[known], py[known])
    degrees, gauss, least, most = fields.reshape(4, len(y), len(x))
    return _Maps(x, y, degrees, gauss, least, most, reach.reshape(len(y), len(x)))


def _reach_at(nominal: Nominal, net: Equidistant, x: Array, y: Array) -> Array:
    """Return the code of the nearest node, shape (n,)."""
    places = nominal.surface_from_part.apply(net.nominal_points_mm)[:, :2]
    from scipy.spatial import cKDTree  # slow to import

    nearest = cKDTree(places).query(np.stack([x, y], axis=1))[1]
    return _codes(net)[nearest].astype(np.float64)


def _panels(maps: _Maps) -> tuple[list[_Panel], float]:
    """Return the five coloured maps, and by what a curvature in 1/mm is multiplied for them."""
    largest = float(np.nanmax(np.abs([maps.least, maps.most])))
    in_metres = largest < _SMALL_CURVATURE
    scale, unit = (mm_per("m"), "m") if in_metres else (1.0, "mm")
    return [
        _panel("slope", "°", maps.slope_deg, signed=False),
        _panel("Gaussian curvature", f"1/{unit}²", maps.gauss * scale**2),
        _panel("larger principal curvature", f"1/{unit}", maps.most * scale),
        _panel("smaller principal curvature", f"1/{unit}", maps.least * scale),
        _panel("their difference", f"1/{unit}", (maps.most - maps.least) * scale, signed=False),
    ], scale


def _panel(title: str, unit: str, values: Array, *, signed: bool = True) -> _Panel:
    """Return a map with its limits: even about zero if it has both signs, else what it spans."""
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    limit = max(abs(low), abs(high))
    power = 0
    if 0.0 < limit < 0.02:
        power = int(np.floor(np.log10(limit)))
        unit = f"10{str(power).translate(_SUPERSCRIPT)}{unit.removeprefix('1')}"
        values = values / 10.0**power
        low, high, limit = (v / 10.0**power for v in (low, high, limit))
    if not signed:
        low = 0.0
    elif low < 0.0 < high:
        low, high = -_round_up(limit), _round_up(limit)
    if high - low <= 1e-6 * limit or limit == 0.0:  # the same everywhere
        low, high = (low - 0.5 * limit, high) if low < 0.0 else (0.0, _round_up(high))
    return _Panel(title, unit, values, signed, low, high)


def _round_up(value: float) -> float:
    """Return a value rounded up to two digits; 1 for zero."""
    if not value > 0.0:
        return 1.0
    unit = 10.0 ** (np.floor(np.log10(value)) - 1.0)
    return float(np.ceil(value / unit * (1.0 - 1e-9)) * unit)


def _draw(axes: Axes, maps: _Maps, panel: _Panel) -> AxesImage:
    """Draw one field: blue below zero, red-brown above; of one sign only, over what it spans."""
    colours = deviation_colours()
    if panel.low < 0.0 < panel.high:
        table = colours
    elif panel.low < 0.0:
        table = colours[:128]
    else:
        table = colours[127:] if panel.signed else colours[127::-1]
    return _image(axes, maps, panel.values, ListedColormap(table), panel.low, panel.high)


def _image(
    axes: Axes, maps: _Maps, values: Array, colours: ListedColormap, low: float, high: float
) -> AxesImage:
    """Draw values as an image in mm, unknown ones clear."""
    half_x, half_y = 0.5 * (maps.x_mm[1] - maps.x_mm[0]), 0.5 * (maps.y_mm[1] - maps.y_mm[0])
    image = axes.imshow(
        np.ma.masked_invalid(values),
        extent=(
            float(maps.x_mm[0] - half_x),
            float(maps.x_mm[-1] + half_x),
            float(maps.y_mm[0] - half_y),
            float(maps.y_mm[-1] + half_y),
        ),
        origin="lower",
        cmap=colours.with_extremes(bad=(0.0, 0.0, 0.0, 0.0)),
        vmin=low,
        vmax=high,
        interpolation="nearest",
        zorder=2,
    )
    axes.set_aspect("equal")
    return image


def _bar(figure: Figure, image: AxesImage, box: tuple[float, float, float, float], panel: _Panel) -> None:
    """Draw the colour bar at the right of a map, with its unit above."""
    left, bottom, wide, tall = box
    axes = figure.add_axes((left + wide + 0.008, bottom + 0.04 * tall, 0.010, 0.84 * tall))
    bar = figure.colorbar(image, cax=axes)
    low, high = panel.low, panel.high
    slack = 1e-9 * (high - low)
    even = MaxNLocator(5, steps=[1, 2, 2.5, 5, 10]).tick_values(low, high)
    ticks = [float(t) for t in even if low - slack <= t <= high + slack]
    bar.set_ticks(ticks, labels=[_signed(t) for t in ticks])
    bar.outline.set_edgecolor(RULE)
    axes.tick_params(length=0, pad=3, labelsize=8)
    axes.set_title(panel.unit, fontsize=8, color=SOFT, loc="left", pad=6)


def _outline_features(axes: Axes, maps: _Maps, threshold_per_mm: float, scale: float) -> None:
    """Outline the feature regions and say what the line means."""
    apart = maps.most - maps.least
    inside = np.isfinite(apart)
    share = float(np.mean(apart[inside] > threshold_per_mm))
    unit = "1/m" if scale != 1.0 else "1/mm"
    limit = f"> {threshold_per_mm * scale:.3g} {unit}"
    if 0.0 < share < 1.0:
        axes.contour(
            maps.x_mm,
            maps.y_mm,
            np.where(inside, apart, 0.0),
            levels=[threshold_per_mm],
            colors=[FEATURE_INK],
            linewidths=1.1,
            zorder=5,
        )
    _note(axes, f"features, {limit}: {100.0 * share:.2g} %" if share else f"no features ({limit})")


def _note(axes: Axes, text: str) -> None:
    """Write a line above a map, at the right of its title."""
    axes.annotate(
        text, (1.0, 1.0), (0, 8), "axes fraction", textcoords="offset points", ha="right", fontsize=7.8,
        color=SOFT,
    )  # fmt: skip


def _signed(value: float) -> str:
    """Return a tick with three digits and a true minus."""
    return f"{value:.3g}".replace("-", "\N{MINUS SIGN}")


def _draw_reach(axes: Axes, maps: _Maps, nominal: Nominal) -> AxesImage:
    """Draw what the ball reaches, with a legend of the shares of the nodes."""
    image = _image(axes, maps, maps.reach, ListedColormap(REACH_COLOURS), -0.5, 3.5)
    net = nominal.equidistant
    if net is None:
        return image
    count = np.bincount(_codes(net), minlength=4)
    there = np.flatnonzero(count)
    axes.legend(
        [Patch(facecolor=REACH_COLOURS[k], edgecolor=RULE) for k in there],
        [f"{REACH_WORDS[k]}, {100.0 * count[k] / count.sum():.3g} %" for k in there],
        loc="upper left",
        bbox_to_anchor=(-0.02, 0.0, 1.0, -0.47 / (axes.bbox.height / axes.figure.dpi)),
        ncols=2,
        frameon=False,
        fontsize=7.8,
        labelcolor=SOFT,
        borderpad=0.0,
        borderaxespad=0.0,
        columnspacing=1.4,
        handlelength=1.2,
    )
    return image


def _codes(net: Equidistant) -> NDArray[np.int64]:
    """Return the reach of the nodes, as far as the file tells it, shape (n,)."""
    codes = np.where(net.regular, 0, 3) if net.reach is None else net.reach
    return codes.astype(np.int64)
