"""The sheet every picture is drawn on, and the parts that maps have in common.

Only matplotlib's object interface is used (no pyplot, no global state, no display).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.patches import Rectangle
from matplotlib.path import Path as MplPath
from matplotlib.ticker import MaxNLocator

from cmm_align.model import Nominal
from cmm_align.surfaces.protocol import Array
from cmm_align.units import UM_PER_MM

DPI: Final = 150
WIDTH_IN: Final = 9.4
PNG_EFFORT: Final = 4
"""Of the compression, 0 to 9: half the time of 6 for a tenth more bytes."""
OUTLINE_PIXELS: Final = 900
"""Samples along the longer side of an aperture for its outline."""

_HEAD_LEFT: Final = 0.055
_NUMBERS_RIGHT: Final = 0.965
_NUMBER_WIDTH: Final = 0.128
_TITLE_SIZE: Final = 15.0
_TICK_IN: Final = 0.45
"""Room for a number under an axis."""
_SMALLEST_TITLE: Final = 9.5
_TITLE_LETTERS: Final = 33.0
"""So many letters of a title fill half the width of the sheet."""

INK: Final = "#1d2733"
SOFT: Final = "#66727f"
RULE: Final = "#c3cad1"
UNKNOWN: Final = "#e6e9ec"
SIGN: Final = "+ = excess material, along the outward normal"

STYLE: Final[Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "text.color": INK,
    "axes.edgecolor": RULE,
    "axes.labelcolor": SOFT,
    "axes.linewidth": 0.8,
    "xtick.color": RULE,
    "ytick.color": RULE,
    "xtick.labelcolor": SOFT,
    "ytick.labelcolor": SOFT,
    "xtick.major.size": 3.0,
    "ytick.major.size": 3.0,
    "hatch.color": "#8b96a1",
    "hatch.linewidth": 0.6,
    "axes.unicode_minus": True,
    "svg.fonttype": "path",
    "svg.hashsalt": "cmm-align",
}
"""Settings of all pictures; used as a context, never set globally. Text in an SVG is drawn as outlines, so
that it looks the same where the font is missing, and ids in it are the same each time."""


def sheet(height_in: float) -> Figure:
    """Return an empty white figure of the common width, drawn by Agg."""
    figure = Figure(figsize=(WIDTH_IN, height_in), dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def save(figure: Figure, path: Path | str) -> None:
    """Write the figure as SVG where the suffix says so, else as PNG; the same input gives the same bytes."""
    if Path(path).suffix.lower() == ".svg":
        figure.savefig(path, format="svg", metadata={"Date": None, "Creator": None})
        return
    pil = {"compress_level": PNG_EFFORT}
    figure.savefig(path, format="png", dpi=DPI, metadata={"Software": None}, pil_kwargs=pil)


def limit_um(*fields_mm: Array) -> float:
    """Return the symmetric colour limit, um, that holds all given fields.

    Returns
    -------
    float
        The largest absolute value, rounded up to two digits; 1 if there is none.
    """
    largest = max(
        (float(np.nanmax(np.abs(f), initial=0.0, where=np.isfinite(f))) for f in fields_mm), default=0.0
    )
    largest *= UM_PER_MM
    if largest <= 0.0:
        return 1.0
    unit = 10.0 ** (np.floor(np.log10(largest)) - 1.0)
    return float(np.ceil(largest / unit * (1.0 - 1e-9)) * unit)


def draw_aperture(
    axes: Axes, nominal: Nominal, image: AxesImage, *, hatched: bool = True, pixels: int = OUTLINE_PIXELS
) -> MplPath:
    """Draw the aperture on a grey ground (where nothing is known), cut the image to it, return it."""
    b = nominal.surface.bounds
    step = max(b.x_max - b.x_min, b.y_max - b.y_min) / pixels
    x = np.arange(b.x_min - 2.0 * step, b.x_max + 2.5 * step, step)
    y = np.arange(b.y_min - 2.0 * step, b.y_max + 2.5 * step, step)
    x_grid, y_grid = np.meshgrid(x, y)
    inside = nominal.surface.contains(x_grid.ravel(), y_grid.ravel()).reshape(x_grid.shape).astype(float)
    ground = axes.contourf(
        x, y, inside, levels=[0.5, 1.5], colors=[UNKNOWN], hatches=["////" if hatched else ""], zorder=1
    )
    axes.contour(x, y, inside, levels=[0.5], colors=[INK], linewidths=1.0, zorder=4)
    outline = ground.get_paths()[0]
    image.set_clip_path(outline, transform=axes.transData)
    return outline


def dress(axes: Axes, nominal: Nominal, *, y_label: bool = True) -> None:
    """Set limits, ticks and labels of a map."""
    b = nominal.surface.bounds
    margin = 0.025 * max(b.x_max - b.x_min, b.y_max - b.y_min)
    axes.set_xlim(b.x_min - margin, b.x_max + margin)
    axes.set_ylim(b.y_min - margin, b.y_max + margin)
    width_in = axes.get_position().width * WIDTH_IN
    most = int(np.clip(width_in / _TICK_IN, 2, 7))
    axes.xaxis.set_major_locator(MaxNLocator(most, steps=[1, 2, 5, 10]))
    axes.yaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
    axes.set_xlabel("x, mm")
    if y_label:
        axes.set_ylabel("y, mm")
    else:
        axes.tick_params(labelleft=False)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def draw_scale(
    figure: Figure,
    image: AxesImage,
    box: tuple[float, float, float, float],
    limit: float,
    ends: tuple[str, str] = ("", ""),
) -> None:
    """Draw the colour bar in um, with zero and both limits among its ticks.

    Parameters
    ----------
    figure : Figure
    image : AxesImage
    box : tuple of float
        Left, bottom, width and height on the sheet, 0 to 1.
    limit : float
        Largest absolute value, um.
    ends : (str, str)
        Words under the low end and over the high one.
    """
    axes = figure.add_axes(box)
    bar = figure.colorbar(image, cax=axes)
    even = MaxNLocator(8, steps=[1, 2, 2.5, 5, 10]).tick_values(-limit, limit)
    room = 0.7 * (even[1] - even[0])
    values = [-limit, *(t for t in even if abs(t) <= limit - room), limit]
    digits = next(d for d in range(7) if all(abs(round(t, d) - t) <= 1e-6 * limit for t in values))
    bar.set_ticks(values, labels=[signed(t, digits) for t in values])
    bar.outline.set_edgecolor(RULE)
    axes.tick_params(length=0, pad=4)
    low, high = ends
    axes.set_title(f"{high}\nµm" if high else "µm", fontsize=9, color=SOFT, loc="left", pad=8)
    if low:
        axes.annotate(
            low,
            (0.0, 0.0),
            xycoords="axes fraction",
            xytext=(0, -9),
            textcoords="offset points",
            fontsize=9,
            color=SOFT,
            ha="left",
            va="top",
        )


class Chip(NamedTuple):
    """A word on a coloured ground, as the verdict of a map."""

    text: str
    colour: str


def header(
    figure: Figure,
    title: str,
    lines: Sequence[str],
    numbers: Sequence[tuple[str, str]],
    height_in: float,
    chip: Chip | None = None,
) -> None:
    """Write the head of the sheet: title and lines at the left, big numbers at the right.

    Parameters
    ----------
    figure : Figure
    title : str
        Made smaller, and cut in the end, where it would run into the numbers.
    lines : sequence of str
        Up to three; the third has the colour of the chip.
    numbers : sequence of (label, value)
        Up to three.
    height_in : float
        Of the sheet.
    chip : Chip, optional
        Left of the numbers.
    """
    columns = len(numbers) + (chip is not None)
    letters = (_TITLE_LETTERS * (_NUMBERS_RIGHT - _NUMBER_WIDTH * columns - _HEAD_LEFT)) / 0.5
    size = max(_TITLE_SIZE * min(1.0, letters / max(len(title), 1)), _SMALLEST_TITLE)
    most = int(letters * _TITLE_SIZE / size)
    shown = title if len(title) <= most else title[: most - 1] + "\N{HORIZONTAL ELLIPSIS}"
    figure.text(_HEAD_LEFT, 1.0 - 0.36 / height_in, plain(shown), fontsize=size, weight="bold", va="center")
    for k, line in enumerate(lines):
        colour = chip.colour if chip is not None and k == 2 else SOFT
        figure.text(
            _HEAD_LEFT,
            1.0 - (0.66 + 0.19 * k) / height_in,
            plain(line),
            fontsize=9,
            color=colour,
            va="center",
        )
    for k, (label, value) in enumerate(reversed(numbers)):
        right = _NUMBERS_RIGHT - _NUMBER_WIDTH * k
        figure.text(right, 1.0 - 0.36 / height_in, value, fontsize=15, weight="bold", ha="right", va="center")
        figure.text(right, 1.0 - 0.66 / height_in, label, fontsize=9, color=SOFT, ha="right", va="center")
    if chip is not None:
        figure.text(
            _NUMBERS_RIGHT - _NUMBER_WIDTH * len(numbers) - 0.01,
            1.0 - 0.36 / height_in,
            chip.text,
            fontsize=11,
            weight="bold",
            color="white",
            ha="right",
            va="center",
            bbox={"boxstyle": "round,pad=0.35,rounding_size=0.25", "fc": chip.colour, "ec": "none"},
        )


def footer(figure: Figure, parts: Sequence[str], height_in: float) -> None:
    """Write one quiet line at the foot of the sheet: where the picture comes from."""
    text = "   \N{MIDDLE DOT}   ".join(plain(part) for part in parts if part)
    figure.text(_HEAD_LEFT, 0.16 / height_in, text, fontsize=7.5, color=SOFT, va="center")


def legend(figure: Figure, entries: Sequence[tuple[Artist, str]], right: float, height_in: float) -> None:
    """Write what the marks of a map mean, right-aligned under it, if there are any."""
    if entries:
        figure.legend(
            [mark for mark, _ in entries],
            [text for _, text in entries],
            loc="center right",
            bbox_to_anchor=(right, 0.44 / height_in),
            ncols=len(entries),
            frameon=False,
            fontsize=8.5,
            labelcolor=SOFT,
            borderpad=0.0,
            borderaxespad=0.0,
            handletextpad=0.6,
            columnspacing=1.6,
            markerscale=2.0,
        )


def hatched_patch(hatch: str = "////") -> Rectangle:
    """Return the sample of a hatched area for a legend."""
    return Rectangle((0, 0), 1, 1, facecolor=UNKNOWN, edgecolor="#8b96a1", hatch=hatch, linewidth=0.5)


def plain(text: str) -> str:
    """Return text that matplotlib shows as it is: no mathematics in dollars, nothing that is no Unicode."""
    return text.encode("utf-8", "replace").decode("utf-8").replace("$", r"\$")


def thin(number: int) -> str:
    """Return a whole number with thin spaces between its thousands."""
    return f"{number:,}".replace(",", "\N{THIN SPACE}")


def signed(value: float, digits: int) -> str:
    """Return a number with its sign (a true minus; none on zero)."""
    text = f"{abs(value):.{digits}f}"
    return text if float(text) == 0.0 else ("+" if value > 0.0 else "\N{MINUS SIGN}") + text


def three_digits(value: float) -> str:
    """Return a number with three digits that count, without an exponent."""
    if value == 0.0 or not np.isfinite(value):
        return f"{value:g}"
    return f"{value:.{max(0, 2 - int(np.floor(np.log10(abs(value)))))}f}"
