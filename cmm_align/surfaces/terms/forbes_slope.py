"""The slope-orthogonal polynomials of Forbes, by way of simpler ones with a three-term recurrence.

Sources: G. W. Forbes, Opt. Express 18, 19700 (2010), doi 10.1364/OE.18.019700 ("2010"), for m = 0, and
Opt. Express 20, 2483 (2012), doi 10.1364/OE.20.002483 ("2012"), for m > 0. In both, Q_n follows from
auxiliary P_n by ``P_n = f_n Q_n + g_{n-1} Q_{n-1} + h_{n-2} Q_{n-2}``, h being zero for m > 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from math import factorial, prod, sqrt

from cmm_align.surfaces.protocol import Array
from cmm_align.surfaces.terms.recurrence import Step, combine, tabulate


def slope_sums(m: int, rows: Sequence[Sequence[float]], v: Array) -> list[Array]:
    """Return ``sum_n c_n Q_n^m(v)`` of several rows of coefficients.

    Parameters
    ----------
    m : int
        Azimuthal order; 0 gives the polynomials of Q_bfs.
    rows : sequence of sequence of float
        Coefficients c_0, c_1 ... , at least one in a row.
    v : Array
        Squared normalised radius, shape (n,).

    Returns
    -------
    list of Array
        Each of shape (3, n): value, first and second derivative by v.
    """
    count = max(len(row) for row in rows)
    f, g, h = _rotational_bands(count) if m == 0 else _azimuthal_bands(m, count)
    first, steps = (2.0, _rotational_steps(count - 1)) if m == 0 else (0.5, _azimuthal_steps(m, count - 1))
    table = tabulate(first, steps, v)
    return [combine(_auxiliary(row, f, g, h), table[:, : len(row)]) for row in rows]


def _auxiliary(row: Sequence[float], f: list[float], g: list[float], h: list[float]) -> list[float]:
    """Return the coefficients over P of the same sum over Q, by back substitution."""
    b = [*row, 0.0, 0.0]
    for n in range(len(row) - 1, -1, -1):
        b[n] = (row[n] - g[n] * b[n + 1] - h[n] * b[n + 2]) / f[n]
    return b[: len(row)]


def _rotational_steps(count: int) -> list[Step]:
    """Return the recurrence from ``P_0 = 2``: ``P_1 = 6 - 8 v``, then 2010, eq. 2.6."""
    return [Step(2.0 if k else 3.0, -4.0, 1.0 if k else 0.0) for k in range(count)]


def _rotational_bands(count: int) -> tuple[list[float], list[float], list[float]]:
    """Return f, g and h (2010, eq. A.14 to A.16)."""
    f, g, h = [2.0, sqrt(19.0) / 2.0], [-0.5], [-0.5]
    for n in range(2, count + 2):
        if n > 2:
            h.append(-n * (n - 1) / (2.0 * f[n - 2]))  # A.14
        g.append(-(1.0 + g[n - 2] * h[n - 2]) / f[n - 1])  # A.15
        f.append(sqrt(n * (n + 1) + 3.0 - g[n - 1] ** 2 - h[n - 2] ** 2))  # A.16
    return f, g, h


def _azimuthal_steps(m: int, count: int) -> list[Step]:
    """Return the recurrence from ``P_0 = 1/2`` (2012, eq. A.3)."""
    # The general formula has no meaning for P_1, and for P_2 and P_3 if m = 1: their steps follow from
    # P_1 = m - 1/2 - (m - 1) v, and for m = 1 from P_1 = 1 - v/2, P_2 = (3 - 12 v + 8 v^2) / 6 and
    # P_3 = (5 - 60 v + 120 v^2 - 64 v^3) / 10.
    first = [Step(2.0 * m - 1.0, -2.0 * (m - 1.0), 0.0)]
    if m == 1:
        first = [Step(2.0, -1.0, 0.0), Step(-4 / 3, -8 / 3, -11 / 3), Step(9 / 5, -24 / 5, 0.0, -2 / 5)]
    steps = first[:count]
    for n in range(len(first), count):
        d = (4 * n * n - 1) * (m + n - 2) * (m + 2 * n - 3)
        a = (2 * n - 1) * (m + 2 * n - 2) * (4 * n * (m + n - 2) + (m - 3) * (2 * m - 1))
        b = -2 * (2 * n - 1) * (m + 2 * n - 3) * (m + 2 * n - 2) * (m + 2 * n - 1)
        c = n * (2 * n - 3) * (m + 2 * n - 1) * (2 * m + 2 * n - 3)
        steps.append(Step(a / d, b / d, c / d))
    return steps


def _azimuthal_bands(m: int, count: int) -> tuple[list[float], list[float], list[float]]:
    """Return f and g (2012, eq. A.18), and zeros for h."""
    f: list[float] = [sqrt(_big_f(m, 0))]
    g: list[float] = []
    for n in range(1, count + 1):
        g.append(_big_g(m, n - 1) / f[n - 1])
        f.append(sqrt(_big_f(m, n) - g[n - 1] ** 2))
    return f, g, [0.0] * count


def _big_f(m: int, n: int) -> Fraction:
    """Return F: the mean square slope of P_n (2012, eq. A.13); exact."""
    if n == 0:
        return Fraction(m * m * _odd_factorial(2 * m - 3), 2 ** (m + 1) * factorial(m - 1))
    if m == 1:
        value = Fraction(4 * (n - 1) ** 2 * n * n + 1, 8 * (2 * n - 1) ** 2)
        return value + (Fraction(11, 32) if n == 1 else 0)
    chi = n * (m + n - 2)
    above = 2 * chi * (3 - 5 * m + 4 * chi) + m * m * (3 - m + 4 * chi)
    below = (m + 2 * n - 3) * (m + 2 * n - 2) * (m + 2 * n - 1) * (2 * n - 1)
    return Fraction(above, below) * _gamma(m, n)


def _big_g(m: int, n: int) -> Fraction:
    """Return G: the mean product of the slopes of P_n and P_{n+1} (2012, eq. A.15); exact."""
    if n == 0:
        return Fraction(_odd_factorial(2 * m - 1), 2 ** (m + 1) * factorial(m - 1))
    if m == 1:
        value = Fraction(-(2 * n * n - 1) * (n * n - 1), 8 * (4 * n * n - 1))
        return value - (Fraction(1, 24) if n == 1 else 0)
    above = (2 * n * (m + n - 1) - m) * (n + 1) * (2 * m + 2 * n - 1)
    below = (m + 2 * n - 2) * (m + 2 * n - 1) * (m + 2 * n) * (2 * n + 1)
    return -Fraction(above, below) * _gamma(m, n)


def _gamma(m: int, n: int) -> Fraction:
    """Return ``n! (2m + 2n - 3)!! / (2^(m+1) (m + n - 3)! (2n - 1)!!)``, a factor of F and G."""
    above = factorial(n) * _odd_factorial(2 * m + 2 * n - 3)
    return Fraction(above, 2 ** (m + 1) * factorial(m + n - 3) * _odd_factorial(2 * n - 1))


def _odd_factorial(n: int) -> int:
    """Return ``n!! = n (n - 2) ... 1`` of an odd number; 1 for -1."""
    return prod(range(n, 0, -2))
