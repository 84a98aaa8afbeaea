"""Scattered values onto a regular grid by a local quadratic in a moving window, in one pass.

Every point is reduced once to moments of its cell (the box of one grid step around a node); the
moments of the window follow from those of its cells by the binomial shift, so the cost is
O(points + nodes) whatever the size of the window. The polynomial of each node is then solved for
all nodes at once by elimination with the constant last: the last pivot is the inverse of the
leverage of the value at the node.

Source: local polynomial regression as in W. S. Cleveland, S. J. Devlin, "Locally weighted
regression", J. Am. Stat. Assoc. 83, 1988, doi 10.1080/01621459.1988.10478639, with uniform weights.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import comb
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmm_align.numerics.chunked import in_threads

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Counts = NDArray[np.int64]

MAX_LEVERAGE: Final = 1.0
"""A value is known where its variance is no larger than that of one single point."""

MIN_POINTS_QUADRATIC: Final = 9
"""Six coefficients and three points that check them."""

MIN_POINTS_LINEAR: Final = 4
"""Three coefficients and one point that checks them."""

_MIN_PIVOT: Final = 1e-10
"""A pivot below this share of its diagonal is rounding: the direction is not determined."""

_PRIOR_FREEDOM: Final = 20.0
"""Weight, in degrees of freedom, of the scatter of the whole map against that of one window."""

_CHUNK: Final = 1 << 18
"""Points reduced at a time."""

_NODES_AT_ONCE: Final = 8192
"""Nodes solved at a time: their moments stay in cache."""

EXPONENTS: Final = [(i, d - i) for d in range(5) for i in range(d, -1, -1)]
"""Exponents of the 15 monomials u^a v^b up to degree 4; the first 6 are the quadratic ones."""

INDEX: Final = {exponents: k for k, exponents in enumerate(EXPONENTS)}

_LINEAR: Final = [(1, 0), (0, 1), (0, 0)]
_QUADRATIC: Final = [(1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (0, 0)]


@dataclass(frozen=True, slots=True)
class LocalFit:
    """A field on the nodes of a grid, each array of shape (ny, nx), indexed [iy, ix].

    Attributes
    ----------
    value : ndarray
        Value of the local polynomial at the node, unit of the values; NaN where unknown.
    sigma : ndarray
        Standard uncertainty of `value` from the scatter of the points, same unit; NaN where unknown.
    leverage : ndarray
        Variance of `value` over the variance of one point; inf where undetermined.
    count : ndarray of int64
        Points in the window.
    quadratic : ndarray of bool
        Where the local polynomial was quadratic; linear elsewhere.
    scatter : float
        Standard deviation of a single point about the local polynomials, median over the nodes;
        NaN if no window holds more points than coefficients.
    powers : ndarray, shape (15, ny + 2 reach, nx + 2 reach)
        Sums of ``u^a v^b`` over the points of each cell about its middle, in steps: `EXPONENTS`. The cells
        in reach of the border are among them.
    slope : ndarray, shape (2, ny, nx)
        Derivatives of the local polynomial along x and y at the node, per unit of length; NaN where unknown.
    slope_covariance : ndarray, shape (3, ny, nx)
        Variances of `slope` along x and along y and their covariance, from the scatter; NaN where unknown.
    """

    value: Array
    sigma: Array
    leverage: Array
    count: Counts
    quadratic: Mask
    scatter: float
    powers: Array
    slope: Array
    slope_covariance: Array


class Moments(NamedTuple):
    """Sums over points, per cell or per window."""

    powers: Array
    """Sum of u^a v^b, shape (15, ny, nx)."""
    products: Array
    """Sum of value u^a v^b up to degree 2, and of value^2, shape (7, ny, nx)."""


class _Solution(NamedTuple):
    """Local polynomials of one degree, each array of shape (ny, nx)."""

    value: Array
    leverage: Array
    squares: Array
    freedom: Array
    slope: Array
    """Shape (2, ny, nx), per step of the grid."""
    slope_leverage: Array
    """Variances and covariance of `slope` over the variance of one point, shape (3, ny, nx)."""


def local_regression(
    x: Array, y: Array, values: Array, x_nodes: Array, y_nodes: Array, *, half_width: float = 1.5
) -> LocalFit:
    """Return local quadratic (or else linear) estimates of a scattered field at the nodes of a grid.

    A node is known where (1) its value is determined with a leverage of at most 1, and (2) its own
    cell holds a point, or two opposite neighbours of that cell do, so that the node lies between
    points. Nothing is extrapolated past that: holes stay holes.

    Parameters
    ----------
    x, y : ndarray, shape (N,)
        Places of the points, any unit of length.
    values : ndarray, shape (N,)
        The field at the points, finite.
    x_nodes, y_nodes : ndarray, shape (nx,), (ny,), at least 2 each
        Evenly spaced, ascending; unit of `x` and `y`.
    half_width : float
        Half width of the square window in grid steps; rounded down to m + 1/2 with m >= 1.

    Returns
    -------
    LocalFit
        A quadratic is reproduced to rounding everywhere, the border included.
    """
    reach = reach_of(half_width)
    u = (x - x_nodes[0]) / (x_nodes[1] - x_nodes[0])
    v = (y - y_nodes[0]) / (y_nodes[1] - y_nodes[0])
    offset = float(np.mean(values)) if len(values) else 0.0
    shape = (len(y_nodes) + 2 * reach, len(x_nodes) + 2 * reach)
    cells = _cell_moments(u + reach, v + reach, values - offset, shape)
    ny, nx = len(y_nodes), len(x_nodes)
    value, leverage, squares, freedom = (np.empty((ny, nx)) for _ in range(4))
    slope, slope_leverage = np.empty((2, ny, nx)), np.empty((3, ny, nx))
    fields = (value, leverage, squares, freedom, slope, slope_leverage)
    count, curved = np.empty((ny, nx), dtype=np.int64), np.empty((ny, nx), dtype=np.bool_)

    def solve(rows: slice) -> None:
        window = window_moments(
            Moments(*(part[:, rows.start : rows.stop + 2 * reach] for part in cells)), reach
        )
        quadratic = _solved(window, _QUADRATIC, MIN_POINTS_QUADRATIC)
        linear = _solved(window, _LINEAR, MIN_POINTS_LINEAR)
        curved[rows] = quadratic.leverage <= MAX_LEVERAGE
        count[rows] = window.powers[0]
        for whole, one, other in zip(fields, quadratic, linear, strict=True):
            whole[..., rows, :] = np.where(curved[rows], one, other)

    in_threads(solve, ny, rows_at_once(nx))
    rim = slice(reach - 1, 1 - reach or None)
    known = _supported(cells.powers[0, rim, rim] > 0.0) & (leverage <= MAX_LEVERAGE)
    scatter, variance = _pooled_variance(squares, freedom, known)
    steps = np.array([x_nodes[1] - x_nodes[0], y_nodes[1] - y_nodes[0]])[:, None, None]
    areas = np.stack([steps[0] ** 2, steps[1] ** 2, steps[0] * steps[1]])
    return LocalFit(
        value=np.where(known, value + offset, np.nan),
        sigma=np.where(known, np.sqrt(variance * np.where(known, leverage, 0.0)), np.nan),
        leverage=leverage,
        count=count,
        quadratic=curved & known,
        scatter=scatter,
        powers=cells.powers,
        slope=np.where(known, slope / steps, np.nan),
        slope_covariance=np.where(known, variance * np.where(known, slope_leverage, 0.0) / areas, np.nan),
    )


def reach_of(half_width: float) -> int:
    """Return how many cells a window holds on either side of its middle one."""
    return max(1, int(half_width))


def rows_at_once(nx: int) -> int:
    """Return how many rows of a grid are handled at a time."""
    return max(1, _NODES_AT_ONCE // nx)


def _cell_moments(u: Array, v: Array, values: Array, shape: tuple[int, int]) -> Moments:
    """Return moments about the centre of each cell; points outside all cells are left out."""
    ny, nx = shape
    powers = np.zeros((len(EXPONENTS), ny * nx))
    products = np.zeros((7, ny * nx))
    for start in range(0, len(u), _CHUNK):
        part = slice(start, start + _CHUNK)
        ix, iy = np.rint(u[part]), np.rint(v[part])
        inside = (ix >= 0) & (ix < nx) & (iy >= 0) & (iy < ny)
        ix, iy, z = ix[inside], iy[inside], values[part][inside]
        cell = (iy * nx + ix).astype(np.intp)
        p, q = u[part][inside] - ix, v[part][inside] - iy
        p_powers, q_powers = [np.ones_like(p), p], [np.ones_like(q), q]
        for _ in range(3):
            p_powers.append(p_powers[-1] * p)
            q_powers.append(q_powers[-1] * q)
        for k, (a, b) in enumerate(EXPONENTS):
            weight = p_powers[a] * q_powers[b]
            powers[k] += np.bincount(cell, weight, ny * nx)
            if k < 6:
                products[k] += np.bincount(cell, weight * z, ny * nx)
        products[6] += np.bincount(cell, z * z, ny * nx)
    return Moments(powers.reshape(-1, ny, nx), products.reshape(-1, ny, nx))


def window_moments(cells: Moments, reach: int) -> Moments:
    """Return moments of the square windows of ``2 reach + 1`` cells, about their middle nodes.

    Parameters
    ----------
    cells : Moments
        Of the cells of the nodes and those in reach around them.
    reach : int
        See `reach_of`.
    """
    powers, products = cells
    for axis, along in ((1, (0, 1)), (2, (1, 0))):
        n = powers.shape[axis] - 2 * reach
        sums = [np.zeros(1)] * 2
        for step in range(-reach, reach + 1):
            shift = shift_matrix((step * along[0], step * along[1]))
            shift_products = np.eye(7)
            shift_products[:6, :6] = shift[:6, :6]
            index = np.arange(reach + step, reach + step + n)
            sums[0] = sums[0] + np.tensordot(shift, powers.take(index, axis), 1)
            sums[1] = sums[1] + np.tensordot(shift_products, products.take(index, axis), 1)
        powers, products = sums
    return Moments(powers, products)


def shift_matrix(step: tuple[int, int]) -> Array:
    """Return the matrix, shape (15, 15), that gives moments about a point `step` cells away.

    ``(u + s)^a (v + t)^b = sum C(a, i) s^(a-i) C(b, j) t^(b-j) u^i v^j``.
    """
    matrix = np.zeros((len(EXPONENTS), len(EXPONENTS)))
    for row, (a, b) in enumerate(EXPONENTS):
        for i in range(a + 1):
            for j in range(b + 1):
                matrix[row, INDEX[i, j]] = comb(a, i) * step[0] ** (a - i) * comb(b, j) * step[1] ** (b - j)
    return matrix


def _solved(window: Moments, terms: list[tuple[int, int]], min_points: int) -> _Solution:
    """Return the constants of least-squares polynomials by elimination with the constant last."""
    n = len(terms)
    a = [
        [window.powers[INDEX[i[0] + j[0], i[1] + j[1]]].copy() for j in terms[: k + 1]]
        for k, i in enumerate(terms)
    ]
    b = [window.products[INDEX[i]].copy() for i in terms]
    count = window.powers[0]
    sound = count >= min_points
    explained = np.zeros_like(count)
    pivot = np.ones_like(count)
    for k in range(n):
        diagonal = window.powers[INDEX[2 * terms[k][0], 2 * terms[k][1]]]
        sound &= a[k][k] > _MIN_PIVOT * diagonal
        pivot = np.where(sound, a[k][k], 1.0)
        explained += b[k] ** 2 / pivot
        for i in range(k + 1, n):
            factor = a[i][k] / pivot
            b[i] -= factor * b[k]
            for j in range(k + 1, i + 1):
                a[i][j] -= factor * a[j][k]
    slope, leverage = _slopes(a, b, sound)
    return _Solution(
        np.where(sound, b[-1] / pivot, np.nan),
        np.where(sound, 1.0 / pivot, np.inf),
        np.maximum(window.products[6] - explained, 0.0),
        np.maximum(count - n, 0.0),
        slope,
        leverage,
    )


def _slopes(a: list[list[Array]], b: list[Array], sound: Mask) -> tuple[Array, Array]:
    """Return the two linear coefficients, which come first, and their covariance over that of a point.

    After the elimination ``a[i][k]`` (i > k) holds the factor times the pivot ``a[k][k]``: with the unit
    lower triangle L and the pivots P of the normal matrix the rest is two triangular solves.
    """
    n = len(b)
    pivots = [np.where(sound, a[k][k], 1.0) for k in range(n)]
    solved: dict[int, Array] = {}
    for k in range(n - 1, -1, -1):
        rest = b[k].copy()
        for i in range(k + 1, n):
            rest -= a[i][k] * solved[i]
        solved[k] = rest / pivots[k]
    columns = []  # of the inverse of L: the covariance is their products over the pivots
    for start in (0, 1):
        column = {start: np.ones_like(pivots[0])}
        for i in range(start + 1, n):
            column[i] = np.zeros_like(pivots[0])
            for k in range(start, i):
                column[i] -= a[i][k] / pivots[k] * column[k]
        columns.append(column)
    products = [
        sum(columns[p][k] * columns[q][k] / pivots[k] for k in range(max(p, q), n))
        for p, q in ((0, 0), (1, 1), (0, 1))
    ]
    return np.stack([solved[0], solved[1]]), np.stack([np.where(sound, p, np.inf) for p in products])


def _supported(occupied: Mask) -> Mask:
    """Return whether the own cell of a node holds a point, or two opposite neighbours of it do.

    Parameters
    ----------
    occupied : ndarray of bool, shape (ny + 2, nx + 2)
        Cells with points, those around the grid included.

    Returns
    -------
    ndarray of bool, shape (ny, nx)
        True where some point, or the line between two points, passes the node within one cell.
    """
    result = occupied[1:-1, 1:-1].copy()
    for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
        ny, nx = result.shape
        ahead = occupied[1 + dy : 1 + dy + ny, 1 + dx : 1 + dx + nx]
        behind = occupied[1 - dy : 1 - dy + ny, 1 - dx : 1 - dx + nx]
        result |= ahead & behind
    return result


def _pooled_variance(squares: Array, freedom: Array, known: Mask) -> tuple[float, Array]:
    """Return the scatter of single points over the whole map, and their variance window by window.

    The median over the windows (freed of the skew of chi-square by Wilson and Hilferty, 1931) is not
    moved by a few bad windows; each window's own variance is drawn towards it.
    """
    counted = known & (freedom > 0.0)
    if not counted.any():
        return np.nan, np.full_like(squares, np.nan)
    nu = freedom[counted]
    common = float(np.median(squares[counted] / nu / (1.0 - 2.0 / (9.0 * nu)) ** 3))
    return common**0.5, (squares + _PRIOR_FREEDOM * common) / (freedom + _PRIOR_FREEDOM)
