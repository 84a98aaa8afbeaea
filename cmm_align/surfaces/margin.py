"""Which places keep a distance from the border of a nominal, whatever kind of surface it is.

A surface says of a place whether it belongs to it, and no more. The border is found where that answer
changes between the nodes of a raster, exactly by halving, and drawn as short straight pieces.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from cmm_align.surfaces.protocol import Array, Mask, Surface

RASTER: Final = 400
"""Steps of the raster along the longer side; islands and holes smaller than a step may be missed."""
_HALVINGS: Final = 40
_NEAREST: Final = 8


def deep_inside(surface: Surface, margin_mm: float) -> Callable[[Array, Array], Mask] | None:
    """Return what says of places whether they keep a distance from the border of a surface.

    Parameters
    ----------
    surface : Surface
    margin_mm : float
        Distance, mm, above zero.

    Returns
    -------
    callable or None
        Of places x, y of shape (n,), mm, frame `surface`; None if no place of the raster keeps the distance.

    Notes
    -----
    Where the border is smooth the distance is right to ``step^2 / (4 radius of curvature)``, step being that
    of the raster; corners are cut off by less than a step.
    """
    b = surface.bounds
    step = max(b.x_max - b.x_min, b.y_max - b.y_min) / RASTER
    xs, ys = (
        np.arange(low - 1.5 * step, high + 1.5 * step, step)
        for low, high in ((b.x_min, b.x_max), (b.y_min, b.y_max))
    )
    px, py = np.meshgrid(xs, ys)
    known = surface.contains(px.ravel(), py.ravel()).reshape(px.shape)
    start, end = _border(surface, known, xs, ys)
    from scipy.ndimage import distance_transform_edt  # slow to import
    from scipy.spatial import cKDTree

    tree = cKDTree(0.5 * (start + end))
    count = min(_NEAREST, len(start))

    def inside(x_mm: Array, y_mm: Array) -> Mask:
        found = surface.contains(x_mm, y_mm)
        k = np.flatnonzero(found)
        place = np.stack([x_mm[k], y_mm[k]], axis=1)
        _, near = tree.query(place, k=range(1, count + 1), distance_upper_bound=margin_mm + step)
        for piece in np.asarray(near).T:
            there = np.flatnonzero(piece < len(start))
            away = _distance(place[there], start[piece[there]], end[piece[there]])
            found[k[there[away < margin_mm]]] = False
        return found

    room = distance_transform_edt(known)
    deepest = known & (room >= room.max() - 2.0)
    return inside if inside(px[deepest], py[deepest]).any() else None


def _border(surface: Surface, known: Mask, xs: Array, ys: Array) -> tuple[Array, Array]:
    """Return the ends of the pieces of the border, each shape (m, 2), mm."""
    east = _crossings(surface, known, xs, ys)
    north = _crossings(surface, known.T, xs, ys, turned=True).transpose(1, 0, 2)
    around = np.stack([east[:-1], north[:, 1:], east[1:], north[:, :-1]])  # sides of the cells, in a ring
    starts, ends = [], []
    for first in range(4):
        for second in range(first + 1, 4):
            both = np.isfinite(around[first, ..., 0]) & np.isfinite(around[second, ..., 0])
            starts.append(around[first][both])
            ends.append(around[second][both])
    return np.concatenate(starts), np.concatenate(ends)


def _crossings(surface: Surface, known: Mask, xs: Array, ys: Array, *, turned: bool = False) -> Array:
    """Return where the border crosses the sides along the last axis of the raster; NaN where it does not."""
    along, across = (ys, xs) if turned else (xs, ys)
    row, column = np.nonzero(known[:, 1:] != known[:, :-1])
    inner = np.where(known[row, column], along[column], along[column + 1])
    outer = np.where(known[row, column], along[column + 1], along[column])
    for _ in range(_HALVINGS):
        middle = 0.5 * (inner + outer)
        place = (across[row], middle) if turned else (middle, across[row])
        holds = surface.contains(*place)
        inner, outer = np.where(holds, middle, inner), np.where(holds, outer, middle)
    found = np.full((known.shape[0], known.shape[1] - 1, 2), np.nan)
    found[row, column] = np.stack([across[row], inner] if turned else [inner, across[row]], axis=1)
    return found


def _distance(place: Array, start: Array, end: Array) -> Array:
    """Return the distance of places from straight pieces, shape (n,)."""
    way = end - start
    length = np.maximum(np.sum(way * way, axis=1), 1e-300)
    along = np.clip(np.sum((place - start) * way, axis=1) / length, 0.0, 1.0)
    result: Array = np.hypot(*(place - start - along[:, None] * way).T)
    return result
