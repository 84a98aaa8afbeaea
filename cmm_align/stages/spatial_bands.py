"""The spatial bands of a ledger: octaves of the part's size, the same for all its passes.

A field is split by Gaussian regressions of order 2 with the borders as cutoffs, so the bands add up to what
the shortest of them lets through. Their transmissions overlap: half of a wave at a border is on either side.
"""

from __future__ import annotations

from itertools import pairwise
from math import inf
from typing import Final

import numpy as np

from cmm_align.model import WaveBand
from cmm_align.numerics.areal_filter import cutoff_limits_mm, gaussian_regression, gaussian_transmission
from cmm_align.surfaces.protocol import Array, Bounds

OCTAVES: Final = 4
"""Number of bands; the shortest ends at the shorter side of the part over two to this power."""
STEPS_PER_CUTOFF: Final = 8.0
"""A finer grid than this in the shortest band is averaged first."""


def wave_bands(bounds: Bounds) -> tuple[WaveBand, ...]:
    """Return the bands of parts of a size, from long to short waves."""
    side = min(bounds.x_max - bounds.x_min, bounds.y_max - bounds.y_min)
    edges = [inf, *(side / 2.0**k for k in range(1, OCTAVES + 1))]
    return tuple(WaveBand(short, long) for long, short in pairwise(edges))


def thinning(bands: tuple[WaveBand, ...], step_mm: float) -> int:
    """Return how many nodes along each axis may be averaged into one without loss to the bands."""
    return max(int(bands[-1].short_mm / (STEPS_PER_CUTOFF * step_mm)), 1)


def thinned(field: Array, rows: int, columns: int) -> Array:
    """Return the means of whole blocks of nodes, unknown where a node of it is.

    Parameters
    ----------
    field : ndarray, shape (ny, nx)
    rows, columns : int
        Size of a block.

    Returns
    -------
    ndarray, shape (ny // rows, nx // columns)
    """
    ny, nx = field.shape[0] // rows, field.shape[1] // columns
    cut = field[: ny * rows, : nx * columns]
    return np.asarray(cut.reshape(ny, rows, nx, columns).mean(axis=(1, 3)), dtype=np.float64)


def banded(field: Array, steps_mm: tuple[float, float], bands: tuple[WaveBand, ...]) -> list[Array]:
    """Return the waves of a field in each band; nothing in those that its grid does not carry.

    Parameters
    ----------
    field : ndarray, shape (ny, nx)
        NaN where unknown.
    steps_mm : pair of float
    bands : tuple of WaveBand
        From long to short waves.

    Returns
    -------
    list of ndarray, shape (ny, nx)
        Unit of `field`; NaN where that is unknown.
    """
    shortest, longest = cutoff_limits_mm(field, steps_mm)
    lower = np.where(np.isfinite(field), 0.0, np.nan)
    result = []
    for band in bands:
        upper = gaussian_regression(field, steps_mm, min(max(band.short_mm, shortest), longest))
        result.append(upper - lower)
        lower = upper
    return result


def band_transmissions(
    frequency_per_mm: Array, bands: tuple[WaveBand, ...], limits_mm: tuple[float, float]
) -> Array:
    """Return what `banded` lets through of waves, away from the border.

    Parameters
    ----------
    frequency_per_mm : ndarray, shape (n,), 1/mm
        Above 0.
    bands : tuple of WaveBand
    limits_mm : pair of float
        Shortest and longest cutoff of the grid.

    Returns
    -------
    ndarray, shape (bands, n)
    """
    edges = [min(max(band.short_mm, limits_mm[0]), limits_mm[1]) for band in bands]
    passed = np.stack([gaussian_transmission(1.0 / frequency_per_mm, edge) for edge in edges])
    return np.diff(passed, axis=0, prepend=0.0)
