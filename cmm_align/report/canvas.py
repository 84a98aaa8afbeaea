"""The sheet every picture is drawn on, and the parts that maps have in common.

Only matplotlib's object interface is used (no pyplot, no global state, no display).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.path import Path as MplPath
from matplotlib.ticker import MaxNLocator

from cmm_align.model import Nominal
from cmm_align.report.deviation_colours import deviation_colours
from cmm_align.surfaces.protocol import Array, Mask
from cmm_align.units import UM_PER_MM

DPI: Final = 150
WIDTH_IN: Final = 9.4
PIXELS: Final = 1200
"""Samples along the longer side of a drawn field."""

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
}
"""Settings of all pictures; used as a context, never set globally."""


def sheet(height_in: float) -> Figure:
    """Return an empty white figure of the common width, drawn by Agg."""
    figure = Figure(figsize=(WIDTH_IN, height_in), dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def save(figure: Figure, path: Path | str) -> None:
    """Write the figure as PNG, whatever the suffix; the same input gives the same bytes."""
    figure.savefig(path, format="png", dpi=DPI, metadata={"Software": None})


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


def draw_field(
    axes: Axes, x_mm: Array, y_mm: Array, field_mm: Array, limit: float, *, rings: int = 0
) -> AxesImage:
    """Draw a field in um over its grid, unknown nodes left clear, equal axes in mm.

    Between the nodes a cubic is drawn that passes through every one of them. A known node fills its
    own cell; with `rings`, so many cells around it as well (for a field that ends at a border between
    two nodes).

    Parameters
    ----------
    axes : Axes
    x_mm, y_mm : ndarray, shape (nx,), (ny,), mm
    field_mm : ndarray, shape (ny, nx), mm
    limit : float
        Largest absolute value of the colour scale, um.
    rings : int
        Cells that a known node fills beyond its own.
    """
    colours = ListedColormap(deviation_colours(), name="deviation").with_extremes(bad=(0.0, 0.0, 0.0, 0.0))
    known = np.isfinite(field_mm)
    full, near = _spread(np.where(known, field_mm, 0.0), known, rings + 2)
    if rings:
        _, known = _spread(field_mm, known, rings)
    factor = max(1, round(PIXELS / max(field_mm.shape)))
    along_x, along_y = _cubic_matrix(len(x_mm), factor), _cubic_matrix(len(y_mm), factor)
    fine = along_y @ np.where(near, full, 0.0) @ along_x.T
    shown = np.repeat(np.repeat(known, factor, axis=0), factor, axis=1)
    half_x, half_y = 0.5 * (x_mm[1] - x_mm[0]), 0.5 * (y_mm[1] - y_mm[0])
    image = axes.imshow(
        np.ma.masked_where(~shown, fine * UM_PER_MM),
        extent=(
            float(x_mm[0] - half_x),
            float(x_mm[-1] + half_x),
            float(y_mm[0] - half_y),
            float(y_mm[-1] + half_y),
        ),
        origin="lower",
        cmap=colours,
        vmin=-limit,
        vmax=limit,
        interpolation="nearest",
        zorder=2,
    )
    axes.set_aspect("equal")
    return image


def _spread(field: Array, known: Mask, rings: int) -> tuple[Array, Mask]:
    """Return the field and its mask after growing by rings of means of known neighbours."""
    field, known = field.copy(), known.copy()
    ny, nx = field.shape
    for _ in range(rings):
        values = np.pad(np.where(known, field, 0.0), 1)
        flags = np.pad(known.astype(np.float64), 1)
        total, count = np.zeros_like(field), np.zeros_like(field)
        for dy in range(3):
            for dx in range(3):
                total += values[dy : dy + ny, dx : dx + nx]
                count += flags[dy : dy + ny, dx : dx + nx]
        fresh = ~known & (count > 0.0)
        field[fresh] = total[fresh] / count[fresh]
        known |= fresh
    return field, known


def _cubic_matrix(n: int, factor: int) -> Array:
    """Return the matrix, shape (n factor, n), from nodes to `factor` samples in each cell.

    Cubic convolution (R. G. Keys, 1981, a = -1/2); the border node is repeated outside.
    """
    place = (np.arange(n * factor) + 0.5) / factor - 0.5
    matrix = np.zeros((n * factor, n))
    first = np.floor(place).astype(np.intp)
    for k in range(-1, 3):
        d = np.abs(place - (first + k))
        near = 1.0 - 2.5 * d**2 + 1.5 * d**3
        far = 2.0 - 4.0 * d + 2.5 * d**2 - 0.5 * d**3
        np.add.at(
            matrix, (np.arange(n * factor), np.clip(first + k, 0, n - 1)), np.where(d <= 1.0, near, far)
        )
    return matrix


def draw_aperture(axes: Axes, nominal: Nominal, image: AxesImage, *, hatched: bool = True) -> MplPath:
    """Draw the aperture on a grey ground (where nothing is known), cut the image to it, return it."""
    b = nominal.surface.bounds
    step = max(b.x_max - b.x_min, b.y_max - b.y_min) / 900.0
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
    axes.xaxis.set_major_locator(MaxNLocator(7, steps=[1, 2, 5, 10]))
    axes.yaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
    axes.set_xlabel("x, mm")
    if y_label:
        axes.set_ylabel("y, mm")
    else:
        axes.tick_params(labelleft=False)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def draw_scale(
    figure: Figure, image: AxesImage, box: tuple[float, float, float, float], limit: float
) -> None:
    """Draw the colour bar in um, with zero and both limits among its ticks."""
    axes = figure.add_axes(box)
    bar = figure.colorbar(image, cax=axes)
    ticks = [
        t
        for t in MaxNLocator(8, steps=[1, 2, 2.5, 5, 10]).tick_values(-limit, limit)
        if abs(t) < 0.85 * limit
    ]
    values = [-limit, *ticks, limit]
    digits = next(d for d in range(7) if all(abs(round(t, d) - t) <= 1e-6 * limit for t in values))
    bar.set_ticks(values, labels=[signed(t, digits) for t in values])
    bar.outline.set_edgecolor(RULE)
    axes.tick_params(length=0, pad=4)
    axes.set_title("µm", fontsize=9, color=SOFT, loc="left", pad=8)


def header(
    figure: Figure, title: str, subtitle: str, numbers: list[tuple[str, str]], height_in: float
) -> None:
    """Write the title at the left and up to four big numbers at the right of the head of the sheet."""
    figure.text(0.055, 1.0 - 0.36 / height_in, title, fontsize=15, weight="bold", va="center")
    figure.text(0.055, 1.0 - 0.66 / height_in, subtitle, fontsize=9, color=SOFT, va="center")
    for k, (label, value) in enumerate(reversed(numbers)):
        right = 0.965 - 0.128 * k
        figure.text(right, 1.0 - 0.35 / height_in, value, fontsize=15, weight="bold", ha="right", va="center")
        figure.text(right, 1.0 - 0.66 / height_in, label, fontsize=9, color=SOFT, ha="right", va="center")


def signed(value: float, digits: int) -> str:
    """Return a number with its sign (a true minus; none on zero)."""
    text = f"{abs(value):.{digits}f}"
    return text if float(text) == 0.0 else ("+" if value > 0.0 else "\N{MINUS SIGN}") + text


def three_digits(value: float) -> str:
    """Return a number with three digits that count, without an exponent."""
    if value == 0.0 or not np.isfinite(value):
        return f"{value:g}"
    return f"{value:.{max(0, 2 - int(np.floor(np.log10(abs(value)))))}f}"
