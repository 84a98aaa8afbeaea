"""What an alignment knows of its pose: covariance, sigma of each motion, free motions."""

from __future__ import annotations

import numpy as np

from cmm_align.numerics.observability import Spectrum, uncertain_axes
from cmm_align.numerics.rigid_fit import FitResult
from cmm_align.pose import Pose
from cmm_align.surfaces.protocol import Array
from cmm_align.units import UM_PER_MM, URAD_PER_RAD


def covariance_of(result: FitResult, length: float, part_from_surface: Array) -> Array:
    """Return the covariance of a small motion about the centroid, frame `part`, shape (6, 6), rad and mm.

    Parameters
    ----------
    result : FitResult
    length : float
        Scale of the rotations, mm.
    part_from_surface : ndarray, shape (3, 3)

    Notes
    -----
    ``s^2 (J^T J)^-1`` on the observable motions, for errors that are independent from point to point.
    """
    keep = ~result.spectral.free
    motions = result.spectral.motions[:, keep]
    n = max(int(np.count_nonzero(result.evaluation.used)), 1)
    freedom = max(n - int(np.count_nonzero(keep)), 1)
    variance = result.evaluation.cost_mm2 * n / freedom
    scaled = (motions / result.spectral.values[keep]) @ motions.T * (variance / n)
    unscale = np.diag([1.0 / length] * 3 + [1.0] * 3)
    turn = np.kron(np.eye(2), part_from_surface)
    covariance: Array = turn @ unscale @ scaled @ unscale @ turn.T
    return covariance


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
