"""Where further points would tell most about the motion that is known worst.

Least squares gives every point the same weight. With ``A = J^T J`` and S the covariance of ``J^T e`` the
motions have the covariance ``A^-1 S A^-1``, whatever the errors e have in common. Points at a place that
answers a motion x by ``j . x`` add to both; the inverse follows by the formula of Sherman and Morrison (1950,
doi 10.1214/aoms/1177729893). Places are chosen one after the other, each for the largest drop in the
variance of the motion that is weakest by then. Source: Atkinson, Donev and Tobias, "Optimum experimental
designs, with SAS", 2007, chapter 10 (c-, D- and E-optimality).
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

BEYOND: Final = 100.0
"""A place tells a free motion if it answers it with this many times the mean square of the measured ones."""
_TIE: Final = 1e-9
"""Candidates within this share of the best are as good as the best."""


class Sums(NamedTuple):
    """What least squares has summed up so far."""

    inverse: Array
    """``A^-1``, shape (6, 6)."""
    score: Array
    """``S``, the covariance of ``J^T e``, shape (6, 6)."""

    def variance(self, motion: Array) -> float:
        """Return the variance of a motion of shape (6,)."""
        pull = self.inverse @ motion
        return float(pull @ self.score @ pull)

    def with_points(self, row: Array, count: int, variance: float) -> Sums:
        """Return the sums after further points at one place.

        Parameters
        ----------
        row : ndarray, shape (6,)
            How the deviation there answers the motions.
        count : int
            Points at the place.
        variance : float
            Of the mean of their errors.
        """
        pull = self.inverse @ row
        gain = count / (1.0 + count * float(row @ pull))
        return Sums(
            self.inverse - gain * np.outer(pull, pull), self.score + count**2 * variance * np.outer(row, row)
        )


def helpful_places(
    sums: Sums,
    motions: Array,
    rows: Array,
    places_mm: Array,
    *,
    count: int,
    variance: float,
    apart_mm: float,
    guessed: int = 0,
    most: int = 3,
) -> NDArray[np.intp]:
    """Return the candidates that lower the weakest motion most, chosen one after the other.

    Parameters
    ----------
    sums : Sums
        Of the points that are there, in scaled motions.
    motions : ndarray, shape (6, k)
        The motions to be told, one a column.
    rows : ndarray, shape (m, 6)
        How the deviation at each candidate answers the scaled motions.
    places_mm : ndarray, shape (m, 3), mm
    count : int
        Points to be put at a place.
    variance : float
        Of the mean of their errors, mm^2.
    apart_mm : float
        Least distance of two places, mm.
    guessed : int
        How many motions are no more than guessed: so many places are chosen for the largest variance of their
        own deviation (D-optimal), because beside a guess the weakest answer looks as good as the strongest.
    most : int
        Most places.

    Returns
    -------
    ndarray of int, shape (at most `most`,)
        Fewer where no further place lowers the motion that is weakest then.
    """
    chosen: list[int] = []
    left = np.ones(len(rows), dtype=bool)
    while len(chosen) < most and left.any():
        pull = rows @ sums.inverse
        if len(chosen) < guessed:
            value = -np.einsum("ij,jk,ik->i", pull, sums.score, pull)
        else:
            value = _after(sums, motions, rows, count, variance)
        value = np.where(left & (value < np.inf), value, np.inf)
        if not np.isfinite(value.min()):
            break
        # The first of those that are as good but for rounding: a symmetric part has many.
        best = int(np.argmax(value <= value.min() + _TIE * abs(value.min())))
        chosen.append(best)
        sums = sums.with_points(rows[best], count, variance)
        left &= np.linalg.norm(places_mm - places_mm[best], axis=1) > apart_mm
    return np.array(chosen, dtype=np.intp)


def _after(sums: Sums, motions: Array, rows: Array, count: int, variance: float) -> Array:
    """Return the variance of the weakest motion after points at each candidate, infinite where no less."""
    before = [sums.variance(motion) for motion in motions.T]
    weakest = motions[:, int(np.argmax(before))]
    pull = rows @ sums.inverse
    gain = count / (1.0 + count * np.einsum("ij,ij->i", pull, rows))
    after = sums.inverse @ weakest - (gain * (pull @ weakest))[:, None] * pull
    own = np.einsum("ij,ij->i", after, rows)
    value = np.einsum("ij,jk,ik->i", after, sums.score, after) + count**2 * variance * own**2
    return np.where(value < max(before), value, np.inf)


def told_elsewhere(free: Array, values: Array, rows: Array, least: float) -> Array:
    """Return the part of the free motions that some of the candidates could tell.

    A nominal may break its symmetry where nothing was measured.

    Parameters
    ----------
    free : ndarray, shape (6, k)
        Orthonormal free motions, scaled.
    values : ndarray, shape (k,)
        Mean squared answer of the measured points to them.
    rows : ndarray, shape (m, 6)
        How the deviation at each candidate answers the scaled motions.
    least : float
        Least squared answer that counts.

    Returns
    -------
    ndarray, shape (6, j)
        Orthonormal; j = 0 if the symmetry is that of the whole nominal.
    """
    if free.shape[1] == 0 or len(rows) == 0:
        return free[:, :0]
    basis = free @ np.linalg.svd(rows @ free, full_matrices=False)[2].T
    answer = np.max((rows @ basis) ** 2, axis=0)
    told: Array = basis[:, answer > max(least, BEYOND * float(values.max()))]
    return told
