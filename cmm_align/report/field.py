"""A field on a grid as an image: never beyond the values of its nodes, honest about their distance."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.image import AxesImage
from matplotlib.lines import Line2D

from cmm_align.model import Alignment, Nominal
from cmm_align.report.canvas import INK
from cmm_align.report.deviation_colours import deviation_colours
from cmm_align.surfaces.protocol import Array, Mask
from cmm_align.units import UM_PER_MM

MaskedArray = np.ma.MaskedArray[tuple[int, int], np.dtype[np.float64]]

PIXELS: Final = 1200
"""Samples along the longer side of a drawn field."""

COARSE_NODES: Final = 50
"""Along the longer side: with fewer nodes every one is drawn as its cell, the colours meet at the edges."""

NARROWEST_BLEND: Final = 0.6
"""Smallest width of the seam between two cells, as a share of their distance."""

MOST_DOTS: Final = 3000
"""More points than this are not drawn one by one."""

DENSEST_DOTS_PER_IN2: Final = 120.0
"""Nor are points so dense that they would darken the colours of a small map."""

_SQUARE: Final = tuple((dy, dx) for dy in range(3) for dx in range(3))
_CROSS: Final = ((0, 1), (1, 0), (1, 2), (2, 1))
"""Neighbours of a node at (1, 1)."""


def draw_field(
    axes: Axes,
    nominal: Nominal,
    x_mm: Array,
    y_mm: Array,
    field_mm: Array,
    limit: float,
    hues_deg: tuple[float, float] | None = None,
    *,
    pixels: int = PIXELS,
) -> AxesImage:
    """Draw a field in um over its grid, unknown nodes left clear, equal axes in mm.

    Every known node fills its cell. Nodes that lie outside the nominal take the mean of their known
    neighbours, so that the map reaches the border where its last node is within half a cell of it.
    Between the nodes of a fine grid a cubic is drawn, cut at the range of the nodes; on a coarse one the
    cells meet in a linear seam, so that nothing looks measured where nothing was.

    Parameters
    ----------
    axes : Axes
    nominal : Nominal
        Knows which nodes lie outside.
    x_mm, y_mm : ndarray, shape (nx,), (ny,), mm
    field_mm : ndarray, shape (ny, nx), mm
    limit : float
        Largest absolute value of the colour scale, um.
    hues_deg : (float, float), optional
        Hues of the negative and the positive half; those of a deviation unless given.
    pixels : int
        Samples along the longer side.
    """
    colours = deviation_colours() if hues_deg is None else deviation_colours(hues_deg=hues_deg)
    values, extent = resampled(nominal, x_mm, y_mm, field_mm, pixels)
    image = axes.imshow(
        values * UM_PER_MM,
        extent=extent,
        origin="lower",
        cmap=ListedColormap(colours, name="deviation").with_extremes(bad=(0.0, 0.0, 0.0, 0.0)),
        vmin=-limit,
        vmax=limit,
        interpolation="nearest",
        zorder=2,
    )
    axes.set_aspect("equal")
    return image


def resampled(
    nominal: Nominal, x_mm: Array, y_mm: Array, field_mm: Array, pixels: int
) -> tuple[MaskedArray, tuple[float, float, float, float]]:
    """Return a field at more places, as `draw_field` shows it, and the rectangle that it covers.

    Parameters
    ----------
    nominal : Nominal
    x_mm, y_mm : ndarray, shape (nx,), (ny,), mm
    field_mm : ndarray, shape (ny, nx), mm
        NaN where unknown.
    pixels : int
        Samples along the longer side, about.

    Returns
    -------
    values : masked array, shape (my, mx), mm
        In the middles of even cells; masked where unknown, and one node beyond the grid at most.
    extent : tuple of float
        Left, right, low and high border of the cells, mm.
    """
    x, y = _one_more(x_mm), _one_more(y_mm)
    field = np.pad(field_mm, 1, constant_values=np.nan)
    known = np.isfinite(field)
    field = np.where(known, field, 0.0)
    x_grid, y_grid = np.meshgrid(x, y)
    outside = ~nominal.surface.contains(x_grid.ravel(), y_grid.ravel()).reshape(x_grid.shape)
    field, known = _to_the_border(field, known, outside)
    field, _ = _spread(field, known, 2)
    long_side = max(field_mm.shape)
    factor = max(1, round(pixels / long_side))
    if long_side < COARSE_NODES:
        share = max(NARROWEST_BLEND, long_side / COARSE_NODES)
        along_x, along_y = _seam_matrix(len(x), factor, share), _seam_matrix(len(y), factor, share)
    else:
        along_x, along_y = _cubic_matrix(len(x), factor), _cubic_matrix(len(y), factor)
    low, high = float(np.nanmin(field_mm)), float(np.nanmax(field_mm))
    fine = np.clip(along_y @ field @ along_x.T, low, high)
    shown = np.repeat(np.repeat(known, factor, axis=0), factor, axis=1)
    half_x, half_y = 0.5 * (x[1] - x[0]), 0.5 * (y[1] - y[0])
    extent = (float(x[0] - half_x), float(x[-1] + half_x), float(y[0] - half_y), float(y[-1] + half_y))
    return np.ma.masked_where(~shown, fine), extent


def cell_middles(shape: tuple[int, int], extent: tuple[float, float, float, float]) -> tuple[Array, Array]:
    """Return the places of resampled values, x of shape (mx,) and y of shape (my,), mm.

    Parameters
    ----------
    shape : (int, int)
        Of the values, (my, mx).
    extent : tuple of float
        As `resampled` returns it.
    """
    left, right, low, high = extent
    ny, nx = shape
    x: Array = left + (np.arange(nx, dtype=np.float64) + 0.5) * ((right - left) / nx)
    y: Array = low + (np.arange(ny, dtype=np.float64) + 0.5) * ((high - low) / ny)
    return x, y


def draw_points(axes: Axes, alignment: Alignment) -> Line2D | None:
    """Draw the places of the measured points as tiny dots, unless there are too many to be told apart."""
    judged = alignment.judged & np.isfinite(alignment.deviation_mm)
    box = axes.get_position()
    figure = axes.get_figure(root=True)
    area_in2 = 1.0 if figure is None else box.width * box.height * float(np.prod(figure.get_size_inches()))
    if not 0 < np.count_nonzero(judged) < min(MOST_DOTS, DENSEST_DOTS_PER_IN2 * area_in2):
        return None
    e, normals = alignment.deviation_mm[judged, None], alignment.normals[judged]
    foot = alignment.contact_part_mm[judged] - e * normals
    x, y, _ = alignment.nominal.surface_from_part.apply(foot).T
    (dots,) = axes.plot(x, y, "o", ms=1.5, mew=0.0, color=INK, alpha=0.55, zorder=3, label="measured point")
    return dots


def unknown_inside(nominal: Nominal, x_mm: Array, y_mm: Array, field_mm: Array) -> int:
    """Return how many nodes inside the nominal have no value, those of a ring around the grid included.

    Parameters
    ----------
    nominal : Nominal
    x_mm, y_mm : ndarray, shape (nx,), (ny,), mm
    field_mm : ndarray, shape (ny, nx), mm
        NaN where unknown.
    """
    x_grid, y_grid = np.meshgrid(_one_more(x_mm), _one_more(y_mm))
    inside = nominal.surface.contains(x_grid.ravel(), y_grid.ravel()).reshape(x_grid.shape)
    return int(np.count_nonzero(inside & np.isnan(np.pad(field_mm, 1, constant_values=np.nan))))


def _one_more(nodes_mm: Array) -> Array:
    """Return nodes with one more at either end."""
    step = nodes_mm[1] - nodes_mm[0]
    return np.concatenate([nodes_mm[:1] - step, nodes_mm, nodes_mm[-1:] + step])


def _to_the_border(field: Array, known: Mask, outside: Mask) -> tuple[Array, Mask]:
    """Return field and mask, nodes outside the nominal with the value of the known ones beside them.

    A node next to one that is inside and unknown stays unknown: there the map ends before the border.
    """
    beside, near = _spread(field, known, 1, _CROSS)
    around, near_corner = _spread(field, known, 1)
    _, gap = _spread(field, ~known & ~outside, 1, _CROSS)
    fill = outside & near_corner & ~gap
    values = np.where(near, beside, around)
    return np.where(fill, values, field), known | fill


def _spread(
    field: Array, known: Mask, rings: int, places: Sequence[tuple[int, int]] = _SQUARE
) -> tuple[Array, Mask]:
    """Return the field and its mask after growing by rings of means of known neighbours."""
    field, known = field.copy(), known.copy()
    ny, nx = field.shape
    for _ in range(rings):
        values = np.pad(np.where(known, field, 0.0), 1)
        flags = np.pad(known.astype(np.float64), 1)
        total, count = np.zeros_like(field), np.zeros_like(field)
        for dy, dx in places:
            total += values[dy : dy + ny, dx : dx + nx]
            count += flags[dy : dy + ny, dx : dx + nx]
        fresh = ~known & (count > 0.0)
        field[fresh] = total[fresh] / count[fresh]
        known |= fresh
    return field, known


def _places(n: int, factor: int) -> Array:
    """Return the places of `factor` samples in each of `n` cells, in steps from the first node."""
    places: Array = (np.arange(n * factor) + 0.5) / factor - 0.5
    return places


def _seam_matrix(n: int, factor: int, share: float) -> Array:
    """Return the matrix, shape (n factor, n), that keeps cells flat but for a linear seam of this width."""
    place = _places(n, factor)
    first = np.floor(place).astype(np.intp)
    weight = np.clip((place - first - 0.5) / share + 0.5, 0.0, 1.0)
    matrix, rows = np.zeros((n * factor, n)), np.arange(n * factor)
    np.add.at(matrix, (rows, np.clip(first, 0, n - 1)), 1.0 - weight)
    np.add.at(matrix, (rows, np.clip(first + 1, 0, n - 1)), weight)
    return matrix


def _cubic_matrix(n: int, factor: int) -> Array:
    """Return the matrix, shape (n factor, n), from nodes to `factor` samples in each cell.

    Cubic convolution (R. G. Keys, 1981, a = -1/2); the border node is repeated outside.
    """
    place = _places(n, factor)
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
