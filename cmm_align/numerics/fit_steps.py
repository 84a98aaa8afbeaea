"""Taking a step of a rigid fit: how far, and what the distances are after it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cmm_align.numerics.chunked import in_threads
from cmm_align.numerics.linearisation import (
    Evaluation,
    Measure,
    carried,
    evaluate,
    moved,
    total_weight,
)
from cmm_align.numerics.observability import Spectrum, solve_observable
from cmm_align.numerics.rotations import orthonormalised, rotation_from_vector
from cmm_align.numerics.steering import Placement, Steering, datum_rows, held

Array = NDArray[np.float64]

_MAX_HALVINGS: Final = 8
LINEAR: Final = 1e-15
"""A step whose square over the size is this share of the size changes distances linearly, in rounding."""
_MANY: Final = 50_000
"""From so many points on a look at the surface costs more than it tells after a short step."""
_QUADRATIC: Final = 1e-13
"""One whose cube over the square of the size is this share of it changes them to second order: 3e-12 mm off a
new look on a part of 120 mm whose points moved by 3.6 um."""
ROUNDING: Final = 64.0 * float(np.finfo(np.float64).eps)
"""Residuals below this share of the part's size are rounding: nothing is left to gain."""


@dataclass(frozen=True, slots=True)
class FitSettings:
    """What ends a fit and what keeps it safe; all dimensionless but the size."""

    size_mm: float
    """Size of the part, mm: the measure of all movements."""
    length_mm: float
    """Rms radius of the points about their centroid, mm."""
    tolerance: float
    """Stop if the next step moves no point by more than this share of the size."""
    max_iterations: int
    max_rotation_rad: float
    min_observability: float


def stepped(placement: Placement, step: Array, length_mm: float) -> Placement:
    """Return the placement after a small motion (w length, t) about the centroid.

    Parameters
    ----------
    placement : Placement
    step : ndarray, shape (6,), mm
        Rotation vector times `length_mm`, then translation.
    length_mm : float
        Scale of the rotation, mm.
    """
    turned = rotation_from_vector(step[:3] / length_mm) @ placement.rotation
    return Placement(orthonormalised(turned), placement.position_mm + step[3:])


def movement_of(step: Array, settings: FitSettings) -> float:
    """Return the most that a step (w length, t), shape (6,), moves a point, mm."""
    angle = float(np.linalg.norm(step[:3])) / settings.length_mm
    return angle * settings.size_mm + float(np.linalg.norm(step[3:]))


def clamped(
    spectral: Spectrum, now: Evaluation, settings: FitSettings, curvature: Array | None, *, locked: bool
) -> Array:
    """Return the step (w length, t), with the rotation clamped and the translation solved anew.

    With locked motions the whole step is shortened instead, so that it stays among those that are left.

    Parameters
    ----------
    spectral : Spectrum
    now : Evaluation
    settings : FitSettings
    curvature : ndarray, shape (6, 6), scaled, or None
        Newton's matrix beyond ``J^T J``.
    locked : bool

    Returns
    -------
    ndarray, shape (6,), mm
    """
    step = solve_observable(spectral, now.gradient, curvature)
    angle = float(np.linalg.norm(step[:3])) / settings.length_mm
    if angle > settings.max_rotation_rad and locked:
        step *= settings.max_rotation_rad / angle
    elif angle > settings.max_rotation_rad:
        step[:3] *= settings.max_rotation_rad / angle
        pull = now.gradient[3:] + now.normal_matrix[3:, :3] @ step[:3]
        step[3:] = -np.linalg.lstsq(now.normal_matrix[3:, 3:], pull, rcond=1e-6)[0]
    return step


def downhill(
    measure: Measure,
    points_mm: Array,
    placement: Placement,
    step: Array,
    now: Evaluation,
    settings: FitSettings,
    steering: Steering,
) -> tuple[Placement, Evaluation | None]:
    """Take a step, or the largest half, quarter ... of it that does not raise the cost.

    Parameters
    ----------
    measure : Measure
    points_mm : ndarray, shape (n, 3), mm
        Measured points about their centroid.
    placement : Placement
    step : ndarray, shape (6,), mm
        As for `stepped`.
    now : Evaluation
        At `placement`.
    settings : FitSettings
    steering : Steering

    Returns
    -------
    Placement, Evaluation or None
        Where it ended; `placement` and None if every step raises the cost.
    """
    share = 1.0
    for _ in range(_MAX_HALVINGS):
        trial = held(steering.lock, stepped(placement, share * step, settings.length_mm))
        there = _looked_at(
            measure, points_mm, placement, trial, now, share * movement_of(step, settings), settings, steering
        )
        if there.cost_mm2 <= now.cost_mm2 * (1.0 + 1e-12) + (ROUNDING * settings.size_mm) ** 2:
            return trial, there
        share *= 0.5
    return placement, None


def _looked_at(
    measure: Measure,
    points_mm: Array,
    placement: Placement,
    trial: Placement,
    now: Evaluation,
    movement_mm: float,
    settings: FitSettings,
    steering: Steering,
) -> Evaluation:
    """Look at the points under a trial placement; after a short step, by what the last look saw."""
    length = settings.length_mm
    short = movement_mm**3 <= _QUADRATIC * settings.size_mm**3
    if measure.shifted is not None and short and len(points_mm) >= _MANY:
        return carried(measure, points_mm, placement, trial, now, length, steering)
    feet, used = now.feet, now.used
    return evaluate(measure, points_mm, trial, length, previous=feet, used=used, steering=steering)


def last_step(
    points_mm: Array,
    placement: Placement,
    step: Array,
    now: Evaluation,
    length_mm: float,
    steering: Steering,
) -> tuple[Placement, Evaluation]:
    """Take a step so small that distances change linearly, without measuring again.

    Parameters
    ----------
    points_mm : ndarray, shape (n, 3), mm
        Measured points about their centroid.
    placement : Placement
    step : ndarray, shape (6,), mm
        As for `stepped`.
    now : Evaluation
        At `placement`; its feet and sums stay.
    length_mm : float
        Scale of the rotation, mm.
    steering : Steering
    """
    after = held(steering.lock, stepped(placement, step, length_mm))
    distance = np.empty(len(points_mm))

    def work(part: slice) -> None:
        shift = moved(points_mm[part], after) - moved(points_mm[part], placement)
        distance[part] = now.feet.distance_mm[part] + np.einsum("ij,ij->i", now.feet.normal[part], shift)

    in_threads(work, len(points_mm))
    squares = distance[now.used] ** 2
    if steering.weights is not None:
        squares *= steering.weights[now.used]
    cost = float(np.sum(squares))
    if steering.datum is not None:
        cost += float(steering.datum.weights @ datum_rows(steering.datum, after, length_mm)[6] ** 2)
    cost /= total_weight(now.used, steering.weights)
    return after, now._replace(feet=now.feet._replace(distance_mm=distance), cost_mm2=cost)
