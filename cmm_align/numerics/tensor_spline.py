"""Tensor-product B-splines on uniform knots: evaluation, interpolation, smoothing of grids.

A surface over `n` cells along an axis has ``n + degree`` coefficients there; coefficient ``i`` to
``i + degree`` act in cell ``i``. Coordinates are in cells: 0 is the first knot, `n` the last.
Source: de Boor, "A Practical Guide to Splines", 2001, chapters IX and X.
"""

from __future__ import annotations

from math import comb
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmm_align.errors import NumericsError

Array = NDArray[np.float64]


class SplineJet(NamedTuple):
    """Value and derivatives with respect to the coordinates in cells, each of shape (n,)."""

    z: Array
    zu: Array
    zv: Array
    zuu: Array
    zuv: Array
    zvv: Array


def basis(t: Array, degree: int, *, derivatives: bool = True) -> Array:
    """Return the B-splines that act in a cell, with first and second derivatives.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Place in the cell, 0 to 1; outside, the cell's polynomial continues.
    degree : int
        At least 2.
    derivatives : bool
        Whether they are needed; without, they are zero.

    Returns
    -------
    ndarray, shape (3, degree + 1, n)
        Values, first and second derivatives.
    """
    if degree == 3:
        result = np.empty((3, 4, len(t)))
        _cubic(t, result)
        return result
    result = np.zeros((3, degree + 1, len(t)))
    low = np.ones((1, len(t)))
    for q in range(1, degree + 1):  # Cox - de Boor on uniform knots
        high = np.zeros((q + 1, len(t)))
        for j in range(q):
            high[j] += (float(1 + j) - t) * low[j]
            high[j + 1] += (t + float(q - 1 - j)) * low[j]
        high /= q
        if q == degree - 1 and derivatives:
            result[1] = _differences(high)
        if q == degree - 2 and derivatives:
            result[2] = _differences(_differences(high))
        low = high
    result[0] = low
    return result


def _cubic(t: Array, out: Array) -> None:
    """Write the cubic B-splines out: the case that large grids spend their time in."""
    s = 1.0 - t
    value, first, second = out
    s2, t2 = s * s, t * t
    value[0], value[3] = s2 * s * (1.0 / 6.0), t2 * t * (1.0 / 6.0)
    value[1] = (0.5 * t - 1.0) * t2 + (2.0 / 3.0)
    value[2] = 1.0 - value[0] - value[1] - value[3]
    first[0], first[1], first[3] = -0.5 * s2, (1.5 * t - 2.0) * t, 0.5 * t2
    first[2] = -first[0] - first[1] - first[3]
    second[0], second[1], second[3] = s, 3.0 * t - 2.0, t
    second[2] = -second[1] - 1.0


def _differences(low: Array) -> Array:
    """Return the derivatives of the next higher degree: b'_j = low_(j-1) - low_j."""
    result = np.zeros((len(low) + 1, low.shape[1]))
    result[1:] = low
    result[:-1] -= low
    return result


def spline_jet(coefficients: Array, degree: int, u: Array, v: Array) -> SplineJet:
    """Evaluate a tensor spline and its derivatives.

    Parameters
    ----------
    coefficients : ndarray, shape (n_v + degree, n_u + degree)
        C-contiguous.
    degree : int
        3 or 5.
    u, v : ndarray, shape (n,)
        Places in cells along the second and the first axis of `coefficients`. Beyond the border
        the outermost cell's polynomial continues; NaN gives NaN.

    Returns
    -------
    SplineJet
        Exact to rounding. The cost is (degree + 1)^2 gathers a point; call it in chunks that stay
        in cache.
    """
    n_v, n_u = (n - degree for n in coefficients.shape)
    width = coefficients.shape[1]
    iu = cell_of(u, n_u)
    iv = cell_of(v, n_v)
    bu, bv = basis(u - iu, degree), basis(v - iv, degree)
    k = np.arange(degree + 1)
    offsets = k[:, None] * width + k
    local = coefficients.ravel().take((iv * width + iu) + offsets[:, :, None])
    rows = np.einsum("jin,din->djn", local, bu)  # along u: value, first, second derivative of each row
    z, zu, zv, zuu, zuv, zvv = (
        np.einsum("jn,jn->n", rows[du], bv[dv]) for du, dv in ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
    )
    return SplineJet(z, zu, zv, zuu, zuv, zvv)


