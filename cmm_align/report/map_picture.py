"""The picture of a deviation map: what an operator looks at first."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import matplotlib as mpl
from matplotlib import patheffects
from matplotlib.artist import Artist
from matplotlib.axes import Axes

from cmm_align import __version__
from cmm_align.model import DeviationMap, Nominal, Statistics, Verdict
from cmm_align.report.canvas import (
    INK,
    SIGN,
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
    signed,
    thin,
    three_digits,
)
from cmm_align.report.field import draw_field, draw_points, unknown_inside
from cmm_align.report.region_outline import draw_regions
from cmm_align.report.summary import verdict_in_one_line
from cmm_align.report.wording import in_print
from cmm_align.surfaces.protocol import Bounds
from cmm_align.units import UM_PER_MM

_LEFT: Final = 0.08
_MAP_WIDTH: Final = 0.80
_LEGEND_RIGHT: Final = 0.7
"""Under a narrow map the legend would run into the name of its axis."""
_HEAD_IN: Final = 1.1
_VERDICT_IN: Final = 0.2
_VERDICT_LETTERS: Final = 112
"""Letters that a line of the head holds."""
_FOOT_IN: Final = 0.84
_MAX_MAP_IN: Final = 7.2

_CHIPS: Final = {
    Verdict.PASS: Chip("PASS", "#1d7a3e"),
    Verdict.FAIL: Chip("FAIL", "#b3261e"),
    Verdict.UNDECIDED: Chip("UNDECIDED", "#8a5a00"),
}


def draw_map(
    deviation_map: DeviationMap,
    path: Path | str,
    title: str = "Deviation map",
    source: str = "",
    *,
    scale_um: float = 0.0,
) -> None:
    """Write a colour-coded picture of a deviation map, 1410 pixels wide.

    Parameters
    ----------
    deviation_map : DeviationMap
        Drawn in frame `surface`; colours centred on zero, blue - white - red.
    path : path
        Written as SVG where its suffix says so, else as PNG.
    title : str
        Headline; shown as it is.
    source : str
        Name of the file behind the map, for the foot of the sheet.
    scale_um : float
        The colours reach from minus to plus this; 0 for the largest deviation of the map. What lies beyond
        has the colour of the end.
    """
    m = deviation_map
    nominal, b = m.alignment.nominal, m.alignment.nominal.surface.bounds
    with mpl.rc_context(STYLE):
        width_in, map_in = map_size(b, _MAP_WIDTH * WIDTH_IN, _MAX_MAP_IN)
        chip = _CHIPS.get(m.verdict)
        height_in = map_in + _HEAD_IN + _FOOT_IN + (0.0 if chip is None else _VERDICT_IN)
        figure = sheet(height_in)
        left = _LEFT + 0.5 * (_MAP_WIDTH - width_in / WIDTH_IN)
        bottom, tall = _FOOT_IN / height_in, map_in / height_in
        axes = figure.add_axes((left, bottom, width_in / WIDTH_IN, tall))
        limit = scale_um or limit_um(m.deviation_mm)
        image = draw_field(axes, nominal, m.x_mm, m.y_mm, m.deviation_mm, limit)
        draw_aperture(axes, nominal, image)
        dots = draw_points(axes, m.alignment)
        dress(axes, nominal)
        mark_extremes(axes, m.statistics, b)
        right = left + width_in / WIDTH_IN
        draw_scale(figure, image, (right + 0.015, bottom + 0.06 * tall, 0.017, 0.82 * tall), limit)
        marks: list[tuple[Artist, str]] = [] if dots is None else [(dots, "measured point")]
        marks += draw_regions(axes, m.alignment)
        if unknown_inside(nominal, m.x_mm, m.y_mm, m.deviation_mm):
            told = deviation_map.alignment.report.report_region
            marks.append((hatched_patch(), "not measured, or not judged" if told else "not measured"))
        if len(marks) > 2:  # a long legend needs the room under the middle
            axes.set_xlabel("x, mm", loc="left")
        legend(figure, marks, max(right, _LEGEND_RIGHT), height_in)
        single = m.point_statistics
        lines = [
            f"deviation from nominal; {SIGN}",
            f"single points: PV {three_digits(single.pv_mm * UM_PER_MM)} µm, "
            f"RMS {three_digits(single.rms_mm * UM_PER_MM)} µm, N {thin(single.n)}",
        ]
        if chip is not None and m.verdict_lines:
            lines.append(in_print(verdict_in_one_line(m, _VERDICT_LETTERS)))
        header(figure, title, lines, head_numbers(m.statistics), height_in, chip)
        footer(figure, [source, *origin(nominal), f"grid {m.spacing_mm:.4g} mm", version()], height_in)
        save(figure, path)


def origin(nominal: Nominal) -> list[str]:
    """Return what the foot of a picture says of the nominal and the ball."""
    side = "+z" if nominal.side > 0 else "\N{MINUS SIGN}z"
    return [f"nominal: {nominal.kind}", f"tip radius {nominal.tip_radius_mm:g} mm, {side} side"]


def version() -> str:
    """Return the name and version of the program, for the foot of a picture."""
    return f"cmm-align {__version__}"


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
        ("nodes", thin(statistics.n)),
    ]


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
