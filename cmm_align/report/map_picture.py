"""The picture of a deviation map: what an operator looks at first."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import matplotlib as mpl
from matplotlib import patheffects
from matplotlib.axes import Axes

from cmm_align.model import DeviationMap, Statistics
from cmm_align.report.canvas import (
    INK,
    SIGN,
    STYLE,
    WIDTH_IN,
    draw_aperture,
    draw_field,
    draw_scale,
    dress,
    header,
    limit_um,
    save,
    sheet,
    signed,
    three_digits,
)
from cmm_align.surfaces.protocol import Bounds
from cmm_align.units import UM_PER_MM

_LEFT: Final = 0.08
_MAP_WIDTH: Final = 0.80
_HEAD_IN: Final = 0.95
_FOOT_IN: Final = 0.55
_MAX_MAP_IN: Final = 7.2


def draw_map(deviation_map: DeviationMap, path: Path | str, title: str = "Deviation map") -> None:
    """Write a colour-coded picture of a deviation map as PNG, 1410 pixels wide.

    Parameters
    ----------
    deviation_map : DeviationMap
        Drawn in frame `surface`; colours centred on zero, blue - white - red.
    path : path
        Written as PNG whatever its suffix.
    title : str
        Headline; shown as it is.
    """
    m = deviation_map
    nominal, b = m.alignment.nominal, m.alignment.nominal.surface.bounds
    with mpl.rc_context(STYLE):
        width_in, map_in = map_size(b, _MAP_WIDTH * WIDTH_IN, _MAX_MAP_IN)
        height_in = map_in + _HEAD_IN + _FOOT_IN
        figure = sheet(height_in)
        left = _LEFT + 0.5 * (_MAP_WIDTH - width_in / WIDTH_IN)
        bottom, tall = _FOOT_IN / height_in, map_in / height_in
        axes = figure.add_axes((left, bottom, width_in / WIDTH_IN, tall))
        limit = limit_um(m.deviation_mm)
        image = draw_field(axes, m.x_mm, m.y_mm, m.deviation_mm, limit)
        draw_aperture(axes, nominal, image)
        dress(axes, nominal)
        mark_extremes(axes, m.statistics, b)
        draw_scale(
            figure,
            image,
            (left + width_in / WIDTH_IN + 0.015, bottom + 0.06 * tall, 0.017, 0.82 * tall),
            limit,
        )
        header(figure, plain(title), f"deviation from nominal; {SIGN}", head_numbers(m.statistics), height_in)
        save(figure, path)


def map_size(b: Bounds, widest_in: float, highest_in: float) -> tuple[float, float]:
    """Return width and height, inches, of the axes of a map with equal scales."""
    margin = 0.05 * max(b.x_max - b.x_min, b.y_max - b.y_min)
    width, height = b.x_max - b.x_min + margin, b.y_max - b.y_min + margin
    scale = min(widest_in / width, highest_in / height)
    return width * scale, height * scale


def head_numbers(statistics: Statistics) -> list[tuple[str, str]]:
    """Return the three numbers of the head of a map: label and value."""
    return [
        ("PV, µm", three_digits(statistics.pv_mm * UM_PER_MM)),
        ("RMS, µm", three_digits(statistics.rms_mm * UM_PER_MM)),
        ("nodes", f"{statistics.n:,}".replace(",", "\N{THIN SPACE}")),
    ]


def plain(text: str) -> str:
    """Return text that matplotlib shows as it is, dollar signs included."""
    return text.replace("$", r"\$")


def mark_extremes(axes: Axes, statistics: Statistics, b: Bounds, *, size: float = 9.0) -> None:
    """Mark the lowest and highest node; the labels keep clear of the border and of each other."""
    high_up = statistics.max_at_mm[1] >= statistics.min_at_mm[1]
    for (x, y), value, name, is_high in (
        (statistics.max_at_mm, statistics.max_mm, "max", True),
        (statistics.min_at_mm, statistics.min_mm, "min", False),
    ):
        up = high_up if is_high else not high_up  # away from the other one ...
        room = 0.12 * (b.y_max - b.y_min)
        if y > b.y_max - room:
            up = False  # ... unless the border is there
        elif y < b.y_min + room:
            up = True
        share = (x - b.x_min) / (b.x_max - b.x_min)
        side = "left" if share < 0.5 else "right"
        axes.plot(
            x,
            y,
            marker="^" if is_high else "v",
            color=INK,
            markersize=7,
            mec="white",
            mew=1.0,
            zorder=6,
            clip_on=False,
        )
        axes.annotate(
            f"{name} {signed(value * UM_PER_MM, 2 if abs(value) * UM_PER_MM < 10 else 1)} µm",
            (x, y),
            xytext=(9 if side == "left" else -9, 8 if up else -8),
            textcoords="offset points",
            ha=side,
            va="bottom" if up else "top",
            fontsize=size,
            weight="bold",
            zorder=7,
            path_effects=[patheffects.withStroke(linewidth=2.6, foreground="white")],
        )