def cell_of(u: Array, n: int) -> NDArray[np.intp]:
    """Return the cell of each place of shape (n,), clamped to the net; NaN goes to cell 0."""
    with np.errstate(invalid="ignore"):
        clamped = np.minimum(np.maximum(u, 0.0), float(n - 1))
    return np.where(np.isfinite(clamped), clamped, 0.0).astype(np.intp)


def interpolating_coefficients(values: Array, degree: int) -> Array:
    """Return the spline that passes through values at all knots.

    The ends are "not-a-knot": the polynomial of the outermost cells runs on over the next knots, so
    that the order of accuracy holds up to the border.

    Parameters
    ----------
    values : ndarray, shape (n_v + 1, n_u + 1)
        Heights at the knots, finite.
    degree : int
        3 or 5; each side needs at least ``degree + 2`` knots.

    Returns
    -------
    ndarray, shape (n_v + degree, n_u + degree)

    Raises
    ------
    NumericsError
        If there are too few knots.
    """
    along_v = _interpolate_columns(np.asarray(values, dtype=np.float64), degree)
    return np.ascontiguousarray(_interpolate_columns(np.ascontiguousarray(along_v.T), degree).T)


def _interpolate_columns(values: Array, degree: int) -> Array:
    """Interpolate along the first axis."""
    from scipy.linalg import solve_banded  # slow to import, needed only to build a surface

    n = len(values)
    if n < degree + 2:
        raise NumericsError(
            f"{n} knots are too few for a spline of degree {degree}", expected=f"at least {degree + 2}"
        )
    half = degree // 2
    size = n + degree - 1
    at_knot = basis(np.zeros(1), degree)[0, :degree, 0].tolist()
    jump = [(-1.0) ** k * comb(degree + 1, k) for k in range(degree + 2)]
    # Rows: `half` jump conditions, the n knots, `half` jump conditions; all inside this band.
    lower = upper = degree + 1
    band = np.zeros((lower + upper + 1, size))

    def put(row: int, column: int, value: float) -> None:
        band[upper + row - column, column] = value

    for k in range(half):  # no jump of the highest derivative at knots 1 .. half and at the other end
        for j, value in enumerate(jump):
            put(k, k + j, value)
            put(size - 1 - k, size - 1 - k - j, value)
    for j, value in enumerate(at_knot):
        rows = np.arange(n)
        band[upper + half + rows - (rows + j), rows + j] = value
    right = np.zeros((size, values.shape[1]))
    right[half : half + n] = values
    result: Array = solve_banded(
        (lower, upper), band, right, overwrite_ab=True, overwrite_b=True, check_finite=False
    )
    return result


def smoothed_coefficients(values: Array, cells: tuple[int, int], degree: int) -> Array:
    """Return the least-squares spline through values on a full grid, with fewer cells than nodes.

    On a grid the problem falls apart into one along each axis.

    Parameters
    ----------
    values : ndarray, shape (m_v, m_u)
        Heights at equally spaced places from the first to the last knot, finite.
    cells : tuple of int
        Number of cells (n_v, n_u), each below the number of nodes.
    degree : int
        3 or 5.

    Returns
    -------
    ndarray, shape (n_v + degree, n_u + degree)
    """
    along_v = _smooth_columns(values, cells[0], degree)
    return np.ascontiguousarray(_smooth_columns(np.ascontiguousarray(along_v.T), cells[1], degree).T)


def _smooth_columns(values: Array, cells: int, degree: int) -> Array:
    """Fit along the first axis."""
    from scipy.linalg import solveh_banded  # slow to import, needed only to build a surface

    u = np.linspace(0.0, float(cells), len(values))
    cell = cell_of(u, cells)
    rows = np.zeros((len(values), cells + degree))
    for k, b in enumerate(basis(u - cell, degree)[0]):
        rows[np.arange(len(u)), cell + k] = b
    normal = rows.T @ rows
    band = np.zeros((degree + 1, cells + degree))
    for k in range(degree + 1):
        band[k, : cells + degree - k] = np.diagonal(normal, k)
    first: Array = solveh_banded(band, rows.T @ values, lower=True)
    again: Array = solveh_banded(band, rows.T @ (values - rows @ first), lower=True)
    return first + again
