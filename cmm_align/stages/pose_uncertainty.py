"""What an alignment knows of its pose: covariance, sigma of each motion, free motions.

For errors that are independent from point to point the covariance is ``s^2 (J^T J)^-1``. Form error is not:
its neighbours err alike, and a thousand of them count for few. So the part is cut into blocks, the sums of
``J^T e`` over the blocks are compared with what independent errors would give, and where they are
significantly larger the covariance is made of them instead (a cluster-robust sandwich, never below the simple
one). Blocks are a fifth of the part: errors that are smoother than that still look smaller than they are.
Source: Liang and Zeger 1986, doi 10.1093/biomet/73.1.13.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from cmm_align.numerics.foot_point import Feet
from cmm_align.numerics.linearisation import in_threads, moved, rows_of
from cmm_align.numerics.observability import Spectrum, uncertain_axes
from cmm_align.numerics.rigid_fit import FitResult
from cmm_align.pose import Pose
from cmm_align.surfaces.protocol import Array
from cmm_align.units import UM_PER_MM, URAD_PER_RAD

BLOCKS: Final = 5
"""Blocks along each side."""
SIGNIFICANT: Final = 4.0
"""Standard deviations by which the block sums must exceed those of independent errors."""


def covariance_of(
    result: FitResult, centred: Array, length: float, part_from_surface: Array
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

    Returns
    -------
    covariance : ndarray, shape (6, 6), rad and mm
        Of (rx, ry, rz, tx, ty, tz), on the observable motions.
    correlated : bool
        Whether it had to be raised for errors that are alike in neighbours.
    """
    keep = ~result.spectral.free
    root = result.spectral.motions[:, keep] / np.sqrt(result.spectral.values[keep])
    used = result.evaluation.used
    n, k = max(int(np.count_nonzero(used)), 1), int(np.count_nonzero(keep))
    variance = result.evaluation.cost_mm2 * n / max(n - k, 1)
    excess = np.eye(k)
    correlated = False
    if variance > 0.0 and k > 0 and n > 4 * BLOCKS**2:
        sums, filled = _block_sums(result, centred, length)
        whitened = root.T @ sums / np.sqrt(n * variance)  # unit variance each, if errors are independent
        found = whitened @ whitened.T
        correlated = float(np.trace(found)) / k > 1.0 + SIGNIFICANT * float(np.sqrt(2.0 / (k * filled)))
        if correlated:
            values, vectors = np.linalg.eigh(found)
            excess = (vectors * np.maximum(values, 1.0)) @ vectors.T
    scaled = root @ excess @ root.T * (variance / n)
    unscale = np.diag([1.0 / length] * 3 + [1.0] * 3)
    turn = np.kron(np.eye(2), part_from_surface)
    covariance: Array = turn @ unscale @ scaled @ unscale @ turn.T
    return covariance, correlated


def _block_sums(result: FitResult, centred: Array, length: float) -> tuple[Array, int]:
    """Return ``J^T e`` summed over each block, shape (6, blocks), scaled, and how many blocks hold points."""
    feet, used = result.evaluation.feet, result.evaluation.used
    x, y = feet.x_mm[used], feet.y_mm[used]
    low = np.array([x.min(), y.min()])
    step = np.maximum(np.array([np.ptp(x), np.ptp(y)]), 1e-300) / BLOCKS * (1.0 + 1e-9)

    def work(part: slice) -> Array:
        counts = used[part]
        chosen = Feet(*(a[part][counts] for a in feet))
        rows = rows_of(moved(centred[part][counts], result.placement), result.placement, chosen, length)
        block = ((chosen.y_mm - low[1]) / step[1]).astype(np.intp) * BLOCKS
        block += ((chosen.x_mm - low[0]) / step[0]).astype(np.intp)
        weights = [*(row * rows[6] for row in rows[:6]), np.ones(len(block))]
        return np.stack([np.bincount(block, weight, BLOCKS**2) for weight in weights])

    total = np.sum(np.stack(in_threads(work, len(centred))), axis=0)
    return total[:6], int(np.count_nonzero(total[6]))


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
