"""Numbers of a set of deviations, with their places and their count."""

from __future__ import annotations

import numpy as np

from cmm_align.model import Statistics
from cmm_align.surfaces.protocol import Array


def deviation_statistics(
    deviation_mm: Array, x_mm: Array, y_mm: Array, weights: Array | None = None
) -> Statistics:
    """Return count, PV, RMS, mean and the extremes with their places.

    Parameters
    ----------
    deviation_mm : ndarray, any shape, mm
        Along the normal, positive = excess material; NaN is left out. At least one is finite.
    x_mm, y_mm : ndarray, shape of `deviation_mm`, mm, frame `surface`
        Where each deviation is.
    weights : ndarray, shape of `deviation_mm`, optional
        How much each counts in RMS and mean: the area of a node, less along the border.
    """
    known = np.isfinite(deviation_mm)
    share = None if weights is None else weights[known]
    e, x, y = deviation_mm[known], x_mm[known], y_mm[known]
    low, high = int(np.argmin(e)), int(np.argmax(e))
    return Statistics(
        n=len(e),
        pv_mm=float(e[high] - e[low]),
        rms_mm=float(np.sqrt(np.average(e**2, weights=share))),
        mean_mm=float(np.average(e, weights=share)),
        min_mm=float(e[low]),
        max_mm=float(e[high]),
        min_at_mm=(float(x[low]), float(y[low])),
        max_at_mm=(float(x[high]), float(y[high])),
    )
