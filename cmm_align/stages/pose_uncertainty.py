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
from numpy.typing import NDArray

from cmm_align.numerics.foot_point import Feet
from cmm_align.numerics.linearisation import even_sample, moved, rows_of
from cmm_align.numerics.observability import Spectrum, uncertain_axes
from cmm_align.numerics.rigid_fit import FitResult
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
    share = np.eye(k) / n
    correlated = False
    if variance > 0.0 and k > 0 and n > 4 * BLOCKS**2:
        sums, filled, counted = _block_sums(result, centred, length)
        whitened = root.T @ sums / np.sqrt(counted * variance)  # unit variance, if errors are independent
        found = whitened @ whitened.T
        correlated = float(np.trace(found)) / k > 1.0 + SIGNIFICANT * float(np.sqrt(2.0 / (k * filled)))
        if correlated:
            values, vectors = np.linalg.eigh(found)
            share = (vectors * np.maximum(values / counted, 1.0 / n)) @ vectors.T
    scaled = root @ share @ root.T * variance
    unscale = np.diag([1.0 / length] * 3 + [1.0] * 3)
    turn = np.kron(np.eye(2), part_from_surface)
    covariance: Array = turn @ unscale @ scaled @ unscale @ turn.T
    return covariance, correlated


def _block_sums(result: FitResult, centred: Array, length: float) -> tuple[Array, int, int]:
    """Return ``J^T e`` summed over each block, shape (6, blocks), scaled, the blocks and points behind it.

    An even sample of many points says as much about neighbours as all of them.
    """
    pick = np.flatnonzero(result.evaluation.used)
    pick = pick[even_sample(len(pick), SAMPLE)]
    feet = Feet(*(a[pick] for a in result.evaluation.feet))
    p = moved(centred[pick], result.placement)
    rows = rows_of(p, result.placement, feet, length)
    block = _cell(feet.y_mm) * BLOCKS + _cell(feet.x_mm)
    sums: Array = np.stack(
        [np.bincount(block, row * rows[6], BLOCKS**2).astype(np.float64) for row in rows[:6]]
    )
    return sums, len(np.unique(block)), len(pick)


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
