"""A scale of the measured cloud beside its six motions, and what it cannot be told from.

The scale is eliminated: at every scale the motions are fitted, and Newton's step for the scale alone uses
the Schur complement of the seven-by-seven problem. The distance of a point changes by ``n . (p - c)`` for a
unit of relative scale about the centroid c.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmm_align.numerics.chunked import in_threads
from cmm_align.numerics.linearisation import moved, rows_of, total_weight
from cmm_align.numerics.rigid_fit import FitResult
from cmm_align.numerics.steering import DatumTerms, Placement, Steering, datum_rows

Array = NDArray[np.float64]

_OBSERVABLE: Final = 1e-8
"""Share of the scale's own effect that motions must leave of it."""


class ScaleLook(NamedTuple):
    """The scale at the best fit for the present one."""

    step: float
    """What to add to the relative scale."""
    sigma: float
    """Standard uncertainty of the scale for errors that are independent; infinite if it cannot be told."""
    response: Array
    """How the best motions change with the scale, shape (6,), mm (rotations scaled)."""
    correlation: Array
    """With (rx, ry, rz, tx, ty, tz) and the tip radius, shape (7,), each as if all were fitted together;
    NaN where a motion is locked or free."""


def scale_look(points_mm: Array, result: FitResult, length_mm: float, steering: Steering) -> ScaleLook:
    """Return the step to the best scale and what is known of it.

    Parameters
    ----------
    points_mm : ndarray, shape (n, 3), mm
        Measured points about their centroid, at the present scale.
    result : FitResult
        Best motions at this scale.
    length_mm : float
        Scale of the rotation columns, mm.
    steering : Steering
    """
    now, placement, weights = result.evaluation, result.placement, steering.weights

    def work(part: slice) -> Array:
        p = moved(points_mm[part], placement)
        feet = now.feet.of(part)
        rows = np.empty((9, len(p)))
        rows[:7] = rows_of(p, placement, feet, length_mm)
        rows[7] = rows[6]
        rows[6] = np.einsum("ij,ij->i", feet.normal, p - placement.position_mm)
        rows[8] = -1.0
        rows[:, ~now.used[part]] = 0.0
        sums: Array = rows @ rows.T if weights is None else (rows * weights[part]) @ rows.T
        return sums

    total = np.sum(np.stack(in_threads(work, len(points_mm))), axis=0)
    if steering.datum is not None:
        total = total + _datum_sums(steering.datum, placement, length_mm)
    total = total / total_weight(now.used, weights)
    keep = ~result.spectral.free
    basis = result.spectral.motions[:, keep]
    inverse = (basis / result.spectral.values[keep]) @ basis.T
    response: Array = -inverse @ total[:6, 6]
    left = float(total[6, 6] + total[6, :6] @ response)
    if left <= _OBSERVABLE * max(float(total[6, 6]), np.finfo(np.float64).tiny):
        return ScaleLook(0.0, np.inf, response, np.full(7, np.nan))
    step = -float(total[6, 7] + response @ total[:6, 7]) / left
    n = max(int(np.count_nonzero(now.used)), 1)
    variance = now.cost_mm2 / max(n - int(keep.sum()) - 1, 1)
    pose = np.diag(inverse) + response**2 / left
    with np.errstate(divide="ignore", invalid="ignore"):
        motions = response / np.sqrt(left * pose)
    return ScaleLook(
        step, float(np.sqrt(variance / left)), response, np.append(motions, _with_radius(total, inverse))
    )


def _with_radius(total: Array, inverse: Array) -> float:
    """Return the correlation of the scale with the tip radius, both fitted beside the motions."""
    pair = total[np.ix_([6, 8], [6, 8])] - total[[6, 8], :6] @ inverse @ total[:6, [6, 8]]
    return float(-pair[0, 1] / np.sqrt(max(pair[0, 0] * pair[1, 1], np.finfo(np.float64).tiny)))


def _datum_sums(datum: DatumTerms, placement: Placement, length_mm: float) -> Array:
    """Return what the datum terms add to the sums, shape (9, 9)."""
    rows = np.zeros((9, len(datum.weights)))
    motions = datum_rows(datum, placement, length_mm)
    rows[:6], rows[7] = motions[:6], motions[6]
    rows[6] = np.einsum("ij,ij->i", datum.directions, datum.points_mm @ placement.rotation.T)
    sums: Array = (rows * datum.weights) @ rows.T
    return sums
