"""Polynomials by their three-term recurrences, with first and second derivatives.

``P_{k+1} = (a_k + b_k x) P_k - c_k P_{k-1} + e_k``; e is zero but for one family of Forbes'.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cmm_align.surfaces.protocol import Array


class Step(NamedTuple):
    """Coefficients of one step of a recurrence."""

    a: float
    b: float
    c: float
    e: float = 0.0


def tabulate(first: float, steps: Sequence[Step], x: Array) -> Array:
    """Return P_0 ... P_K with derivatives.

    Parameters
    ----------
    first : float
        P_0.
    steps : sequence of Step
        K steps.
    x : Array
        Arguments, shape (n,).

    Returns
    -------
    Array, shape (3, K + 1, n)
        Values, first and second derivatives by x.
    """
    table = np.zeros((3, len(steps) + 1, *np.shape(x)))
    p, p1, p2 = table
    p[0] = first
    for k, (a, b, c, e) in enumerate(steps):
        factor = a + b * x
        np.multiply(factor, p[k], out=p[k + 1])
        p1[k + 1] = b * p[k]
        if k > 0:
            p1[k + 1] += factor * p1[k]
            np.multiply(factor, p2[k], out=p2[k + 1])
            p2[k + 1] += (2.0 * b) * p1[k]
        if k > 0 and c != 0.0:
            p[k + 1] -= c * p[k - 1]
            p1[k + 1] -= c * p1[k - 1]
            p2[k + 1] -= c * p2[k - 1]
        if e != 0.0:
            p[k + 1] += e
    return table


def combine(coefficients: Sequence[float], table: Array) -> Array:
    """Return ``sum C_k P_k`` with derivatives, shape (3, n), from a table of shape (3, K + 1, n)."""
    # Row by row: BLAS threads would wait for each other longer than these few products take.
    total = np.zeros((3, *table.shape[2:]))
    product = np.empty_like(total)
    for k, value in enumerate(coefficients):
        if value != 0.0:
            total += np.multiply(value, table[:, k], out=product)
    return total


def dense(pairs: Sequence[tuple[int, float]]) -> list[float]:
    """Return the coefficients 0 ... max as a list, from ``(index, value)`` pairs."""
    row = [0.0] * (max((k for k, _ in pairs), default=-1) + 1)
    for k, value in pairs:
        row[k] = value
    return row


def jacobi_steps(order: int, count: int) -> list[Step]:
    """Return the steps of Jacobi's P_k^(0, order)(2 v - 1), P_0 = 1, in the variable v on [0, 1].

    Notes
    -----
    NIST DLMF 18.9.2 with alpha = 0, beta = order, and the argument 2 v - 1 written out.
    """
    m = order
    steps = []
    for k in range(count):
        below = 2 * (k + 1) * (k + 1 + m)
        slope = (2 * k + m + 1) * (2 * k + m + 2) / below
        level = -(2 * k + m + 1) * m * m / (below * (2 * k + m)) if m else 0.0
        back = 2 * k * (k + m) * (2 * k + m + 2) / (below * (2 * k + m)) if k else 0.0
        steps.append(Step(level - slope, 2.0 * slope, back))
    return steps
