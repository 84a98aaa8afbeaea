"""Tensor-product B-splines on uniform knots: evaluation, interpolation, least squares.

A surface over `n` cells along an axis has ``n + degree`` coefficients there; coefficient ``i`` to
``i + degree`` act in cell ``i``. Coordinates are in cells: 0 is the first knot, `n` the last.
Source: de Boor, "A Practical Guide to Splines", 2001, chapters IX and X.
"""

from __future__ import annotations

from math import comb
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmm_align.errors import NumericsError

Array = NDArray[np.float64]

RIDGES: Final = (1e-15, 1e-13, 1e-11)
"""Weights of the smoothness term beside the data, relative, tried in turn until the matrix is positive
definite in rounding: only cells without data feel it."""

_ROWS_PER_BLOCK: Final = 1 << 15


class SplineJet(NamedTuple):
    """Value and derivatives with respect to the coordinates in cells, each of shape (n,)."""

    z: Array
    zu: Array
    zv: Array
    zuu: Array
    zuv: Array
    zvv: Array


def basis(t: Array, degree: int) -> Array:
    """Return the B-splines that act in a cell, with first and second derivatives.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Place in the cell, 0 to 1; outside, the cell's polynomial continues.
    degree : int
        At least 2.

    Returns
    -------
    ndarray, shape (3, degree + 1, n)
        Values, first and second derivatives.
    """
    result = np.zeros((3, degree + 1, len(t)))
    if degree == 3:
        _cubic(t, result)
        return result
    low = np.ones((1, len(t)))
    for q in range(1, degree + 1):  # Cox - de Boor on uniform knots
        high = np.zeros((q + 1, len(t)))
        for j in range(q):
            high[j] += (float(1 + j) - t) * low[j]
            high[j + 1] += (t + float(q - 1 - j)) * low[j]
        high /= q
        if q == degree - 1:
            result[1] = _differences(high)
        if q == degree - 2:
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
    return -np.diff(low, axis=0, prepend=0.0, append=0.0)


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
    iu = _cells(u, n_u)
    iv = _cells(v, n_v)
    bu, bv = basis(u - iu, degree), basis(v - iv, degree)
    k = np.arange(degree + 1)
    offsets = k[:, None] * width + k
    local = coefficients.ravel().take((iv * width + iu) + offsets[:, :, None])
    rows = np.einsum("jin,din->djn", local, bu)  # along u: value, first, second derivative of each row
    z, zu, zv, zuu, zuv, zvv = (
        np.einsum("jn,jn->n", rows[du], bv[dv]) for du, dv in ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
    )
    return SplineJet(z, zu, zv, zuu, zuv, zvv)


def _cells(u: Array, n: int) -> NDArray[np.intp]:
    """Return the cell of each place, clamped to the net; NaN goes to cell 0."""
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


def fitted_coefficients(u: Array, v: Array, z: Array, cells: tuple[int, int], degree: int) -> Array:
    """Return the least-squares spline through scattered values.

    The normal equations are summed cell by cell: every point of a cell sees the same
    ``(degree + 1)^2`` coefficients, so each cell is one small matrix product, and the whole matrix is
    banded with half width ``degree (n_u + degree) + degree``. A faint smoothness term carries the
    surface over cells without points.

    Parameters
    ----------
    u, v : ndarray, shape (n,)
        Places in cells along x and y.
    z : ndarray, shape (n,)
        Heights.
    cells : tuple of int
        Number of cells (n_v, n_u).
    degree : int
        3 or 5.

    Returns
    -------
    ndarray, shape (n_v + degree, n_u + degree)
        One step of iterative refinement is included.

    Raises
    ------
    NumericsError
        If the points do not determine a surface.
    """
    from scipy.linalg import cho_solve_banded, cholesky_banded  # slow to import

    n_v, n_u = cells
    narrow = n_u <= n_v  # the band is as wide as the fast axis: make the shorter one fast
    if not narrow:
        return np.ascontiguousarray(fitted_coefficients(v, u, z, (n_u, n_v), degree).T)
    order = np.lexsort((_cells(u, n_u), _cells(v, n_v)))
    u, v, z = u[order], v[order], z[order]
    cell = _cells(v, n_v) * n_u + _cells(u, n_u)
    offset = float(z.mean())
    blocks, right = _cell_sums(u, v, z - offset, cell, (n_v, n_u), degree)
    right_full = _assemble_right(right, n_v, n_u, degree)
    for ridge in RIDGES:
        band = _assemble_band(blocks, n_v, n_u, degree)
        _add_smoothness(band, n_v + degree, n_u + degree, ridge * float(band[0].max()))
        try:
            factor = cholesky_banded(band, overwrite_ab=True, lower=True, check_finite=False)
            break
        except np.linalg.LinAlgError:
            continue
    else:
        raise NumericsError("the points do not determine a surface", remedy="give more points, or a grid")
    solution: Array = cho_solve_banded((factor, True), right_full, check_finite=False)
    shape = (n_v + degree, n_u + degree)
    rest = z - offset - _values(solution.reshape(shape), degree, u, v)
    right = _cell_right(u, v, rest, cell, (n_v, n_u), degree)
    solution = solution + cho_solve_banded(
        (factor, True), _assemble_right(right, n_v, n_u, degree), check_finite=False
    )
    return np.ascontiguousarray(solution.reshape(shape) + offset)


