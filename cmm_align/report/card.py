"""The operator card: one A5 page as PDF with the verdict, three numbers, the map and one instruction.

Letters are as large as the page allows: what counts is at least 5 mm high and can be read from a metre away
(about 1/200 of the distance). Numbers are the same in every language. No browser is needed to print it.
"""

from __future__ import annotations

import textwrap
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
from matplotlib.backends.backend_pdf import FigureCanvasPdf
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

from cmm_align import __version__
from cmm_align.model import DeviationMap, Verdict
from cmm_align.report.canvas import (
    RULE,
    SOFT,
    STYLE,
    draw_aperture,
    draw_scale,
    limit_um,
    plain,
    thin,
    three_digits,
)
from cmm_align.report.field import draw_field
from cmm_align.report.instruction import Instruction
from cmm_align.report.map_picture import map_size, mark_extremes
from cmm_align.report.page_section import shown
from cmm_align.report.page_sections import headline_um
from cmm_align.report.summary import verdict_in_one_line
from cmm_align.units import MM_PER

MM_PER_INCH: Final = MM_PER["inch"]
WIDTH_MM: Final = 148.0
HEIGHT_MM: Final = 210.0
MARGIN_MM: Final = 9.0

_COLOURS: Final = {
    Verdict.PASS: "#1d7a3e",
    Verdict.FAIL: "#b3261e",
    Verdict.UNDECIDED: "#8a5a00",
    Verdict.NONE: "#55616d",
}
_MAP_HIGH_MM: Final = 68.0
_MAP_WIDE_MM: Final = 112.0
_TITLE_LETTERS: Final = 22
_ORDER_LETTERS: Final = 25
_COMMAND_LETTERS: Final = 58
_REASON_LETTERS: Final = 66
_NUMBER_LETTERS: Final = 5
_TOLD_LETTERS: Final = 44
_NARROW_MM: Final = 45.0
"""A map narrower than this has its labels beside it ..."""
_LABEL_MM: Final = 36.0
"""... and leaves so much room for them."""
_MOST_COMMAND_LINES: Final = 2


def draw_card(
    deviation_map: DeviationMap,
    path: Path | str,
    *,
    title: str,
    advice: Instruction,
    pass_number: int | None = None,
    date: str = "",
) -> None:
    """Write the operator card of a map as PDF, A5 upright; the same input gives the same bytes.

    Parameters
    ----------
    deviation_map : DeviationMap
    path : path
        Written as PDF whatever its suffix.
    title : str
        Name of the part; cut where it is too long.
    advice : Instruction
    pass_number : int, optional
        Which grind was measured; the card says so where it is not known.
    date : str
        When the map was made.
    """
    m = deviation_map
    style = {**STYLE, "pdf.fonttype": 42, "pdf.compression": 9}
    with mpl.rc_context(style):
        figure = Figure(figsize=(WIDTH_MM / MM_PER_INCH, HEIGHT_MM / MM_PER_INCH), facecolor="white")
        FigureCanvasPdf(figure)
        _head(figure, title, pass_number, date, _told_of(m))
        _verdict(figure, m)
        _numbers(figure, m)
        _map(figure, m)
        _order(figure, m.verdict, advice)
        _foot(figure, m)
        metadata = {"Title": title.encode("utf-8", "replace").decode("utf-8"), "CreationDate": None}
        figure.savefig(path, format="pdf", metadata={**metadata, "Producer": None, "Creator": "cmm-align"})


def _write(figure: Figure, x_mm: float, y_mm: float, text: str, size: float, **look: Any) -> None:
    """Write text at a place in mm from the lower left corner."""
    figure.text(x_mm / WIDTH_MM, y_mm / HEIGHT_MM, plain(text), fontsize=size, **{"va": "center", **look})


def _cut(text: str, most: int) -> str:
    return text if len(text) <= most else text[: most - 1] + "\N{HORIZONTAL ELLIPSIS}"


def _told_of(m: DeviationMap) -> list[str]:
    """Return which waves and which part of the surface the numbers are of; nothing where of all."""
    waves = "" if m.filter is None else f"filtered: {m.filter.words}"
    region = m.alignment.report.report_region.removeprefix("the ")
    return [line for line in (waves, f"only the {region}" if region else "") if line]


def _head(figure: Figure, title: str, pass_number: int | None, date: str, told_of: list[str]) -> None:
    size = min(22.0, 22.0 * 15 / max(len(title), 1))
    _write(figure, MARGIN_MM, 197.0, _cut(title, _TITLE_LETTERS), max(size, 14.5), weight="bold")
    right = WIDTH_MM - MARGIN_MM
    known = pass_number is not None
    text = f"pass {pass_number}" if known else "pass not known"
    _write(
        figure, right, 197.0, text, 22.0 if known else 12.0, weight="bold" if known else "normal", ha="right"
    )
    _write(figure, MARGIN_MM, 188.0, f"{date}   cmm-align {__version__}".strip(), 9.0, color=SOFT)
    for k, line in enumerate(told_of):
        y = 188.0 + 4.0 * (len(told_of) - 1 - k) - 1.5 * (len(told_of) - 1)
        _write(figure, right, y, _cut(line, _TOLD_LETTERS), 9.0, weight="bold", ha="right")


def _box(figure: Figure, low_mm: float, high_mm: float, colour: str) -> None:
    """Fill a bar over the whole width."""
    width, height = WIDTH_MM - 2.0 * MARGIN_MM, high_mm - low_mm
    figure.add_artist(
        FancyBboxPatch(
            (MARGIN_MM / WIDTH_MM, low_mm / HEIGHT_MM),
            width / WIDTH_MM,
            height / HEIGHT_MM,
            boxstyle="round,pad=0,rounding_size=0.01",
            mutation_aspect=WIDTH_MM / HEIGHT_MM,
            facecolor=colour,
            edgecolor="none",
        )
    )


