"""Sections of a map along chosen lines, each with its uncertainty, and a key to where they lie."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from string import ascii_uppercase
from typing import Final

import matplotlib as mpl
import numpy as np
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from cmm_align.model import DeviationMap
from cmm_align.report.canvas import (
    INK,
    SIGN,
    SOFT,
    STYLE,
    draw_aperture,
    limit_um,
    save,
    three_digits,
)
from cmm_align.report.chart import (
    ABOVE,
    BELOW,
    FOOT_IN,
    PALE,
    chart,
    chart_sheet,
    draw_limits,
    rule,
    with_limits,
)
from cmm_align.report.field import draw_field
from cmm_align.report.map_picture import map_size
from cmm_align.report.section_lines import (
    Profile,
    SectionLine,
    middle_lines,
    profile_along,
    section_line,
)
from cmm_align.report.wishes import Limits
from cmm_align.report.wording import minus
from cmm_align.units import UM_PER_MM

COVERAGE_FACTOR: Final = 2.0
"""Half width of the band in standard uncertainties."""
KEY_PIXELS: Final = 300
"""Along the longer side of the small map."""
_PANEL_IN: Final = 1.75
_GAP_IN: Final = 0.78
_LEFT_IN: Final = 0.82
_WIDE_IN: Final = 6.1
_KEY_LEFT_IN: Final = 7.25
_KEY_IN: Final = 1.8
_KEY_HIGH_IN: Final = 2.6


def draw_sections(
    deviation_map: DeviationMap,
    path: Path | str,
    title: str = "Sections",
    source: str = "",
    *,
    scale_um: float = 0.0,
    limits: Limits | None = None,
    sections: Sequence[str] = (),
) -> None:
    """Write the deviations along lines over the part, one panel a line, all with one scale.

    Parameters
    ----------
    deviation_map : DeviationMap
        Gaps of the map stay gaps of the curve.
    path : path
        Written as SVG where its suffix says so, else as PNG.
    title, source : str
        Headline, and the name of the file behind the map.
    scale_um : float
        Half the range shown; 0 for that of the map.
    limits : Limits, optional
        Least and largest deviation allowed; drawn as dashed lines.
    sections : sequence of str
        As ``x=0``, ``y=5mm``, ``-20,0:20,10``; the two lines through the middle of the aperture unless
        given.

    Raises
    ------
    UsageError
        If one of the sections is no line, or misses the part.
    """
    m = deviation_map
    bounds = m.alignment.nominal.surface.bounds
    lines = [section_line(text, bounds) for text in sections] or list(middle_lines(bounds))
    limit = scale_um or limit_um(m.deviation_mm)
    reach = limit if scale_um or limits is None else with_limits(limit, limits)
    with mpl.rc_context(STYLE):
        _, key_in = map_size(bounds, _KEY_IN, _KEY_HIGH_IN)
        body_in = max(len(lines) * (_PANEL_IN + _GAP_IN) - _GAP_IN + 0.3, key_in + 0.75)
        words = [
            f"deviation along straight sections; {SIGN}",
            "grey: ±2 standard uncertainties of the map" + (f"; dashed: {limits.words}" if limits else ""),
        ]
        figure, height_in = chart_sheet(m, body_in, title, source, words)
        top_in = FOOT_IN + body_in - 0.3
        for k, line in enumerate(lines):
            bottom_in = top_in - _PANEL_IN - k * (_PANEL_IN + _GAP_IN)
            axes = chart(figure, _LEFT_IN, bottom_in, _WIDE_IN, _PANEL_IN)
            profile = profile_along(m, line)
            _panel(axes, profile, reach, limits)
            axes.set_xlabel(_along(line))
            y = (bottom_in + _PANEL_IN + 0.13) / height_in
            left = _LEFT_IN / figure.get_figwidth()
            figure.text(left, y, f"{_letter(k)}    {line.name}", fontsize=10, weight="bold", va="center")
            right = (_LEFT_IN + _WIDE_IN) / figure.get_figwidth()
            figure.text(right, y, _numbers(profile), fontsize=9, color=SOFT, ha="right", va="center")
        _key(figure, m, lines, limit, top_in)
        save(figure, path)


def _panel(axes: Axes, profile: Profile, limit: float, limits: Limits | None) -> None:
    """Draw one section: the curve, its band, excess and missing material in the colours of the map."""
    s, e, u = profile.arc_mm, profile.deviation_mm * UM_PER_MM, profile.sigma_mm * UM_PER_MM
    for side, colour in ((e > 0.0, ABOVE), (e < 0.0, BELOW)):
        axes.fill_between(s, 0.0, e, where=side, interpolate=True, color=colour, alpha=0.22, lw=0.0, zorder=2)
    band = COVERAGE_FACTOR * np.nan_to_num(u)
    axes.fill_between(s, e - band, e + band, color=PALE, alpha=0.75, lw=0.0, zorder=3)
    axes.plot(s, e, color=INK, lw=1.3, zorder=4)
    rule(axes)
    draw_limits(axes, limits, upright=False)
    axes.set(xlim=(s[0], s[-1]), ylim=(-1.05 * limit, 1.05 * limit), ylabel="deviation, µm")
    axes.xaxis.set_major_locator(MaxNLocator(9, steps=[1, 2, 5, 10]))
    axes.yaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10], symmetric=True))
    if not np.isfinite(e).any():
        axes.text(
            0.5,
            0.56,
            "nothing was measured on this line",
            transform=axes.transAxes,
            ha="center",
            color=SOFT,
            zorder=5,
        )


def _along(line: SectionLine) -> str:
    """Return the words under a section."""
    if not line.axis:
        return "arc length from the first end, mm"
    start = line.start_mm[0 if line.axis == "x" else 1]
    end = line.end_mm[0 if line.axis == "x" else 1]
    zero = 0.0 if start < 0.0 < end else start
    return f"arc length along {line.axis} from {line.axis} = {minus(zero)}, mm"


def _numbers(profile: Profile) -> str:
    """Return PV and RMS of a section."""
    e = profile.deviation_mm[np.isfinite(profile.deviation_mm)] * UM_PER_MM
    if len(e) == 0:
        return ""
    return f"PV {three_digits(float(np.ptp(e)))} µm    RMS {three_digits(float(np.sqrt(np.mean(e**2))))} µm"


def _key(figure: Figure, m: DeviationMap, lines: Sequence[SectionLine], limit: float, top_in: float) -> None:
    """Draw a small map with the lines in it, each with its letter at its start."""
    nominal, b = m.alignment.nominal, m.alignment.nominal.surface.bounds
    width_in, high_in = map_size(b, _KEY_IN, _KEY_HIGH_IN)
    axes = chart(figure, _KEY_LEFT_IN, top_in - high_in - 0.12, width_in, high_in, grid="")
    image = draw_field(axes, nominal, m.x_mm, m.y_mm, m.deviation_mm, limit, pixels=KEY_PIXELS)
    draw_aperture(axes, nominal, image, pixels=KEY_PIXELS)
    for k, line in enumerate(lines):
        (x1, y1), (x2, y2) = line.start_mm, line.end_mm
        axes.plot([x1, x2], [y1, y2], color="white", lw=3.0, zorder=5)
        axes.plot([x1, x2], [y1, y2], color=INK, lw=1.2, zorder=6)
        direction = np.array([x2 - x1, y2 - y1]) / np.hypot(x2 - x1, y2 - y1)
        for (x, y), sign, text in (((x1, y1), -1.0, _letter(k)), ((x2, y2), 1.0, f"{_letter(k)}\N{PRIME}")):
            axes.annotate(
                text,
                (x, y),
                xytext=tuple(sign * 8.0 * direction),
                textcoords="offset points",
                ha="center",
                va="center",
                fontsize=9,
                weight="bold",
                zorder=7,
                annotation_clip=False,
                path_effects=[patheffects.withStroke(linewidth=2.2, foreground="white")],
            )
    margin = 0.025 * max(b.x_max - b.x_min, b.y_max - b.y_min)
    axes.set(xlim=(b.x_min - margin, b.x_max + margin), ylim=(b.y_min - margin, b.y_max + margin))
    axes.axis("off")


def _letter(k: int) -> str:
    """Return the letter of a section: A to Z, then A1, B1 ..."""
    return ascii_uppercase[k % 26] + (str(k // 26) if k >= 26 else "")
