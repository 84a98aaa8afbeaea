"""What an alignment knows of its pose: covariance, sigma of each motion, free motions.

For errors that are independent from point to point the covariance is ``s^2 (J^T J)^-1``. Form error is not:
its neighbours err alike, and a thousand of them count for few. So the part is cut into blocks, the sums of
``J^T e`` over the blocks are compared with what independent errors would give, and where they are
significantly larger the covariance is made of them instead (a cluster-robust sandwich, never below the simple
one). Blocks are a fifth of the part: errors that are smoother than that still look smaller than they are.
Source: Liang and Zeger 1986, doi 10.1093/biomet/73.1.13.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmm_align.numerics.linearisation import even_sample, moved, rows_of, total_weight
from cmm_align.numerics.observability import Spectrum, uncertain_axes
from cmm_align.numerics.rigid_fit import FitResult
from cmm_align.numerics.steering import FREELY, Steering
from cmm_align.pose import Pose
from cmm_align.surfaces.protocol import Array
from cmm_align.units import UM_PER_MM, URAD_PER_RAD

BLOCKS: Final = 5
"""Blocks along each side."""
SAMPLE: Final = 100_000
"""Points that the blocks are summed over."""
SIGNIFICANT: Final = 4.0
"""Standard deviations by which the block sums must exceed those of independent errors."""


def covariance_of(
    result: FitResult,
    centred: Array,
    length: float,
    part_from_surface: Array,
    steering: Steering = FREELY,
    scale_response: Array | None = None,
    *,
    by_sigma: bool = False,
) -> tuple[Array, bool]:
    """Return the covariance of a small motion about the centroid, frame `part`.

    Parameters
    ----------
    result : FitResult
    centred : ndarray, shape (n, 3), mm
        Measured points about their centroid.
    length : float
        Scale of the rotations, mm.
    part_from_surface : ndarray, shape (3, 3)
    steering : Steering
        With weights w the covariance of independent errors of one variance is
        ``s^2 N^-1 (J^T W^2 J) N^-1``, which is ``s^2 N^-1`` where all are equal.
    scale_response : ndarray, shape (6,), optional
        Motion for one standard uncertainty of a free scale, scaled.
    by_sigma : bool
        Whether the weights are one over the variance of each point: then it is ``s^2 N^-1``, with s^2 the
        weighted mean square.

    Returns
    -------
    covariance : ndarray, shape (6, 6), rad and mm
        Of (rx, ry, rz, tx, ty, tz), on the motions that are neither free nor locked.
    correlated : bool
        Whether it had to be raised for errors that are alike in neighbours.
    """
    keep = ~result.spectral.free
    root = result.spectral.motions[:, keep] / np.sqrt(result.spectral.values[keep])
    used = result.evaluation.used
    n, k = max(int(np.count_nonzero(used)), 1), int(np.count_nonzero(keep))
    squares = result.evaluation.feet.distance_mm[used] ** 2
    if by_sigma and steering.weights is not None:
        weights = steering.weights[used]
        squares = squares * weights / weights.mean()
    variance = float(np.mean(squares)) * n / (n - k) if n > k else 0.0
    share = np.eye(k) / n
    correlated = False
    if variance > 0.0 and k > 0:
        blocks = _block_sums(result, centred, length, steering.weights, by_sigma=by_sigma)
        if steering.weights is not None and not by_sigma:
            middle = blocks.squares * blocks.spread
            if result.evaluation.datum_matrix is not None:  # a datum term has the variance that it weighs by
                middle = middle + result.evaluation.datum_matrix / total_weight(used, steering.weights)
            share = root.T @ middle @ root
        if n > 4 * BLOCKS**2:
            share, correlated = _raised(share, root, blocks, n, variance)
    scaled = root @ share @ root.T * variance
    if scale_response is not None:
        scaled = scaled + np.outer(scale_response, scale_response)
    unscale = np.diag([1.0 / length] * 3 + [1.0] * 3)
    turn = np.kron(np.eye(2), part_from_surface)
    covariance: Array = turn @ unscale @ scaled @ unscale @ turn.T
    return covariance, correlated


class _Blocks(NamedTuple):
    """Sums over the blocks of an even sample, scaled."""

    sums: Array
    """``J^T W e`` of each block over the root of the sum of the weights, shape (6, blocks)."""
    filled: int
    """Blocks with points."""
    squares: Array
    """``J^T W^2 J / sum W^2``, shape (6, 6)."""
    spread: float
    """``sum W^2 / (sum W)^2`` of all points: 1 / n for equal weights."""
    counted: float
    """Points of the sample that weigh as much: ``(sum W)^2 / sum W^2``; all of them for weights by sigma."""


def _raised(share: Array, root: Array, blocks: _Blocks, n: int, variance: float) -> tuple[Array, bool]:
    """Return the shares of the motions, raised where errors of blocks are larger than independent ones."""
    k = len(share)
    low = np.linalg.cholesky(share * n)  # the identity, for equal weights
    whitened = np.linalg.solve(low, root.T @ blocks.sums) / np.sqrt(variance)
    found = whitened @ whitened.T  # also the identity, if errors are independent
    if float(np.trace(found)) / k <= 1.0 + SIGNIFICANT * float(np.sqrt(2.0 / (k * blocks.filled))):
        return share, False
    values, vectors = np.linalg.eigh(found)
    raised: Array = low @ (vectors * np.maximum(values / blocks.counted, 1.0 / n)) @ vectors.T @ low.T
    return raised, True


def _block_sums(
    result: FitResult, centred: Array, length: float, weights: Array | None, *, by_sigma: bool
) -> _Blocks:
    """Sum over the blocks of an even sample: it says as much about neighbours as all points."""
    used = np.flatnonzero(result.evaluation.used)
    pick = used[even_sample(len(used), SAMPLE)]
    feet = result.evaluation.feet.of(pick)
    rows = rows_of(moved(centred[pick], result.placement), result.placement, feet, length)
    w = np.ones(len(pick)) if weights is None else weights[pick]
    every = w if weights is None else weights[used]
    block = _cell(feet.y_mm) * BLOCKS + _cell(feet.x_mm)
    sums = np.stack([np.bincount(block, row * w * rows[6], BLOCKS**2).astype(np.float64) for row in rows[:6]])
    squares: Array = (rows[:6] * w**2) @ rows[:6].T / float(np.sum(w**2))
    counted = float(len(pick)) if by_sigma else float(np.sum(w)) ** 2 / float(np.sum(w**2))
    spread = float(np.sum(every**2)) / float(np.sum(every)) ** 2 if weights is not None else 1.0 / len(used)
    return _Blocks(
        sums * np.sqrt(counted) / float(np.sum(w)), len(np.unique(block)), squares, spread, counted
    )


def _cell(places_mm: Array) -> NDArray[np.intp]:
    """Return the block of each place along one axis."""
    span = max(float(np.ptp(places_mm)), 1e-300) * (1.0 + 1e-9)
    cell: NDArray[np.intp] = ((places_mm - places_mm.min()) / span * BLOCKS).astype(np.intp)
    return cell


def pose_sigma(covariance: Array, spectral: Spectrum) -> dict[str, float]:
    """Return the standard uncertainty of each motion about the centroid; infinite where one is free.

    Parameters
    ----------
    covariance : ndarray, shape (6, 6), rad and mm, frame `part`
    spectral : Spectrum
        Frame `part`.
    """
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    sigma = np.where(uncertain_axes(spectral), np.inf, sigma)
    names = ("rx_urad", "ry_urad", "rz_urad", "tx_um", "ty_um", "tz_um")
    units = (URAD_PER_RAD,) * 3 + (UM_PER_MM,) * 3
    return {name: float(s * u) for name, s, u in zip(names, sigma, units, strict=True)}


def turned(spectral: Spectrum, part_from_surface: Pose) -> Spectrum:
    """Return the motions in frame `part`."""
    return spectral._replace(motions=np.kron(np.eye(2), part_from_surface.rotation) @ spectral.motions)
