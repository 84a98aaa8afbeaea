"""The noise of single values, told by neighbours that lie nearest to each other.

Values about a smooth map scatter for two reasons: noise, and waves that the map does not carry. The nearer
two points lie, the less the second counts in their difference: half the mean square difference of nearest
neighbours tends to the variance of the noise alone (the nugget of a variogram; Matheron 1963, doi
10.2113/gsecongeo.58.8.1246; in regression Gasser, Sroka, Jennen-Steinmetz 1986, doi
10.1093/biomet/73.3.625). Its median serves, so that a scratch counts as form and not as noise.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MEDIAN_CHI2: Final = 0.454936
"""Median of chi-square with one degree of freedom."""
MEDIAN_SPREAD: Final = 2.333
"""Standard deviation of the median of n such squares over their median m, times the root of n:
``1 / (2 m f(m))`` with the density f."""
FEWEST_PAIRS: Final = 30
_BLOCK: Final = 400
"""Points in a block of neighbours."""
_BLOCKS: Final = 48
"""Blocks looked at where there are more points: enough for 3 % of the noise."""


class Noise(NamedTuple):
    """Noise of single values."""

    sd: float
    """Standard deviation, unit of the values; NaN where too few neighbours tell."""
    relative_u: float
    """Standard uncertainty of its square, as a share of it."""


def neighbour_noise(x: Array, y: Array, residual: Array) -> Noise:
    """Return the noise in residuals from a smooth map.

    Parameters
    ----------
    x, y : ndarray, shape (N,)
        Places, one unit of length.
    residual : ndarray, shape (N,)
        Values less the map at their places, any unit, finite.

    Returns
    -------
    Noise
        Unknown with fewer than 30 points. White noise is found to 2 % with 20 000 points (tested).
    """
    if len(x) < FEWEST_PAIRS:
        return Noise(float("nan"), float("nan"))
    d = _pair_differences(x, y, residual)
    square = float(np.median(d**2)) / (2.0 * MEDIAN_CHI2)
    return Noise(square**0.5, MEDIAN_SPREAD / len(d) ** 0.5)


def near_sample(x: Array, y: Array) -> NDArray[np.int64]:
    """Return at most some 20 000 points that lie together in blocks, spread evenly over all of them.

    Parameters
    ----------
    x, y : ndarray, shape (N,)
        Places, one unit of length.

    Returns
    -------
    ndarray of int64, shape (k,)
        Their rows: an even sample would part neighbours.
    """
    n = len(x)
    if n <= _BLOCK * _BLOCKS:
        return np.arange(n)
    side = max(float(np.sqrt(np.ptp(x) * np.ptp(y) * _BLOCK / n)), 1e-300)
    columns = ((x - x.min()) / side).astype(np.int64)
    rows = ((y - y.min()) / side).astype(np.int64)
    cell = rows * (int(columns.max()) + 1) + columns
    full = np.flatnonzero(np.bincount(cell) > _BLOCK // 4)
    chosen = full[np.unique(np.linspace(0, len(full) - 1, _BLOCKS).astype(np.int64))] if len(full) else full
    taken = np.zeros(int(cell.max()) + 1, dtype=np.bool_)
    taken[chosen] = True
    return np.flatnonzero(taken[cell])


def _pair_differences(x: Array, y: Array, residual: Array) -> Array:
    """Return differences of nearest neighbours, each pair once."""
    from scipy.spatial import cKDTree  # slow to import

    places = np.stack([x, y], axis=1)
    nearest = np.asarray(cKDTree(places).query(places, k=2)[1])
    first = np.arange(len(x))
    other = np.where(nearest[:, 1] == first, nearest[:, 0], nearest[:, 1])  # coincident points swap places
    pairs = np.unique(np.sort(np.stack([first, other], axis=1), axis=1), axis=0)
    return np.asarray(residual[pairs[:, 0]] - residual[pairs[:, 1]], dtype=np.float64)
