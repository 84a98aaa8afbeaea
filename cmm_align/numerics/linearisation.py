"""The rigid-motion problem at one placement: distances, normal equations, second-order term.

A small motion (w, t) about the centroid changes the distance of a point by ``((p - c) x n) . w + n . t``
(Chen and Medioni 1992, doi 10.1016/0262-8856(92)90066-C; for orthogonal foot points this is the exact
derivative, Pottmann et al. 2006, doi 10.1007/s11263-006-5167-2). Rotation columns are divided by the rms
radius of the points, so all six compare. Points are handled in chunks that stay in cache, on all cores, and
summed in a fixed order: the same input gives the same bits.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmm_align.numerics.chunked import in_threads
from cmm_align.numerics.foot_point import Feet, put
from cmm_align.numerics.steering import FREELY, Steering, datum_rows
from cmm_align.numerics.steering import Placement as Placement  # noqa: PLC0414 - also from here

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_CURVATURE_SAMPLE: Final = 8192
_GOLDEN: Final = 0.6180339887498949


class Measure(NamedTuple):
    """How far points lie from a surface."""

    distance: Callable[[Array, Feet | None], tuple[Feet, Mask]]
    """Distance of moved points (a chunk, frame `surface`), and which lie on it; quicker from their last
    feet."""
    hessian: Callable[[Array, Feet], Array] | None = None
    """Second derivatives of the distance with respect to the point, shape (n, 3, 3); None for facets."""
    shifted: Callable[[Feet, Array], tuple[Feet, Mask]] | None = None
    """The same from the last feet and short movements of their points, shape (n, 3), to second order, without
    looking at the surface again; None for facets."""


class Evaluation(NamedTuple):
    """One look at all points under one placement."""

    feet: Feet
    inside: Mask
    used: Mask
    normal_matrix: Array
    """``J^T W J / sum W``, scaled, shape (6, 6)."""
    gradient: Array
    """``J^T W d / sum W``, scaled, shape (6,), mm."""
    cost_mm2: float
    """Weighted mean squared distance of the used points, mm^2, datum terms included."""
    datum_matrix: Array | None = None
    """What datum terms add to `normal_matrix`, shape (6, 6)."""


def even_sample(n: int, most: int) -> NDArray[np.intp]:
    """Return at most `most` of n indices, evenly spread but in no step with scan lines.

    Each stretch of equal length gives one index, moved within it by the golden ratio: a fixed stride would
    pick the same columns of every line of a scan.
    """
    if n <= most:
        return np.arange(n)
    k, stretch = np.arange(most), n / most
    return (k * stretch + (k * _GOLDEN) % 1.0 * (stretch - 1.0)).astype(np.intp)  # a whole step apart or more


def moved(points_mm: Array, placement: Placement) -> Array:
    """Return centred points in their place, shape (n, 3), mm."""
    result: Array = points_mm @ placement.rotation.T
    result += placement.position_mm
    return result


def evaluate(
    measure: Measure,
    points_mm: Array,
    placement: Placement,
    length_mm: float,
    *,
    previous: Feet | None = None,
    used: Mask | None = None,
    steering: Steering = FREELY,
) -> Evaluation:
    """Measure all points under a placement and sum the normal equations.

    Parameters
    ----------
    measure : callable
        See `Measure`.
    points_mm : ndarray, shape (n, 3), mm
        Measured points about their centroid.
    placement : Placement
    length_mm : float
        Scale of the rotation columns, mm.
    previous : Feet, optional
        Feet of the last evaluation, to start from.
    used : ndarray of bool, shape (n,), optional
        Which points count; without it, those that lie on the surface.
    steering : Steering
        Weights and datum terms.
    """

    def look(part: slice, p: Array) -> tuple[Feet, Mask]:
        return measure.distance(p, None if previous is None else previous.of(part))

    bend = None if measure.shifted is None else np.empty((len(points_mm), 3))
    return _summed(look, bend, points_mm, placement, length_mm, used, steering)


def carried(
    measure: Measure,
    points_mm: Array,
    before: Placement,
    after: Placement,
    now: Evaluation,
    length_mm: float,
    steering: Steering = FREELY,
) -> Evaluation:
    """Carry an evaluation on to a placement nearby, to second order, without looking at the surface again.

    Parameters
    ----------
    measure : Measure
        With `shifted`.
    points_mm : ndarray, shape (n, 3), mm
        Measured points about their centroid.
    length_mm, steering
        As for `evaluate`.
    before, after : Placement
        Of `now`, and the new one.
    now : Evaluation
        The same points count afterwards.
    """
    shifted = measure.shifted
    if shifted is None:
        raise ValueError("this measure cannot be carried on")

    def look(part: slice, p: Array) -> tuple[Feet, Mask]:
        return shifted(now.feet.of(part), p - moved(points_mm[part], before))

    found = _summed(look, None, points_mm, after, length_mm, now.used, steering)
    return found._replace(feet=found.feet._replace(bend=now.feet.bend))  # what a short step leaves as it is


def _summed(
    look: Callable[[slice, Array], tuple[Feet, Mask]],
    bend: Array | None,
    points_mm: Array,
    placement: Placement,
    length_mm: float,
    used: Mask | None,
    steering: Steering,
) -> Evaluation:
    """Look at all points, chunk by chunk, and sum the normal equations; `bend` is filled if it is there."""
    n = len(points_mm)
    weights = steering.weights
    feet = Feet(np.empty(n), np.empty(n), np.empty(n), np.empty((n, 3)), bend)
    inside, counted = np.empty(n, dtype=bool), np.empty(n, dtype=bool)

    def work(part: slice) -> Array:
        p = moved(points_mm[part], placement)
        found, on_surface = look(part, p)
        put(feet, part, found)
        inside[part] = on_surface
        counts = (on_surface if used is None else used[part]) & np.isfinite(found.distance_mm)
        counted[part] = counts
        rows = rows_of(p, placement, found, length_mm)
        if not counts.all():
            rows[:, ~counts] = 0.0
        sums: Array = rows @ rows.T if weights is None else (rows * weights[part]) @ rows.T
        return sums

    total = np.sum(np.stack(in_threads(work, n)), axis=0)
    weight, held = total_weight(counted, weights), None
    if steering.datum is not None:
        rows = datum_rows(steering.datum, placement, length_mm)
        added = (rows * steering.datum.weights) @ rows.T
        total, held = total + added, added[:6, :6] / weight
    total = total / weight
    return Evaluation(feet, inside, counted, total[:6, :6], total[:6, 6], float(total[6, 6]), held)


def total_weight(counted: Mask, weights: Array | None) -> float:
    """Return the sum of the weights of the points that count; 1 where none does.

    Parameters
    ----------
    counted : ndarray of bool, shape (n,)
    weights : ndarray, shape (n,), or None
        None where all are 1.
    """
    if weights is None:
        return float(max(int(np.count_nonzero(counted)), 1))
    return float(np.sum(weights[counted])) or 1.0


def curvature_term(
    hessian: Callable[[Array, Feet], Array],
    points_mm: Array,
    placement: Placement,
    now: Evaluation,
    length_mm: float,
    weights: Array | None = None,
) -> Array:
    """Return what Newton's matrix has beyond ``J^T J``: the mean of distance times second derivative.

    With it the steps converge quadratically although form error is left; without it only linearly.

    Parameters
    ----------
    hessian : callable
        See `Measure`.
    points_mm, placement, now, length_mm
        As for `evaluate`.
    weights : ndarray, shape (n,), optional

    Returns
    -------
    ndarray, shape (6, 6), scaled
    """
    pick = np.flatnonzero(now.used)
    pick = pick[even_sample(len(pick), _CURVATURE_SAMPLE)]
    if len(pick) == 0:
        return np.zeros((6, 6))
    feet = now.feet.of(pick)
    p = moved(points_mm[pick], placement)
    arm = p - placement.position_mm
    motion = np.zeros((len(pick), 3, 6))  # how the point moves: w x arm / length + t
    motion[:, :, 3:] = np.eye(3)
    for k, unit in enumerate(np.eye(3)):
        motion[:, :, k] = np.cross(unit, arm) / length_mm
    share = np.full(len(pick), 1.0) if weights is None else weights[pick]
    weight = feet.distance_mm * share / max(float(share.sum()), float(np.finfo(np.float64).tiny))
    total = np.einsum("n,nai,nab,nbj->ij", weight, motion, hessian(p, feet), motion, optimize=True)
    # The second-order part of the rotation itself: n . (w x (w x arm)).
    outer = np.einsum("n,ni,nj->ij", weight, feet.normal, arm)
    total[:3, :3] += (0.5 * (outer + outer.T) - np.trace(outer) * np.eye(3)) / length_mm**2
    result: Array = 0.5 * (total + total.T)
    return result


def rows_of(p: Array, placement: Placement, feet: Feet, length_mm: float) -> Array:
    """Return the rows of the linearised problem, shape (7, n): six motions and the distance.

    Parameters
    ----------
    p : ndarray, shape (n, 3), mm
        Points in their place.
    placement, feet, length_mm
        Of the same points.
    """
    arm = p - placement.position_mm
    nx, ny, nz = feet.normal[:, 0], feet.normal[:, 1], feet.normal[:, 2]
    rows = np.empty((7, len(p)))
    rows[0] = (arm[:, 1] * nz - arm[:, 2] * ny) / length_mm
    rows[1] = (arm[:, 2] * nx - arm[:, 0] * nz) / length_mm
    rows[2] = (arm[:, 0] * ny - arm[:, 1] * nx) / length_mm
    rows[3:6] = feet.normal.T
    rows[6] = feet.distance_mm
    return rows
