"""Which deviations are outliers: a robust rule with a frozen scale, that leaves form error alone.

A bump is form, however high; a touch on dirt is not. So a point is an outlier if it lies far from the
surface *and* far from its neighbours, or so far from the surface that nothing on the part can be meant.
Scales are medians of absolute deviations times 1.4826, good up to nearly half of the points being wrong.
Source: Rousseeuw and Croux 1993, doi 10.1080/01621459.1993.10476408.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmm_align.numerics.chunked import in_threads

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MAD_SIGMA: Final = 1.4826
"""Sigma of a normal distribution in median absolute deviations."""
FAR: Final = 6.0
"""Sigma from the middle, and from the neighbours, beyond which a point is an outlier."""
GROSS: Final = 30.0
"""Sigma from the middle beyond which it is one in any company."""

_POINTS_PER_CELL: Final = 16.0


class OutlierRule(NamedTuple):
    """A frozen rule, made from a sample of the points."""

    middle_mm: float
    """Median of the deviations, mm."""
    sigma_mm: float
    """Robust sigma of the deviations, mm: form error and noise."""
    local_sigma_mm: float
    """Robust sigma about the neighbours' median, mm: noise."""
    x0_mm: float
    y0_mm: float
    pitch_mm: float
    low_mm: Array
    """Least and largest deviation that is at home in each cell of a net, shape (ny, nx), mm: the range of the
    medians of the cell and its neighbours (but one), and half as much again for a peak between them."""
    high_mm: Array
    floor_mm: float
    """Least sigma, mm: rounding."""


def outlier_rule(x_mm: Array, y_mm: Array, deviation_mm: Array, floor_mm: float) -> OutlierRule:
    """Make the rule from a sample.

    Parameters
    ----------
    x_mm, y_mm : ndarray, shape (n,), mm
        Places on the surface.
    deviation_mm : ndarray, shape (n,), mm
    floor_mm : float
        Least sigma, mm: rounding.
    """
    middle = float(np.median(deviation_mm))
    sigma = max(MAD_SIGMA * float(np.median(np.abs(deviation_mm - middle))), floor_mm)
    x0, y0 = float(x_mm.min()), float(y_mm.min())
    wide, tall = float(np.ptp(x_mm)), float(np.ptp(y_mm))
    pitch = max(float(np.sqrt(wide * tall * _POINTS_PER_CELL / len(x_mm))), 1e-3 * max(wide, tall), 1e-300)
    shape = int(tall / pitch) + 1, int(wide / pitch) + 1
    cell = ((y_mm - y0) / pitch).astype(np.intp) * shape[1] + ((x_mm - x0) / pitch).astype(np.intp)
    order = np.lexsort((deviation_mm, cell))
    ordered = cell[order]
    starts = np.flatnonzero(np.r_[True, np.diff(ordered) != 0])
    counts = np.diff(np.r_[starts, len(ordered)])
    sorted_mm = deviation_mm[order]
    lower, upper = sorted_mm[starts + (counts - 1) // 2], sorted_mm[starts + counts // 2]
    medians = np.full(shape[0] * shape[1], middle)
    medians[ordered[starts]] = 0.5 * (lower + upper)
    rest = np.abs(deviation_mm - medians[cell])
    local = max(MAD_SIGMA * float(np.median(rest)), floor_mm)
    low, high = _range_of_neighbours(medians.reshape(shape))
    more = 0.5 * (high - low)
    return OutlierRule(middle, sigma, local, x0, y0, pitch, low - more, high + more, floor_mm)


def _range_of_neighbours(field: Array) -> tuple[Array, Array]:
    """Return the second least and second largest of each cell and its neighbours: one may be all wrong."""
    padded = np.pad(field, 1, mode="edge")
    ny, nx = field.shape
    around = np.sort([padded[j : j + ny, i : i + nx] for j in range(3) for i in range(3)], axis=0)
    return np.asarray(around[1]), np.asarray(around[-2])


def outliers(rule: OutlierRule, x_mm: Array, y_mm: Array, deviation_mm: Array) -> Mask:
    """Return which points are outliers, shape (n,).

    Parameters
    ----------
    rule : OutlierRule
    x_mm, y_mm, deviation_mm : ndarray, shape (n,), mm
        NaN is no outlier: it has no deviation at all.
    """
    found = np.empty(len(deviation_mm), dtype=bool)
    ny, nx = rule.low_mm.shape
    slack = FAR * rule.local_sigma_mm

    def work(part: slice) -> None:
        off = np.abs(deviation_mm[part] - rule.middle_mm)
        with np.errstate(invalid="ignore"):
            wrong = off > GROSS * rule.sigma_mm
            pick = np.flatnonzero((off > FAR * rule.sigma_mm) & ~wrong)
        ix = np.clip((x_mm[part][pick] - rule.x0_mm) / rule.pitch_mm, 0, nx - 1).astype(np.intp)
        iy = np.clip((y_mm[part][pick] - rule.y0_mm) / rule.pitch_mm, 0, ny - 1).astype(np.intp)
        e = deviation_mm[part][pick]
        wrong[pick] = (e < rule.low_mm[iy, ix] - slack) | (e > rule.high_mm[iy, ix] + slack)
        found[part] = wrong

    in_threads(work, len(found))
    return found
