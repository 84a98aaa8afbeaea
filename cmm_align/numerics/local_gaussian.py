"""Local polynomials with Gaussian weights, on a grid of weights or through scattered points.

About every place the polynomial of order 0 or 2 is fitted whose weights are ``g(d) = exp(-d^2 / 2)``, d the
distance in standard deviations, and its constant is returned. On a grid the weights of x and y part, so the
moments of all nodes are convolutions along x and then along y. Scattered places are taken a cell at a time:
their moments about its centre are one matrix product, and the binomial shifts them to the places.

Source: local polynomial regression as in J. Fan, I. Gijbels, "Local polynomial modelling and its
applications", 1996, chapter 2.
"""

from __future__ import annotations

from math import comb
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Order = Literal[0, 2]

REACH: Final = 5.0
"""Weights end here, in standard deviations: what lies outside holds 4e-5 of the kernel."""

_MIN_WEIGHT: Final = 1e-6
"""Less than one point at the end of the reach has: nothing there but rounding."""

_MIN_PIVOT: Final = 1e-10
"""A pivot below this share of its diagonal is rounding: the polynomial is not determined."""

_BLOCK: Final = 128
"""Grid columns solved at a time."""

_PAIRS: Final = 1 << 18
"""Pairs of a place and a point weighed at a time."""

