"""Polynomials over a rectangle, made orthonormal on the places that really carry data.

Over a full rectangle Legendre products are orthogonal; over a mask nothing is until it is made so
by QR. The order of the columns is by rising degree, so that removing the first m columns means the
same whatever comes after.
"""

from __future__ import annotations

from math import comb
from typing import Final

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

Array = NDArray[np.float64]

_MIN_PIVOT: Final = 1e-10
"""A column this much shorter after QR (relative) is no new shape on these places."""

_MIN_CHOLESKY_PIVOT: Final = 1e-6
"""Below this the Gram matrix has lost the digits that a second round could restore."""


def n_terms(degree: int) -> int:
    """Return the number of products of total degree up to `degree`: 3 for 1, 10 for 3, 36 for 7."""
    return comb(degree + 2, 2)


def rectangle_polynomials(x: Array, y: Array, degree: int) -> Array:
    """Return polynomials of total degree up to `degree` at given places.

    Parameters
    ----------
    x, y : ndarray, shape (n,)
        Places, any one unit of length for both.
    degree : int
        Largest total degree.

    Returns
    -------
    ndarray, shape (n, n_terms(degree))
        By rising degree. Products of Legendre polynomials over the bounding rectangle, but for
        degree 2: there ``X^2 + Y^2`` (power), ``X^2 - Y^2`` and ``X Y`` (astigmatism) in one common
        scale, so that power keeps its meaning on a rectangle that is no square.
    """
    centre_x, half_x = _middle(x)
    centre_y, half_y = _middle(y)
    along_x = legendre.legvander((x - centre_x) / half_x, degree)
    along_y = legendre.legvander((y - centre_y) / half_y, degree)
    columns = [along_x[:, d - j] * along_y[:, j] for d in range(degree + 1) for j in range(d + 1)]
    if degree >= 2:
        common = max(half_x, half_y)
        square_x, square_y = ((x - centre_x) / common) ** 2, ((y - centre_y) / common) ** 2
        cross = (x - centre_x) * (y - centre_y) / common**2
        columns[3:6] = [square_x + square_y, square_x - square_y, cross]
    return np.stack(columns, axis=1)


def orthonormalised(columns: Array) -> Array:
    """Return columns with ``mean(q_i q_j) = delta_ij``, spanning the same spaces in the same order.

    Parameters
    ----------
    columns : ndarray, shape (n, m), n >= m
        One shape a column.

    Returns
    -------
    ndarray, shape (n, m)
        A column that is no new shape on these places is zero. ``mean(q_i field)`` is the coefficient
        of a field, in its unit, and the RMS of that shape's share.
    """
    lengths = np.linalg.norm(columns, axis=0)
    scaled = columns / np.where(lengths > 0.0, lengths, 1.0)
    try:
        q = _cholesky_qr(_cholesky_qr(scaled))
        fresh = np.ones(columns.shape[1], dtype=np.bool_)
    except np.linalg.LinAlgError:  # dependent columns: the slower way finds which
        q, r = np.linalg.qr(scaled)
        fresh = np.abs(np.diagonal(r)) > _MIN_PIVOT
    result: Array = q * (np.sqrt(len(columns)) * fresh)
    return result


def _cholesky_qr(columns: Array) -> Array:
    """Return Q of a QR by the Cholesky factor of the Gram matrix; twice is as orthogonal as Householder.

    Y. Yamamoto et al., "Roundoff error analysis of the CholeskyQR2 algorithm", ETNA 44, 2015.
    """
    lower = np.linalg.cholesky(columns.T @ columns)
    if np.diagonal(lower).min() < _MIN_CHOLESKY_PIVOT:
        raise np.linalg.LinAlgError("the columns are nearly dependent")
    q: Array = columns @ np.linalg.inv(lower).T
    return q


def _middle(values: Array) -> tuple[float, float]:
    """Return centre and half extent (1 if there is none)."""
    low, high = float(values.min()), float(values.max())
    return 0.5 * (low + high), 0.5 * (high - low) or 1.0
