"""What the noise of single points adds to means over the nodes of a local regression, which share points.

The value of a node is ``sum_i lambda . phi(x_i - x_node) e_i`` with lambda the first row of the inverse of
its normal matrix. So a point at p in cell m adds ``a = sum_j lambda_j . phi(p + m - j)`` to the sum over all
nodes, a quadratic of p alone in each cell; the sum of its square over the points of the cell, by the moments
of the cell, times the variance of a point is the answer.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from cmm_align.numerics.chunked import in_threads
from cmm_align.numerics.local_regression import (
    EXPONENTS,
    INDEX,
    LocalFit,
    Moments,
    reach_of,
    rows_at_once,
    shift_matrix,
    window_moments,
)

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_PRODUCTS: Final = np.array([[INDEX[a + c, b + d] for c, d in EXPONENTS[:6]] for a, b in EXPONENTS[:6]])
"""Where the moment of each product of two of the six quadratic monomials stands."""


def handed_noise(fit: LocalFit, known: Mask, *, half_width: float = 1.5) -> Array:
    """Return the variance that noise of the points hands to the sum of the known nodes, node by node.

    With h of this function ``var(sum_j q_j value_j) = sum_j q_j^2 h_j`` for any q that changes little within
    a window, whatever points its nodes share and however unevenly they lie.

    Parameters
    ----------
    fit : LocalFit
        Answer of `local_regression`.
    known : ndarray of bool, shape (ny, nx)
        Nodes that count; known to the fit.
    half_width : float
        As given to `local_regression`.

    Returns
    -------
    ndarray, shape (ny, nx)
        Square of the unit of the values; zero where not known. A cell whose own node does not count hands
        its share to the nodes in reach.
    """
    reach = reach_of(half_width)
    ny, nx = known.shape
    pull = np.zeros((6, ny, nx))

    def pulled(rows: slice) -> None:
        cells = fit.powers[:, rows.start : rows.stop + 2 * reach]
        window = window_moments(Moments(cells, np.zeros((7, *cells.shape[1:]))), reach)
        counted = known[rows]
        pull[:, rows][:, counted] = _pull(window.powers[:, counted], fit.quadratic[rows][counted])

    in_threads(pulled, ny, rows_at_once(nx))
    added = np.zeros((6, ny + 2 * reach, nx + 2 * reach))
    for sy in range(-reach, reach + 1):
        for sx in range(-reach, reach + 1):
            there = np.s_[:, reach + sy : reach + sy + ny, reach + sx : reach + sx + nx]
            added[there] += np.tensordot(shift_matrix((sx, sy))[:6, :6].T, pull, 1)
    squares = np.zeros(added.shape[1:])

    def squared(rows: slice) -> None:
        part = added[:, rows]
        for a in range(6):
            for b in range(a + 1):
                both = 1.0 if a == b else 2.0
                squares[rows] += both * part[a] * part[b] * fit.powers[_PRODUCTS[a, b], rows]

    in_threads(squared, len(squares), rows_at_once(nx))
    width = 2 * reach + 1
    counted = np.pad(known, reach).astype(np.float64)
    in_reach = _box_mean(counted, reach)
    strays = np.where((counted == 0.0) & (in_reach > 0.5 / width**2), squares, 0.0)
    strays /= np.maximum(in_reach, 1.0 / width**2)
    squares += _box_mean(strays, reach)
    variance = np.where(known, fit.sigma**2 / fit.leverage, 0.0)
    return np.asarray(squares[reach : reach + ny, reach : reach + nx] * variance, dtype=np.float64)


def _pull(powers: Array, quadratic: Mask) -> Array:
    """Return the first rows of the inverse normal matrices, shape (6, n); plane ones end in zeros."""
    gram = np.moveaxis(powers[_PRODUCTS], 2, 0)
    plane = np.flatnonzero(~quadratic)
    gram[plane, 3:, :] = 0.0
    gram[plane, :, 3:] = 0.0
    gram[plane, 3:, 3:] = np.eye(3)
    return np.asarray(np.linalg.solve(gram, np.eye(6)[:, :1])[..., 0].T, dtype=np.float64)


def _box_mean(field: Array, reach: int) -> Array:
    """Return the mean over the square box about each place, zeros outside the field."""
    width = 2 * reach + 1
    for axis in (0, 1):
        n = field.shape[axis]
        padded = np.pad(field, [(reach, reach) if axis == k else (0, 0) for k in (0, 1)])
        total = np.zeros_like(field)
        for step in range(width):
            total += padded.take(np.arange(step, step + n), axis)
        field = total / width
    return field
