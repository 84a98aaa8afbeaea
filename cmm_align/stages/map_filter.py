"""Which wavelengths of a map are told: low, high or band pass, in the words of ISO 16610."""

from __future__ import annotations

from functools import partial
from typing import Final

from cmm_align.config import ErrorMapConfig
from cmm_align.errors import UsageError
from cmm_align.model import MapFilter
from cmm_align.numerics.areal_filter import LowPass, band_pass, gaussian_regression
from cmm_align.numerics.areal_spline_filter import spline_filter
from cmm_align.surfaces.protocol import Array

KINDS: Final[dict[str, LowPass]] = {
    "gaussian": gaussian_regression,
    "gaussian-order-0": partial(gaussian_regression, order=0),
    "gaussian-robust": partial(gaussian_regression, robust=True),
    "spline": spline_filter,
}
"""Filters by the name of the setting."""


def filtered(
    deviation_mm: Array, spacing_mm: tuple[float, float], config: ErrorMapConfig
) -> tuple[Array, MapFilter | None]:
    """Return a map without the waves that were not asked for, and what was done to it.

    Parameters
    ----------
    deviation_mm : ndarray, shape (ny, nx), mm
        NaN where unknown.
    spacing_mm : tuple of float
        Along x and y.
    config : ErrorMapConfig
        Kind and cutoffs; without a cutoff nothing is done.

    Raises
    ------
    UsageError
        If the kind is not known, or a cutoff is below what the grid carries or above the part.
    """
    if config.filter not in KINDS:
        raise UsageError(f"filter {config.filter!r}", expected=", ".join(KINDS))
    short, long = config.low_pass_mm or None, config.high_pass_mm or None
    if short is None and long is None:
        return deviation_mm, None
    kept = band_pass(deviation_mm, spacing_mm, short, long, low_pass=KINDS[config.filter])
    return kept, MapFilter(config.filter, config.low_pass_mm, config.high_pass_mm)
