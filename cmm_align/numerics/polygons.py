"""Which places lie inside closed polygons, quickly for many places and many corners."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def inside_polygons(loops: Sequence[Array], x: Array, y: Array, slack: float) -> Mask:
    """Return whether places lie inside an odd number of closed polygons, or close to an edge.

    Parameters
    ----------
    loops : sequence of ndarray, shape (k, 2)
        Corners in order, either way round, the last one joined to the first: an outline and its holes.
    x, y : ndarray, shape (n,)
        Places, in the unit of the corners; NaN is outside.
    slack : float
        Places this close to an edge are inside.

    Notes
    -----
    Counts the edges that a ray to +x crosses. Edges and places are sorted into bands of y, so that a place
    meets only the edges of its band.
    """
    start = np.concatenate([np.asarray(loop, dtype=np.float64) for loop in loops])
    end = np.concatenate([np.roll(loop, -1, axis=0) for loop in loops])
    low, high = np.minimum(start[:, 1], end[:, 1]) - slack, np.maximum(start[:, 1], end[:, 1]) + slack
    inside = np.zeros(len(x), dtype=bool)
    near = np.flatnonzero((y >= low.min()) & (y <= high.max()) & np.isfinite(x))
    if not len(near):
        return inside
    bands = max(1, min(512, len(start) // 4))
    cuts = np.linspace(low.min(), high.max(), bands + 1)
    band = np.clip(np.searchsorted(cuts, y[near], side="right") - 1, 0, bands - 1)
    order = np.argsort(band, kind="stable")
    limits = np.searchsorted(band[order], np.arange(bands + 1))
    for k in range(bands):
        if limits[k] == limits[k + 1]:
            continue
        edges = np.flatnonzero((high >= cuts[k]) & (low <= cuts[k + 1]))
        members = near[order[limits[k] : limits[k + 1]]]
        for part in np.array_split(members, len(members) * len(edges) // 4_000_000 + 1):
            inside[part] = _in_band(start[edges], end[edges], x[part, None], y[part, None], slack)
    return inside


def _in_band(a: Array, b: Array, x: Array, y: Array, slack: float) -> Mask:
    """Count the crossings of each place, shape (n, 1), with the edges of its band."""
    e = b - a
    spans = (a[:, 1] > y) != (b[:, 1] > y)
    rise = np.where(e[:, 1] == 0.0, 1.0, e[:, 1])
    crossed = spans & (x < a[:, 0] + (y - a[:, 1]) / rise * e[:, 0])
    length = np.maximum(np.sum(e * e, axis=1), 1e-300)
    along = np.clip(((x - a[:, 0]) * e[:, 0] + (y - a[:, 1]) * e[:, 1]) / length, 0.0, 1.0)
    away = np.hypot(x - a[:, 0] - along * e[:, 0], y - a[:, 1] - along * e[:, 1])
    result: Mask = (np.count_nonzero(crossed, axis=1) % 2 == 1) | (away <= slack).any(axis=1)
    return result
