"""The noise of a map's nodes: how alike neighbours err, and how many of them are worth one that errs alone.

Nodes of a local regression share points. Over points spread evenly, the noise of a local quadratic in the
square window of half width h is, as a function of the place, white noise seen through the kernel

    K(u, v) = 1 - 5/2 (P2(u/h) + P2(v/h)),                                                               (1)

P2 being Legendre's polynomial: of the six terms only those of u^2 and v^2 answer at the middle beside the
constant. The autocorrelation of K is the correlation of two nodes, zero from a lag of 2 h on. Its Fourier
transform over a grid says how much noise waves of each length carry, and so what a filter leaves of it; the
number of independent values in it is that of Satterthwaite (Biometrics Bulletin 2, 1946,
doi 10.2307/3002019), ``(sum P)^2 / sum P^2``, the P being independent over the frequencies.

What it does not do: uneven points (scan lines far apart) and borders correlate a little differently.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_MIDDLE: Final = -2.5
"""``5 P2(0)``, the share of P2 in eq. (1)."""
_GAUSS: Final = np.polynomial.legendre.leggauss(3)
"""Exact to degree 5; the products are of degree 4."""


def node_correlation(lag_x: Array, lag_y: Array, *, half_width: float = 1.5) -> Array:
    """Return the correlation of the noise of two nodes of a local quadratic.

    Parameters
    ----------
    lag_x, lag_y : ndarray, shape (nx,), (ny,)
        Distances along x and y, in grid steps.
    half_width : float
        As given to `local_regression`.

    Returns
    -------
    ndarray, shape (ny, nx)
        1 at no distance.
    """
    h = max(1, int(half_width)) + 0.5
    x00, x02, x22 = _overlaps(np.abs(lag_x) / h)
    y00, y02, y22 = _overlaps(np.abs(lag_y) / h)

    def both(along_y: Array, along_x: Array) -> Array:
        return np.asarray(np.outer(along_y, along_x), dtype=np.float64)

    once = both(y00, 2.0 * x02) + both(2.0 * y02, x00)
    twice = both(y00, x22) + 2.0 * both(y02, x02) + both(y22, x00)
    at_zero = 4.0 * (1.0 + 2.0 * _MIDDLE**2 / 5.0)
    return np.asarray((both(y00, x00) + _MIDDLE * once + _MIDDLE**2 * twice) / at_zero, dtype=np.float64)


def noise_power(shape: tuple[int, int], *, half_width: float = 1.5) -> Array:
    """Return how much of the noise of a map falls on each frequency.

    Parameters
    ----------
    shape : tuple of int
        (ny, nx) of the grid.
    half_width : float
        As given to `local_regression`.

    Returns
    -------
    ndarray, shape (ny, nx)
        Mean 1, in the order of `numpy.fft.fft2`: power of that frequency over the mean square of the noise.
    """
    lags = [np.minimum(np.arange(n), n - np.arange(n)).astype(np.float64) for n in shape]
    table = node_correlation(lags[1], lags[0], half_width=half_width)
    power = np.maximum(np.fft.fft2(table).real, 0.0)
    return np.asarray(power / power.mean(), dtype=np.float64)


def without_longest(power: Array, n_shapes: float) -> Array:
    """Return a power without that of the longest waves, as many as smooth shapes were fitted and taken away.

    Parameters
    ----------
    power : ndarray, shape (ny, nx)
        By frequency, in the order of `numpy.fft.fft2`.
    n_shapes : float
        Of the whole grid: polynomials up to some degree, which follow so many waves along x and along y.

    Returns
    -------
    ndarray, shape (ny, nx)
    """
    waves = [np.abs(np.fft.fftfreq(n, 1.0 / n)) for n in power.shape]
    order = np.argsort(np.hypot(waves[1], waves[0][:, None]), axis=None, kind="stable")
    rest = power.copy()
    rest.flat[order[: round(n_shapes)]] = 0.0
    return rest


def effective_number(power: Array, n: int) -> float:
    """Return how many independent values `n` nodes are worth.

    Parameters
    ----------
    power : ndarray, shape (ny, nx)
        Of the noise, by frequency.
    n : int
        Known nodes.
    """
    square = float(np.mean(power**2))
    return n * float(np.mean(power)) ** 2 / square if square > 0.0 else 0.0


def discoveries(p_values: Array, rate: float) -> Mask:
    """Return which of many tests stand out, the share of false ones among them being at most `rate`.

    Parameters
    ----------
    p_values : ndarray, shape (n,)
        Of the tests; they may be positively dependent, as neighbouring nodes are.
    rate : float
        False discovery rate. Where nothing differs at all, it is the chance that any test stands out.

    Returns
    -------
    ndarray of bool, shape (n,)

    Notes
    -----
    Y. Benjamini, Y. Hochberg, J. R. Stat. Soc. B 57, 1995, doi 10.1111/j.2517-6161.1995.tb02031.x; under
    positive dependence: Y. Benjamini, D. Yekutieli, Ann. Stat. 29, 2001, doi 10.1214/aos/1013699998.
    """
    n = len(p_values)
    order = np.sort(p_values)
    passing = np.flatnonzero(order <= rate * np.arange(1, n + 1) / n)
    return np.asarray(p_values <= (order[passing[-1]] if len(passing) else -1.0), dtype=np.bool_)


def _overlaps(lag: Array) -> tuple[Array, Array, Array]:
    """Return the integrals of 1 * 1, 1 * P2 and P2 * P2 over [-1, 1], the second factor moved by a lag >= 0.

    By symmetry ``P2 * 1`` is as large as ``1 * P2``.
    """
    half = np.maximum(1.0 - 0.5 * lag, 0.0)
    u = 0.5 * lag[:, None] + half[:, None] * _GAUSS[0]  # from lag - 1 to 1
    here, there = 1.5 * u**2 - 0.5, 1.5 * (u - lag[:, None]) ** 2 - 0.5
    weight = half[:, None] * _GAUSS[1]
    return weight.sum(axis=1), (weight * here).sum(axis=1), (weight * here * there).sum(axis=1)
