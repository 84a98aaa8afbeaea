"""Feature regions of a nominal: where it bends much more one way than the other.

A place is a feature where ``|k1 - k2|`` exceeds a threshold, 0.05 1/mm unless told otherwise (the paper,
section 1: discontinuities such as grooves, steps and edges). A sphere of any radius is none.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from cmm_align.surfaces.geometry import principal_curvatures
from cmm_align.surfaces.protocol import Array, Mask, Surface

THRESHOLD_PER_MM: Final = 0.05
"""The paper's threshold of |k1 - k2|, 1/mm."""

_CHUNK: Final = 16384


def feature_mask(least_per_mm: Array, most_per_mm: Array, threshold_per_mm: float = THRESHOLD_PER_MM) -> Mask:
    """Return which places are features.

    Parameters
    ----------
    least_per_mm, most_per_mm : ndarray, shape (n,), 1/mm
        Principal curvatures; the sign does not matter.
    threshold_per_mm : float
    """
    result: Mask = most_per_mm - least_per_mm > threshold_per_mm
    return result


def features_at(surface: Surface, x_mm: Array, y_mm: Array, threshold_per_mm: float) -> Mask:
    """Return which places of a surface are features; none outside of it.

    Parameters
    ----------
    surface : Surface
    x_mm, y_mm : ndarray, shape (n,), mm, frame `surface`
    threshold_per_mm : float
    """
    found = np.zeros(len(x_mm), dtype=bool)
    for start in range(0, len(x_mm), _CHUNK):
        part = slice(start, start + _CHUNK)
        with np.errstate(invalid="ignore"):
            k = principal_curvatures(surface.jet(x_mm[part], y_mm[part]), 1)
            found[part] = feature_mask(k.least, k.most, threshold_per_mm)
    return found & surface.contains(x_mm, y_mm)
