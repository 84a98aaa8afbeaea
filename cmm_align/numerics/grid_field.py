"""A smooth field on a regular grid: read it between the nodes, continue it where it is unknown.

Fields are indexed [iy, ix]; NaN marks a node without a value. Interpolation is the cubic
convolution of R. G. Keys, IEEE Trans. ASSP 29, 1981, doi 10.1109/TASSP.1981.1163711 (a = -1/2), which
reproduces quadratics; continuation is a membrane (Laplace's equation) with free edges, so a
continued value never leaves the range of the known ones.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_SWEEPS: Final = 40
"""Relaxations a level: with the coarser level as the start, the rest is short-waved and dies fast."""


def interpolated(x_nodes: Array, y_nodes: Array, field: Array, x: Array, y: Array) -> Array:
    """Return a field between its nodes.

    Parameters
    ----------
    x_nodes, y_nodes : ndarray, shape (nx,), (ny,)
        Evenly spaced, ascending, at least 2 each.
    field : ndarray, shape (ny, nx)
        NaN where unknown.
    x, y : ndarray, shape (n,)
        Places; up to half a step outside the grid the border value is held.

    Returns
    -------
    ndarray, shape (n,)
        Cubic where the 4 x 4 nodes around are known, linear where the 2 x 2 are, NaN elsewhere and
        more than half a step outside.
    """
    ix, p, inside_x = _located(x_nodes, x)
    iy, q, inside_y = _located(y_nodes, y)
    padded = _padded(field)
    weights_x, weights_y = _cubic_weights(p), _cubic_weights(q)
    cubic = np.zeros_like(p)
    for j in range(4):
        row = np.zeros_like(p)
        for i in range(4):
            row += weights_x[i] * padded[iy + j, ix + i]
        cubic += weights_y[j] * row
    low = (1.0 - p) * field[iy, ix] + p * field[iy, ix + 1]
    high = (1.0 - p) * field[iy + 1, ix] + p * field[iy + 1, ix + 1]
    linear = (1.0 - q) * low + q * high
    return np.where(inside_x & inside_y, np.where(np.isnan(cubic), linear, cubic), np.nan)


def smoothed(field: Array, width: int = 7) -> Array:
    """Return a field averaged over square windows, twice, so that a quadratic stays as it is inside.

    Parameters
    ----------
    field : ndarray, shape (ny, nx)
        NaN where unknown.
    width : int
        Of the window in nodes, odd.

    Returns
    -------
    ndarray, shape (ny, nx)
        ``S f + S (f - S f)``: Tukey's twicing (Exploratory Data Analysis, 1977); NaN where `field` is.
    """
    from scipy.ndimage import uniform_filter

    known = np.isfinite(field)
    share = uniform_filter(known.astype(np.float64), width, mode="constant")

    def averaged(values: Array) -> Array:
        """Return the mean of the known values in each window."""
        sums = uniform_filter(np.where(known, values, 0.0), width, mode="constant")
        return np.where(known, sums / np.where(known, share, 1.0), np.nan)

    once = averaged(field)
    return once + averaged(field - once)


def continued(field: Array) -> Array:
    """Return a field with every unknown node continued smoothly from the known ones.

    Parameters
    ----------
    field : ndarray, shape (ny, nx)
        NaN where unknown; at least one node known.

    Returns
    -------
    ndarray, shape (ny, nx)
        Known nodes unchanged; all others within the range of the known ones.
    """
    unknown = np.isnan(field)
    if not unknown.any() or unknown.all():
        return field.copy()
    result = np.where(unknown, refined(continued(coarsened(field)), field.shape), field)
    for _ in range(_SWEEPS):
        around = np.pad(result, 1, mode="edge")
        mean = 0.25 * (around[:-2, 1:-1] + around[2:, 1:-1] + around[1:-1, :-2] + around[1:-1, 2:])
        result = np.where(unknown, mean, result)
    return result


def carried_on(field: Array, rings: int) -> Array:
    """Return a field with some rings of nodes around the known ones carried on by parabolas.

    Parameters
    ----------
    field : ndarray, shape (ny, nx)
        NaN where unknown.
    rings : int
        How many; more than a few run away.

    Returns
    -------
    ndarray, shape (ny, nx)
        ``3 f1 - 3 f2 + f3``, the mean over those of the eight directions that have three known nodes in a
        row, two where there are no three (``2 f1 - f2``); known nodes unchanged, others NaN.
    """
    out = field
    for _ in range(rings):
        wide = np.pad(out, 3, constant_values=np.nan)
        known = np.isfinite(wide)
        beside = known[2:, 1:-1] | known[:-2, 1:-1] | known[1:-1, 2:] | known[1:-1, :-2]
        iy, ix = np.nonzero(beside[2:-2, 2:-2] & ~known[3:-3, 3:-3])
        if not len(iy):
            return out
        lines = [
            [wide[3 + iy + k * dy, 3 + ix + k * dx] for k in (1, 2, 3)]
            for dy, dx in ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1))
        ]
        value = np.full(len(iy), np.nan)
        for found in ([2.0 * a - b for a, b, _ in lines], [3.0 * (a - b) + c for a, b, c in lines]):
            some = np.isfinite(found)
            count = some.sum(axis=0)
            mean = np.where(some, found, 0.0).sum(axis=0) / np.maximum(count, 1)
            value = np.where(count > 0, mean, value)
        out = out.copy()
        out[iy, ix] = value
    return out


def _located(nodes: Array, places: Array) -> tuple[NDArray[np.intp], Array, Mask]:
    """Return the cell of each place, its share in the cell (0 to 1), and whether it is near the grid."""
    t = (places - nodes[0]) / (nodes[1] - nodes[0])
    last = len(nodes) - 1
    inside = (t >= -0.5) & (t <= last + 0.5)
    held = np.clip(np.where(inside, t, 0.0), 0.0, last)
    cell = np.minimum(held.astype(np.intp), last - 1)
    return cell, held - cell, inside


def _padded(field: Array) -> Array:
    """Return the field with one more node on each side, continued by a quadratic (Keys, eq. 20)."""
    ny, nx = field.shape
    wide = np.empty((ny + 2, nx + 2))
    wide[1:-1, 1:-1] = field
    for lines in (wide[1:-1].T, wide):  # views: first along x, then along y
        if len(lines) >= 5:
            lines[0] = 3.0 * lines[1] - 3.0 * lines[2] + lines[3]
            lines[-1] = 3.0 * lines[-2] - 3.0 * lines[-3] + lines[-4]
        else:
            lines[0] = 2.0 * lines[1] - lines[2]
            lines[-1] = 2.0 * lines[-2] - lines[-3]
    return wide


def _cubic_weights(t: Array) -> tuple[Array, Array, Array, Array]:
    """Return the weights of the four nodes around a place (Keys, a = -1/2)."""
    t2, t3 = t * t, t * t * t
    return (
        -0.5 * t + t2 - 0.5 * t3,
        1.0 - 2.5 * t2 + 1.5 * t3,
        0.5 * t + 2.0 * t2 - 1.5 * t3,
        0.5 * (t3 - t2),
    )


def coarsened(field: Array) -> Array:
    """Return means of the known nodes of 2 x 2 blocks; NaN where a block knows none.

    Parameters
    ----------
    field : ndarray, shape (ny, nx)

    Returns
    -------
    ndarray, shape (ceil(ny / 2), ceil(nx / 2))
    """
    ny, nx = field.shape
    even = np.full((ny + ny % 2, nx + nx % 2), np.nan)
    even[:ny, :nx] = field
    blocks = even.reshape(even.shape[0] // 2, 2, even.shape[1] // 2, 2)
    known = np.isfinite(blocks)
    count = known.sum(axis=(1, 3))
    total = np.where(known, blocks, 0.0).sum(axis=(1, 3))
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def refined(coarse: Array, shape: tuple[int, ...]) -> Array:
    """Return a coarse field on the fine nodes, linear between the middles of the blocks.

    Parameters
    ----------
    coarse : ndarray, shape (my, mx)
        As `coarsened` gives it.
    shape : tuple of int
        Of the fine field.

    Returns
    -------
    ndarray of that shape
    """
    for axis in (0, 1):
        around = np.pad(coarse, [(1, 1) if k == axis else (0, 0) for k in (0, 1)], mode="edge")
        n = coarse.shape[axis]
        here = around.take(np.arange(1, n + 1), axis)
        fine = np.stack(
            [
                0.75 * here + 0.25 * around.take(np.arange(n), axis),
                0.75 * here + 0.25 * around.take(np.arange(2, n + 2), axis),
            ],
            axis=axis + 1,
        )
        coarse = fine.reshape([2 * n if k == axis else m for k, m in enumerate(coarse.shape)])
    return coarse[: shape[0], : shape[1]]
