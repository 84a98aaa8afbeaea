"""Least-squares tensor B-splines through scattered points, by structure instead of general sparse algebra.

Every point of a cell sees the same ``(degree + 1)^2`` coefficients, so the normal equations are one small
matrix product a cell, and the whole matrix is banded. 1.2e6 points take about 3 s; a general sparse product
of the same matrix took 37 s.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from cmm_align.errors import NumericsError
from cmm_align.numerics.tensor_spline import basis, cell_of, spline_jet

Array = NDArray[np.float64]

RIDGES: Final = (1e-15, 1e-13, 1e-11)
"""Weights of the smoothness term beside the data, relative, tried in turn until the matrix is positive
definite in rounding: only cells without data feel it."""

_ROWS_PER_BLOCK: Final = 1 << 15


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
    order = np.lexsort((cell_of(u, n_u), cell_of(v, n_v)))
    u, v, z = u[order], v[order], z[order]
    cell = cell_of(v, n_v) * n_u + cell_of(u, n_u)
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
    bu = basis(u - cell_of(u, n_u), degree, derivatives=False)[0].T
    bv = basis(v - cell_of(v, n_v), degree, derivatives=False)[0].T
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
