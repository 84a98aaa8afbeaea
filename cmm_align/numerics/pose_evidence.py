"""How much better one placement must fit than another before it may be called the right one.

Two placements of one cloud leave residuals of RMS ``r1 < r2``. Taken as normal errors of unknown size, worth
m independent values, they explain the data with likelihoods in the ratio ``(r2 / r1)^m``. Form error is
smooth, so m is far below the number of points; it follows from the correlation of the residuals over
distance, as ``m = n^2 / sum of squared correlations``. Source: Bayley and Hammersley 1946, "The effective
number of independent observations in an autocorrelated time series", doi 10.2307/2983560, here over a plane.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from cmm_align.numerics.pose_batch import fixed_order

Array = NDArray[np.float64]

ODDS: Final = 1000.0
"""Likelihood ratio that settles a question; below it there is a near tie."""
_SAMPLE: Final = 400
_BINS: Final = 40


def independent_number(places_mm: Array, residual_mm: Array) -> float:
    """Return how many independent values smooth residuals are worth, for the size of their square.

    Parameters
    ----------
    places_mm : ndarray, shape (n, 3), mm
    residual_mm : ndarray, shape (n,), mm

    Returns
    -------
    float
        From 1 to n. Correlations count up to where they first vanish; past that they are chance.
    """
    n = len(residual_mm)
    if n < 3:
        return 1.0
    pick = fixed_order(n)[:_SAMPLE]
    value = residual_mm[pick] - residual_mm[pick].mean()
    variance = float(np.mean(value**2))
    if variance <= 0.0:
        return float(n)
    row, column = np.triu_indices(len(pick), 1)
    chosen = places_mm[pick]
    apart = np.linalg.norm(chosen[row] - chosen[column], axis=1)
    which = np.minimum((apart / max(float(apart.max()), 1e-300) * _BINS).astype(np.intp), _BINS - 1)
    count = np.bincount(which, minlength=_BINS)
    product = np.bincount(which, weights=value[row] * value[column], minlength=_BINS)
    correlation = product / np.maximum(count, 1) / variance
    chance = 2.0 / np.sqrt(np.maximum(count, 1))
    vanished = np.flatnonzero((correlation <= chance) & (count > 0))
    reach = int(vanished[0]) if len(vanished) else _BINS
    pairs = len(row)
    mean_square = float(np.sum(count[:reach] * correlation[:reach] ** 2)) / pairs
    return float(1.0 / (1.0 / n + (1.0 - 1.0 / n) * min(mean_square, 1.0)))


def tie_factor(independent: float) -> float:
    """Return the ratio of two RMS below which neither placement is clearly the better one.

    Parameters
    ----------
    independent : float
        Number of independent values, as from `independent_number`.
    """
    return float(ODDS ** (1.0 / max(independent, 1.0)))


def equal_factor(n: int) -> float:
    """Return the ratio of two RMS below which placements could not be told apart by white noise even.

    Parameters
    ----------
    n : int
        Number of points: no residuals are worth more values than that.
    """
    return tie_factor(float(max(n, 1)))
