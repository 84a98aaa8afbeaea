"""Maps of one part before and after a pass, side by side on one common scale."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import matplotlib as mpl

from cmm_align.model import DeviationMap
from cmm_align.report.canvas import (
    SIGN,
    SOFT,
    STYLE,
    WIDTH_IN,
    draw_aperture,
    draw_scale,
    dress,
    footer,
    hatched_patch,
    header,
    legend,
    limit_um,
    plain,
    save,
    sheet,
    three_digits,
)
from cmm_align.report.field import draw_field, unknown_inside
from cmm_align.report.map_picture import map_size, mark_extremes, origin, version
from cmm_align.units import UM_PER_MM

_LEFT: Final = 0.062
_RIGHT: Final = 0.90
_GAP: Final = 0.025
_HEAD_IN: Final = 1.5
_FOOT_IN: Final = 0.84
_MAX_MAP_IN: Final = 5.0


def draw_series(
    maps: Sequence[tuple[str, DeviationMap]], path: Path | str, title: str = "Before and after"
) -> None:
    """Write maps of one part side by side, all with the colours of the largest deviation.

    Parameters
    ----------
    maps : sequence of (name, DeviationMap)
        In the order of the passes; two or three fit the sheet well.
    path : path
        Written as SVG where its suffix says so, else as PNG.
    title : str
        Headline; shown as it is.
    """
    first, last = maps[0][1], maps[-1][1]
    nominal = first.alignment.nominal
    b = nominal.surface.bounds
    room = (_RIGHT - _LEFT - _GAP * (len(maps) - 1)) / len(maps)
    with mpl.rc_context(STYLE):
        width_in, map_in = map_size(b, room * WIDTH_IN, _MAX_MAP_IN)
        height_in = map_in + _HEAD_IN + _FOOT_IN
        figure = sheet(height_in)
        bottom, tall, wide = _FOOT_IN / height_in, map_in / height_in, width_in / WIDTH_IN
        limit = limit_um(*(m.deviation_mm for _, m in maps))
        for k, (name, m) in enumerate(maps):
            left = _LEFT + k * (room + _GAP)
            axes = figure.add_axes((left, bottom, wide, tall))
            image = draw_field(axes, nominal, m.x_mm, m.y_mm, m.deviation_mm, limit)
            draw_aperture(axes, nominal, image)
            dress(axes, nominal, y_label=k == 0)
            mark_extremes(axes, m.statistics, b, size=8.0)
            above = bottom + tall
            figure.text(left, above + 0.34 / height_in, plain(name), fontsize=11, weight="bold")
            figure.text(left, above + 0.10 / height_in, _numbers(m), fontsize=10, color=SOFT)
        bar_left = _LEFT + (len(maps) - 1) * (room + _GAP) + wide + 0.015
        draw_scale(figure, image, (bar_left, bottom + 0.06 * tall, 0.014, 0.80 * tall), limit)
        factor = (
            first.statistics.pv_mm / last.statistics.pv_mm if last.statistics.pv_mm > 0.0 else float("inf")
        )
        header(
            figure,
            title,
            [f"one scale for all; {SIGN}"],
            [("PV of the map, first / last", f"{factor:.1f}\N{MULTIPLICATION SIGN}")],
            height_in,
        )
        if any(unknown_inside(nominal, m.x_mm, m.y_mm, m.deviation_mm) for _, m in maps):
            legend(figure, [(hatched_patch(), "not measured")], bar_left - 0.015, height_in)
        footer(figure, [*origin(nominal), version()], height_in)
        save(figure, path)


def _numbers(m: DeviationMap) -> str:
    """Return PV and RMS of a map in one line."""
    s = m.statistics
    return f"PV {three_digits(s.pv_mm * UM_PER_MM)} µm    RMS {three_digits(s.rms_mm * UM_PER_MM)} µm"
