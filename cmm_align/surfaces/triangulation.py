"""Delaunay triangulation of the projection of scattered nominal points (the paper's method)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cmm_align.surfaces.protocol import Array

Index = NDArray[np.int32]


def delaunay_triangles(x_mm: Array, y_mm: Array) -> Index:
    """Return the Delaunay triangulation of scattered places, counter-clockwise.

    Parameters
    ----------
    x_mm, y_mm : ndarray, shape (n,), mm

    Returns
    -------
    ndarray of int32, shape (m, 3)

    Notes
    -----
    By insertion in strips with exact predicates (startin), three times as fast as Qhull on 1e6 points; by
    Qhull where places coincide.
    """
    import startinpy  # slow to import, and only scattered nominals need it

    n = len(x_mm)
    strips = max(int(np.sqrt(n / 4.0)), 1)
    span = max(float(np.ptp(y_mm)), 1e-300)
    strip = np.floor((y_mm - y_mm.min()) / span * strips)
    order = np.lexsort((np.where(strip % 2 == 0, x_mm, -x_mm), strip))  # there and back: always a short walk
    net = startinpy.DT()
    net.snap_tolerance = float(np.finfo(np.float64).tiny)
    net.insert(np.stack([x_mm, y_mm, np.zeros(n)], axis=1)[order], insertionstrategy="AsIs")
    if net.number_of_vertices() == n:
        triangles: NDArray[np.intp] = order[
            np.asarray(net.triangles, dtype=np.intp) - 1
        ]  # vertex 0 lies at infinity
    else:
        from scipy.spatial import Delaunay

        triangles = Delaunay(np.stack([x_mm - x_mm.mean(), y_mm - y_mm.mean()], axis=1)).simplices.astype(
            np.intp
        )
    return _counter_clockwise(x_mm, y_mm, np.asarray(triangles, dtype=np.int32))


def _counter_clockwise(x: Array, y: Array, triangles: Index) -> Index:
    """Turn every triangle counter-clockwise and drop those without area."""
    a, b, c = (triangles[:, k] for k in range(3))
    area = (x[b] - x[a]) * (y[c] - y[a]) - (y[b] - y[a]) * (x[c] - x[a])
    triangles = np.where(area[:, None] < 0.0, triangles[:, [0, 2, 1]], triangles)
    return np.ascontiguousarray(triangles[area != 0.0])
