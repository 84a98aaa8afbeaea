"""Least squares where the errors of neighbours are alike, with a fair price on every column.

Values at n places are ``v = X a + C c + f + noise``. X holds columns that are always in the model, C a
choice of the candidates, f a field nobody asked for: form error. It may be rough, with the covariance ``(1
+ r) exp(-r)``, ``r = sqrt(3) d / length`` (Matern, index 3/2), or smooth, ``exp(-d^2 / 2 length^2)``, mean
over its length and all longer ones: a form error with short waves and no long ones is not to be counted on.
The noise is white; both are relative to one variance s^2. Neither kind nor length of the field nor the
share of the noise is known, so everything is computed on a net of them, pure noise among it, and averaged
with the probability of the data as weight. With K the covariance at one node of the net, N = n - rank X, q
columns chosen, G and b their normal matrix and right-hand side and E the square of the values, all in K^-1
and less their parts in X,

    log p = -1/2 (log|K| + log|X'K^-1 X|) + q/2 log k - 1/2 log|G + k| + log Gamma(N/2)
            - N/2 log((E - b'(G + k)^-1 b) / 2),                                                       (1)

the restricted likelihood with s^2 integrated out and a prior on c, which is as wide as the values
themselves: with columns and values scaled to a mean square of 1, ``k`` is s^2. A column that explains no
more than chance would makes p smaller. Coefficients are those of generalised least squares, without the
prior; their covariance is the mean of that at each node plus the scatter of the coefficients between nodes.

Sources: Patterson and Thompson 1971, doi 10.1093/biomet/58.3.545 (restricted likelihood); Kass and Raftery
1995, doi 10.1080/01621459.1995.10476572 (what odds mean); Stein 1999, ISBN 0-387-98629-4 (the covariance).
"""

from __future__ import annotations

from collections.abc import Sequence
from math import lgamma
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ROUGH: Final = (0.05, 0.1, 0.2, 0.4, 0.8)
"""Lengths of a rough field that are tried, over the extent of the places."""
SMOOTH: Final = (0.1, 0.2, 0.4, 0.8)
"""The same of a smooth one."""
NOISE: Final = tuple(10.0**k for k in range(-7, 2))
"""Variance of the noise over that of the field; pure noise comes on top."""
TOLD: Final = 1e-3
"""Share of a column that must be left beside the columns that are always there."""
_RIDGE: Final = 1e-12
"""Share of the diagonal that keeps columns which are alike apart: their variance is huge, not infinite."""
_ROUNDING: Final = 1e-20
"""Floor of a mean square over that of the values: they are not known better."""


class Tables(NamedTuple):
    """Normal matrices of all columns on the net of covariances, without what is always there."""

    gram: Array
    """Shape (nodes, m + 1, m + 1), columns scaled to a mean square of 1; the last is the values."""
    log_start: Array
    """Shape (nodes,): what (1) has before any column, and the prior of the node."""
    freedom: int
    """N."""
    scale: Array
    """Shape (m,): coefficients in the units asked for are those of the scaled columns times this."""
    told: NDArray[np.bool_]
    """Shape (m,): columns that are more than a mixture of those that are always there."""
    length: Array
    """Shape (nodes,): length of the field; 0 for pure noise."""


class Fit(NamedTuple):
    """One choice of columns."""

    log_evidence: float
    coefficients: Array
    """Shape (q,)."""
    covariance: Array
    """Shape (q, q)."""
    length: float
    """Median length of the field that is left; 0 if it is most likely noise alone."""