def _verdict(figure: Figure, m: DeviationMap) -> None:
    """Write the verdict, and under it what was judged."""
    _box(figure, 156.0, 183.0, _COLOURS[m.verdict])
    look: dict[str, Any] = {"color": "white", "ha": "center"}
    middle = WIDTH_MM / 2.0
    if m.verdict == Verdict.NONE:
        _write(figure, middle, 169.5, "no tolerance given", 28.0, weight="bold", **look)
        return
    _write(figure, middle, 172.0, m.verdict.value.upper(), 46.0, weight="bold", **look)
    _write(figure, middle, 160.3, shown(verdict_in_one_line(m, _REASON_LETTERS)), 10.0, **look)


def _numbers(figure: Figure, m: DeviationMap) -> None:
    third = (WIDTH_MM - 2.0 * MARGIN_MM) / 3.0
    shown_um = [(label, three_decimals(value_um)) for label, value_um, _ in headline_um(m)]
    longest = max(len(value) for _, value in shown_um)
    size = min(34.0, 34.0 * _NUMBER_LETTERS / longest)
    for k, (label, value) in enumerate(shown_um):
        x = MARGIN_MM + third * (k + 0.5)
        _write(figure, x, 144.5, value, size, weight="bold", ha="center")
        _write(figure, x, 134.5, f"{label}, µm", 13.0, color=SOFT, ha="center")


def three_decimals(value_um: float) -> str:
    """Return a number with three digits that count, but not beyond the nm."""
    return three_digits(value_um) if value_um >= 0.1 else f"{value_um:.3f}"


def _map(figure: Figure, m: DeviationMap) -> None:
    nominal, b = m.alignment.nominal, m.alignment.nominal.surface.bounds
    width_in, height_in = map_size(b, _MAP_WIDE_MM / MM_PER_INCH, _MAP_HIGH_MM / MM_PER_INCH)
    wide, high = width_in * MM_PER_INCH, height_in * MM_PER_INCH
    left, bottom = 0.5 * (WIDTH_MM - wide - 14.0), 92.5 - 0.5 * high
    box = (left / WIDTH_MM, bottom / HEIGHT_MM, wide / WIDTH_MM, high / HEIGHT_MM)
    axes = figure.add_axes(box)
    limit = limit_um(m.deviation_mm)
    image = draw_field(axes, nominal, m.x_mm, m.y_mm, m.deviation_mm, limit)
    draw_aperture(axes, nominal, image)
    margin = 0.025 * max(b.x_max - b.x_min, b.y_max - b.y_min)
    axes.set_xlim(b.x_min - margin, b.x_max + margin)
    axes.set_ylim(b.y_min - margin, b.y_max + margin)
    axes.set_axis_off()
    mark_extremes(axes, m.statistics, b, size=11.0)
    gap = 3.0 if wide > _NARROW_MM else _LABEL_MM
    scale = ((left + wide + gap) / WIDTH_MM, (bottom + 0.1 * high) / HEIGHT_MM, 4.0 / WIDTH_MM)
    draw_scale(figure, image, (*scale, 0.74 * high / HEIGHT_MM), limit)


def _order(figure: Figure, verdict: Verdict, advice: Instruction) -> None:
    """Write the one instruction, as large as fits, with its reason and what to type."""
    figure.add_artist(_rule(figure, 52.0))
    lines = textwrap.wrap(advice.order, _ORDER_LETTERS) or [""]
    size = 26.0 if len(lines) == 1 else 20.0
    for k, line in enumerate(lines[:2]):
        y = 43.0 - 9.0 * k + (0.0 if len(lines) == 1 else 2.5)
        _write(figure, MARGIN_MM, y, line, size, weight="bold", color=_COLOURS[verdict])
    y = 33.0 if len(lines) == 1 else 28.5
    for line in textwrap.wrap(advice.why, _COMMAND_LETTERS):
        _write(figure, MARGIN_MM, y, line, 11.0)
        y -= 5.5
    if advice.command:
        typed = textwrap.wrap(f"run: {advice.command}", _COMMAND_LETTERS, break_on_hyphens=False)
        for line in typed[:_MOST_COMMAND_LINES]:
            _write(figure, MARGIN_MM, y - 0.5, line, 10.0, family="DejaVu Sans Mono")
            y -= 5.0


def _rule(figure: Figure, y_mm: float) -> mpl.lines.Line2D:
    """Return a hair line over the whole width."""
    y = y_mm / HEIGHT_MM
    ends = [MARGIN_MM / WIDTH_MM, 1.0 - MARGIN_MM / WIDTH_MM]
    return mpl.lines.Line2D(ends, [y, y], color=RULE, linewidth=0.8, transform=figure.transFigure)


def _foot(figure: Figure, m: DeviationMap) -> None:
    n = m.alignment.nominal
    side = "+z" if n.side > 0 else "\N{MINUS SIGN}z"
    text = f"+ = excess material   N {thin(m.statistics.n)}   tip radius {n.tip_radius_mm:g} mm, {side} side"
    _write(figure, MARGIN_MM, 9.0, text, 8.5, color=SOFT)
    _write(figure, WIDTH_MM - MARGIN_MM, 9.0, f"nominal {n.digest[:8]}", 8.5, color=SOFT, ha="right")