_TERMS: Final = {0: [(0, 0)], 2: [(1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (0, 0)]}

_Moments = dict[tuple[int, int], Array]


def gridded_polynomials(
    weights: Array, values: Array, widths: tuple[float, float], order: Order
) -> tuple[Array, Array]:
    """Return the local polynomials at all nodes of a weighted grid.

    Parameters
    ----------
    weights : ndarray, shape (ny, nx)
        Not negative; 0 where nothing is known.
    values : ndarray, shape (ny, nx)
        Any unit; finite, of no effect where the weight is 0.
    widths : pair of float
        Standard deviation of the Gaussian along x and along y, in grid steps.
    order : 0 or 2

    Returns
    -------
    value : ndarray, shape (ny, nx)
        Unit of `values`; NaN where the polynomial is not determined.
    leverage : ndarray, shape (ny, nx)
        The weight in the result of a value of weight one at the node; inf where not determined.
    """
    wide, narrow = 2 * order + 1, order + 1
    along_powers = _sums(weights, widths[0], wide)
    along_products = _sums(weights * values, widths[0], narrow)
    value, leverage = np.empty_like(values), np.empty_like(values)
    for start in range(0, values.shape[1], _BLOCK):
        block = slice(start, start + _BLOCK)
        powers, products = {}, {}
        for a in range(wide):
            sums = _sums(along_powers[a, :, block].T, widths[1], wide - a)
            powers.update({(a, b): sums[b] for b in range(wide - a)})
        for a in range(narrow):
            sums = _sums(along_products[a, :, block].T, widths[1], narrow - a)
            products.update({(a, b): sums[b] for b in range(narrow - a)})
        constants, leverages = _constants(powers, products, order)
        value[:, block], leverage[:, block] = constants.T, leverages.T
    return value, leverage


def scattered_polynomials(
    places: Array, values: Array, at: Array, order: Order
) -> tuple[Array, Array, Array]:
    """Return the local polynomials through scattered points at given places.

    Parameters
    ----------
    places : ndarray, shape (N, 2)
        Of the points, in standard deviations of the Gaussian.
    values : ndarray, shape (N,)
        Any unit, finite.
    at : ndarray, shape (M, 2)
        Where the result is wanted, in standard deviations.
    order : 0 or 2

    Returns
    -------
    value, leverage : ndarray, shape (M,)
        As for `gridded_polynomials`.
    nearest : ndarray, shape (M,)
        Distance to the nearest point, in standard deviations.
    """
    from scipy.spatial import cKDTree

    tree = cKDTree(places)
    nearest, _ = tree.query(at)
    n_powers = len(_exponents(2 * order))
    sums = np.empty((n_powers + len(_exponents(order)), len(at)))
    cell = np.floor(at)
    for members in _runs(cell):
        centre = cell[members[0]] + 0.5
        around = np.sort(tree.query_ball_point(centre, REACH + 0.5**0.5))
        u, v = (places[around] - centre).T
        monomials = np.array([u**a * v**b for a, b in _exponents(2 * order)])
        factors = np.vstack([monomials, monomials[: len(_exponents(order))] * values[around]])
        step = max(_PAIRS // max(len(around), 1), 1)
        for start in range(0, len(members), step):
            part = members[start : start + step]
            p, q = (at[part] - centre).T
            sums[:, part] = factors @ _weights(u[:, None] - p, v[:, None] - q)
    to_place = (at - cell - 0.5).T
    powers = _shifted(dict(zip(_exponents(2 * order), sums, strict=False)), to_place)
    products = _shifted(dict(zip(_exponents(order), sums[n_powers:], strict=True)), to_place)
    value, leverage = _constants(powers, products, order)
    return value, leverage, np.asarray(nearest, dtype=np.float64)


def _exponents(degree: int) -> list[tuple[int, int]]:
    """Return the exponents of x^a y^b up to a degree, low degrees first."""
    return [(d - b, b) for d in range(degree + 1) for b in range(d + 1)]


def _sums(lines: Array, width: float, n_powers: int) -> Array:
    """Return ``sum_j g(d) d^a f_j`` about each node of lines (m, n), for a < n_powers: shape (a, m, n).

    By the fast Fourier transform: its time does not grow with the width, and it starts no threads.
    """
    from scipy.fft import irfft, next_fast_len, rfft

    n = lines.shape[1]
    reach = min(int(REACH * width), n - 1)
    size = next_fast_len(n + reach, real=True)
    steps = np.arange(-reach, reach + 1)
    kernel = np.zeros((n_powers, size))
    kernel[:, steps] = np.exp(-0.5 * (steps / width) ** 2) * (steps / width) ** np.arange(n_powers)[:, None]
    spectrum = rfft(lines, size)
    sums = [irfft(spectrum * np.conj(k), size)[:, :n] for k in rfft(kernel)]
    return np.array(sums)


def _weights(du: Array, dv: Array) -> Array:
    """Return the weights at distances given by their components, which are used up."""
    du *= du
    dv *= dv
    du += dv
    far = du > REACH**2
    du *= -0.5
    np.exp(du, out=du)
    du[far] = 0.0
    return du


def _runs(cells: Array) -> list[NDArray[np.intp]]:
    """Return the indices of the places cell by cell."""
    order = np.lexsort(cells.T)
    changes = np.flatnonzero((np.diff(cells[order], axis=0) != 0.0).any(axis=1)) + 1
    return [run for run in np.split(order, changes) if len(run)]


def _shifted(moments: _Moments, by: Array) -> _Moments:
    """Return moments about places `by`, shape (2, M), from those about the origin of each."""
    x, y = -by
    return {
        (a, b): sum(
            (
                comb(a, i) * comb(b, j) * x ** (a - i) * y ** (b - j) * moments[i, j]
                for i in range(a + 1)
                for j in range(b + 1)
            ),
            np.zeros_like(x),
        )
        for a, b in moments
    }


def _constants(powers: _Moments, products: _Moments, order: Order) -> tuple[Array, Array]:
    """Return the constants of the weighted polynomials and their leverages.

    Elimination with the constant last: the inverse of the last pivot is the leverage.
    """
    terms = _TERMS[order]
    n = len(terms)
    a = [[powers[i[0] + j[0], i[1] + j[1]].copy() for j in terms[: k + 1]] for k, i in enumerate(terms)]
    b = [products[i].copy() for i in terms]
    sound = powers[0, 0] > _MIN_WEIGHT
    pivot = np.ones_like(b[0])
    for k in range(n):
        sound &= a[k][k] > _MIN_PIVOT * powers[2 * terms[k][0], 2 * terms[k][1]]
        pivot = np.where(sound, a[k][k], 1.0)
        for i in range(k + 1, n):
            factor = a[i][k] / pivot
            b[i] -= factor * b[k]
            for j in range(k + 1, i + 1):
                a[i][j] -= factor * a[j][k]
    return np.where(sound, b[-1] / pivot, np.nan), np.where(sound, 1.0 / pivot, np.inf)