def _values(coefficients: Array, degree: int, u: Array, v: Array) -> Array:
    """Evaluate heights only, block by block."""
    result = np.empty(len(u))
    for start in range(0, len(u), _ROWS_PER_BLOCK):
        part = slice(start, start + _ROWS_PER_BLOCK)
        result[part] = spline_jet(coefficients, degree, u[part], v[part]).z
    return result


def _rows(u: Array, v: Array, cells: tuple[int, int], degree: int) -> Array:
    """Return the design rows, shape (n, (degree + 1)^2)."""
    n_v, n_u = cells
    bu = basis(u - _cells(u, n_u), degree)[0].T
    bv = basis(v - _cells(v, n_v), degree)[0].T
    rows: Array = (bv[:, :, None] * bu[:, None, :]).reshape(len(u), -1)
    return rows


def _spans(cell: NDArray[np.intp]) -> list[tuple[int, int]]:
    """Cut sorted cells into blocks of whole cells, each of a size that stays in cache."""
    starts = np.flatnonzero(np.r_[True, np.diff(cell) != 0])
    ends = np.r_[starts[1:], len(cell)]
    spans: list[tuple[int, int]] = []
    begin = 0
    for end in ends.tolist():
        if end - begin >= _ROWS_PER_BLOCK // 4:
            spans.append((begin, end))
            begin = end
    if begin < len(cell):
        spans.append((begin, len(cell)))
    return spans


def _cell_sums(
    u: Array, v: Array, z: Array, cell: NDArray[np.intp], cells: tuple[int, int], degree: int
) -> tuple[Array, Array]:
    """Return the normal matrix and right-hand side of every cell."""
    m = (degree + 1) ** 2
    n = cells[0] * cells[1]
    blocks = np.zeros((n, m, m))
    right = np.zeros((n, m))
    for begin, end in _spans(cell):
        rows = _rows(u[begin:end], v[begin:end], cells, degree)
        inner = cell[begin:end]
        cuts = np.flatnonzero(np.r_[True, np.diff(inner) != 0, True])
        for a, b in zip(cuts[:-1].tolist(), cuts[1:].tolist(), strict=True):
            part = rows[a:b]
            blocks[inner[a]] = part.T @ part
            right[inner[a]] = z[begin + a : begin + b] @ part
    return blocks, right


def _cell_right(
    u: Array, v: Array, z: Array, cell: NDArray[np.intp], cells: tuple[int, int], degree: int
) -> Array:
    """Return the right-hand side of every cell."""
    right = np.zeros((cells[0] * cells[1], (degree + 1) ** 2))
    for begin, end in _spans(cell):
        rows = _rows(u[begin:end], v[begin:end], cells, degree) * z[begin:end, None]
        starts = np.flatnonzero(np.r_[True, np.diff(cell[begin:end]) != 0])
        right[cell[begin:end][starts]] = np.add.reduceat(rows, starts, axis=0)
    return right


def _assemble_right(right: Array, n_v: int, n_u: int, degree: int) -> Array:
    """Add the right-hand sides of all cells into one vector."""
    result = np.zeros((n_v + degree, n_u + degree))
    per_cell = right.reshape(n_v, n_u, degree + 1, degree + 1)
    for j in range(degree + 1):
        for i in range(degree + 1):
            result[j : j + n_v, i : i + n_u] += per_cell[:, :, j, i]
    return result.ravel()


def _assemble_band(blocks: Array, n_v: int, n_u: int, degree: int) -> Array:
    """Add the matrices of all cells into the lower band of the whole matrix."""
    width = n_u + degree
    size = (n_v + degree) * width
    half = degree * width + degree
    band = np.zeros((half + 1, size))
    k = degree + 1
    per_cell = blocks.reshape(n_v, n_u, k, k, k, k)
    for j in range(k):
        for i in range(k):
            for jj in range(j, k):
                for ii in range(i if jj == j else 0, k):
                    distance = (jj - j) * width + (ii - i)
                    line = band[distance].reshape(n_v + degree, width)
                    line[j : j + n_v, i : i + n_u] += per_cell[:, :, j, i, jj, ii]
    return band


def _add_smoothness(band: Array, n_v: int, n_u: int, weight: float) -> None:
    """Add `weight` times the squared third differences of the coefficients along both axes."""
    stencil = np.array([-1.0, 3.0, -3.0, 1.0])
    lines = band[:, : n_v * n_u]
    for a in range(4):
        for b in range(a, 4):
            value = weight * stencil[a] * stencil[b]
            if n_u > 3:
                lines[b - a].reshape(n_v, n_u)[:, a : n_u - 3 + a] += value
            if n_v > 3:
                lines[(b - a) * n_u].reshape(n_v, n_u)[a : n_v - 3 + a, :] += value