def tables(places: Array, counts: Array, always: Array, columns: Array, values: Array) -> Tables:
    """Return what all choices of columns are fitted from.

    Parameters
    ----------
    places : ndarray, shape (n, d)
        Where the values belong.
    counts : ndarray, shape (n,)
        How many independent readings each is the mean of.
    always : ndarray, shape (n, p)
        Columns of every model; may depend on each other.
    columns : ndarray, shape (n, m)
        The candidates.
    values : ndarray, shape (n,)

    Returns
    -------
    Tables
    """
    root = np.sqrt(counts / counts.mean())[:, None]
    u, s, _ = np.linalg.svd(always * root, full_matrices=False)
    base = u[:, s > 1e-10 * s.max(initial=0.0)]
    everything = np.hstack([base, columns * root, (values * root[:, 0])[:, None]])
    p, n = base.shape[1], len(values)
    grams, logs, lengths = [everything.T @ everything], [np.log(1.0 / (len(NOISE) + 1))], [0.0]
    extent = float(np.linalg.norm(np.ptp(places, axis=0)))
    fields = _fields(np.linalg.norm(places[:, None] - places, axis=2) / extent)
    for length, common in fields:
        field, vectors = np.linalg.eigh(common * (root * root.T))
        turned = vectors.T @ everything
        for noise in NOISE:
            spread = np.maximum(field, 0.0) + noise
            grams.append(turned.T @ (turned / spread[:, None]))
            logs.append(-0.5 * float(np.log(spread).sum()) - np.log(len(fields) * (len(NOISE) + 1)))
            lengths.append(length * extent)
    gram, log_start = np.array(grams), np.array(logs)
    square = np.diag(gram[0])[p:].copy()
    log_start -= 0.5 * np.linalg.slogdet(gram[:, :p, :p])[1]
    gram = gram[:, p:, p:] - gram[:, p:, :p] @ np.linalg.solve(gram[:, :p, :p], gram[:, :p, p:])
    left = np.maximum(np.diag(gram[0]), 0.0)
    told = left[:-1] > TOLD**2 * square[:-1]
    rms = np.sqrt(np.where(left > 0.0, left, 1.0) / n)
    gram = gram / (rms[:, None] * rms)
    return Tables(gram, log_start, n - p, rms[-1] / rms[:-1], told, np.array(lengths))


def _fields(distance: Array) -> list[tuple[float, Array]]:
    """Return length and covariance of every field that is tried; distances are over the extent."""
    fields = []
    for length in ROUGH:
        r = distance * (np.sqrt(3.0) / length)
        fields.append((length, (1.0 + r) * np.exp(-r)))
    longer = np.zeros_like(distance)
    for count, length in enumerate(sorted(SMOOTH, reverse=True), start=1):
        longer = longer + np.exp(-0.5 * (distance / length) ** 2)
        fields.append((length, longer / count))
    return fields


def fit(found: Tables, chosen: Sequence[int]) -> Fit:
    """Return the fit of a choice of columns.

    Parameters
    ----------
    found : Tables
    chosen : sequence of int
        Columns; none is a choice too.

    Returns
    -------
    Fit
        In the units of values over columns.
    """
    pick, q = np.asarray(chosen, dtype=np.intp), len(chosen)
    matrix = found.gram[:, pick[:, None], pick]
    pull, square = found.gram[:, pick, -1], found.gram[:, -1, -1]
    floor = _ROUNDING * square
    inverse = np.linalg.inv(matrix + _RIDGE * np.einsum("gii->gi", matrix)[:, None, :] * np.eye(q))
    scaled = np.einsum("gij,gj->gi", inverse, pull)
    rest = np.maximum(square - np.einsum("gi,gi->g", scaled, pull), floor)
    variance = rest / (found.freedom - q)
    held = matrix + variance[:, None, None] * np.eye(q)
    explained = np.einsum("gi,gi->g", np.linalg.solve(held, pull[..., None])[..., 0], pull)
    half = 0.5 * found.freedom
    log_p = (
        found.log_start
        + 0.5 * q * np.log(variance)
        - 0.5 * np.linalg.slogdet(held)[1]
        + lgamma(half)
        - half * np.log(0.5 * np.maximum(square - explained, floor))
    )
    top = float(log_p.max())
    log_evidence = top + float(np.log(np.exp(log_p - top).sum()))
    weight = np.exp(log_p - log_evidence)
    mean = weight @ scaled
    apart = scaled - mean
    covariance = np.einsum("g,gij->ij", weight * variance, inverse) + (weight[:, None] * apart).T @ apart
    units = found.scale[pick]
    order = np.argsort(found.length, kind="stable")
    middle = int(np.searchsorted(np.cumsum(weight[order]), 0.5))
    length = float(found.length[order[min(middle, len(order) - 1)]])
    return Fit(log_evidence, mean * units, covariance * np.outer(units, units), length)
