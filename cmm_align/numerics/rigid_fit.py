"""Newton's method for the rigid motion that lays points on a surface.

The unknown is the *total* motion: the points stay as they were measured, every iteration moves the
originals anew, so nothing drifts. The matrix is Gauss-Newton's plus the second-order term of the distance
where the surface is smooth, so that the steps converge quadratically although form error is left.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmm_align.numerics.foot_point import Feet
from cmm_align.numerics.linearisation import (
    Evaluation,
    Measure,
    Placement,
    curvature_term,
    evaluate,
    in_threads,
    moved,
    rows_of,
)
from cmm_align.numerics.observability import Spectrum, free_part, solve_observable, spectrum
from cmm_align.numerics.rotations import (
    left_jacobian,
    orthonormalised,
    rotation_from_vector,
    vector_from_rotation,
)

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_MAX_HALVINGS: Final = 8
_LINEAR: Final = 1e-15
"""A step whose square over the size is this share of the size changes distances linearly, in rounding."""
_RECOUNT: Final = (1e-6, 1e-3)
"""Which points count is decided anew only after steps of this share of the size: after larger ones a
cloud could slide off the surface and call the few points left a good fit, after smaller ones it stays."""
_OF_SIGMA: Final = 0.03
"""After a sample, an error this small beside the standard uncertainty of the pose is no error."""
_ROUNDING: Final = 64.0 * float(np.finfo(np.float64).eps)
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


class FitResult(NamedTuple):
    """How a fit ended."""

    placement: Placement
    evaluation: Evaluation
    spectral: Spectrum
    iterations: int
    """Steps taken."""
    stop_reason: str
    converged: bool
    costs_mm2: tuple[float, ...]
    curvature: Array | None
    """Newton's matrix beyond ``J^T J``, scaled, shape (6, 6): the same for any fair sample of the points."""


def on_the_surface(now: Evaluation) -> Mask:
    """Choose the points that lie on the surface."""
    return now.inside


Select = Callable[[Evaluation], Mask]
"""Which points count."""


def fit(
    measure: Measure,
    points_mm: Array,
    start: Placement,
    settings: FitSettings,
    *,
    used: Mask | None = None,
    select: Select = on_the_surface,
    previous: Feet | None = None,
    curvature: Array | None = None,
) -> FitResult:
    """Find the placement with the least mean squared distance.

    Parameters
    ----------
    measure, points_mm
        As for `evaluate`.
    start : Placement
    settings : FitSettings
    used : ndarray of bool, shape (n,), optional
        Points that count throughout; without it, those that `select` chooses.
    select : callable
        Which points count, given an evaluation; by default those that lie on the surface.
    previous : Feet, optional
        Feet near the start, to begin from.
    curvature : ndarray, shape (6, 6), optional
        From a fit of a sample; without it, it is computed at every placement (where `measure` can).

    Returns
    -------
    FitResult
        The best placement seen, never one that is worse than the start.

    Notes
    -----
    Safeguards: steps in the observable motions only; rotation clamped, translation re-solved; a step that
    raises the cost is halved.
    """
    floor = (_ROUNDING * settings.size_mm) ** 2
    placement = start
    now = evaluate(measure, points_mm, placement, settings.length_mm, previous=previous, used=used)
    if used is None:
        now = _recounted(points_mm, placement, now, select(now), settings.length_mm)
    bend = curvature
    costs = [now.cost_mm2]
    iterations = 0
    reason = "max iterations"
    converged = False
    last_movement = np.inf
    spectral = spectrum(now.normal_matrix, settings.min_observability)
    while True:
        if curvature is None and measure.hessian is not None:
            bend = curvature_term(measure.hessian, points_mm, placement, now, settings.length_mm)
        step = _clamped(spectral, now, settings, bend)
        movement = _movement(step, settings)
        tolerance = settings.tolerance * settings.size_mm
        if movement <= tolerance:
            reason, converged = "step below tolerance", True
            break
        if now.cost_mm2 <= floor:
            reason, converged = "residual at rounding", True
            break
        if iterations >= settings.max_iterations:
            break
        # After a sample, what is far below the uncertainty of the pose is no error either.
        slack = 0.0 if curvature is None else _OF_SIGMA * _sigma_mm(now, spectral)
        linear = movement**2 / settings.size_mm <= max(_LINEAR * settings.size_mm, slack)
        if iterations > 0 and linear and movement**2 / last_movement <= max(tolerance, slack):
            placement, now = _last_step(points_mm, placement, step, now, settings.length_mm)
            iterations += 1
            costs.append(now.cost_mm2)
            reason, converged = "next step below tolerance", True
            break
        trial, there = _downhill(measure, points_mm, placement, step, now, settings)
        if there is None:
            # A step this small that gains nothing is the optimum seen through rounding.
            converged = movement <= np.sqrt(settings.tolerance) * settings.size_mm
            reason = "no further decrease"
            break
        if used is None and _RECOUNT[0] < movement / settings.size_mm < _RECOUNT[1]:
            there = _recounted(points_mm, trial, there, select(there), settings.length_mm)
        placement, now = trial, there
        last_movement = movement
        iterations += 1
        costs.append(now.cost_mm2)
        spectral = spectrum(now.normal_matrix, settings.min_observability)
    if iterations == 0:  # the first look is rough where it starts from nothing
        now = evaluate(measure, points_mm, placement, settings.length_mm, previous=now.feet, used=now.used)
    return FitResult(placement, now, spectral, iterations, reason, converged, tuple(costs), bend)


def _sigma_mm(now: Evaluation, spectral: Spectrum) -> float:
    """Return the standard uncertainty of the least certain observable motion, mm."""
    weakest = float(spectral.values[~spectral.free].min(initial=np.inf))
    return float(np.sqrt(now.cost_mm2 / max(int(np.count_nonzero(now.used)), 1) / weakest))


def _recounted(
    points_mm: Array, placement: Placement, now: Evaluation, chosen: Mask, length_mm: float
) -> Evaluation:
    """Let exactly the chosen points count, by correcting the sums for those that changed."""
    chosen = chosen & np.isfinite(now.feet.distance_mm)
    changed = np.flatnonzero(chosen != now.used)
    if len(changed) == 0:
        return now
    before, after = int(np.count_nonzero(now.used)), int(np.count_nonzero(chosen))
    total = np.zeros((7, 7))
    total[:6, :6], total[:6, 6], total[6, 6] = now.normal_matrix, now.gradient, now.cost_mm2
    feet = Feet(*(a[changed] for a in now.feet))
    rows = rows_of(moved(points_mm[changed], placement), placement, feet, length_mm)
    rows = np.where(np.isfinite(rows), rows, 0.0)
    sign = np.where(chosen[changed], 1.0, -1.0)
    total = (total * max(before, 1) + (rows * sign) @ rows.T) / max(after, 1)
    return now._replace(
        used=chosen, normal_matrix=total[:6, :6], gradient=total[:6, 6], cost_mm2=float(total[6, 6])
    )


def _last_step(
    points_mm: Array, placement: Placement, step: Array, now: Evaluation, length_mm: float
) -> tuple[Placement, Evaluation]:
    """Take a step so small that distances change linearly, without measuring again."""
    after = stepped(placement, step, length_mm)
    distance = np.empty(len(points_mm))

    def work(part: slice) -> None:
        shift = moved(points_mm[part], after) - moved(points_mm[part], placement)
        distance[part] = now.feet.distance_mm[part] + np.einsum("ij,ij->i", now.feet.normal[part], shift)

    in_threads(work, len(points_mm))
    cost = float(np.mean(distance[now.used] ** 2))
    return after, now._replace(feet=now.feet._replace(distance_mm=distance), cost_mm2=cost)


def _clamped(spectral: Spectrum, now: Evaluation, settings: FitSettings, curvature: Array | None) -> Array:
    """Return the step (w length, t), with the rotation clamped and the translation solved anew."""
    step = solve_observable(spectral, now.gradient, curvature)
    angle = float(np.linalg.norm(step[:3])) / settings.length_mm
    if angle > settings.max_rotation_rad:
        step[:3] *= settings.max_rotation_rad / angle
        pull = now.gradient[3:] + now.normal_matrix[3:, :3] @ step[:3]
        step[3:] = -np.linalg.lstsq(now.normal_matrix[3:, 3:], pull, rcond=1e-6)[0]
    return step


def _movement(step: Array, settings: FitSettings) -> float:
    """Return the most that the step moves a point, mm."""
    angle = float(np.linalg.norm(step[:3])) / settings.length_mm
    return angle * settings.size_mm + float(np.linalg.norm(step[3:]))


def without_free_drift(
    start: Placement, end: Placement, spectral: Spectrum, length_mm: float
) -> tuple[Placement, float]:
    """Take back what a fit has moved along the motions that the data cannot tell.

    Parameters
    ----------
    start, end : Placement
        Before and after the fit.
    spectral : Spectrum
        At `end`.
    length_mm : float
        Scale of the rotations, mm.

    Returns
    -------
    placement : Placement
        On the same orbit as `end`, nearer to the start.
    movement_mm : float
        How much was taken back.
    """
    w = vector_from_rotation(end.rotation @ start.rotation.T)
    t = np.linalg.solve(left_jacobian(w), end.position_mm - start.position_mm)
    back = free_part(spectral, np.concatenate([w * length_mm, t]))
    turn = -back[:3] / length_mm
    placement = Placement(
        rotation_from_vector(turn) @ end.rotation, end.position_mm - left_jacobian(turn) @ back[3:]
    )
    return placement, float(np.linalg.norm(back))


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


def _downhill(
    measure: Measure,
    points_mm: Array,
    placement: Placement,
    step: Array,
    now: Evaluation,
    settings: FitSettings,
) -> tuple[Placement, Evaluation | None]:
    """Take the step, or the largest half, quarter ... of it that does not raise the cost."""
    share = 1.0
    for _ in range(_MAX_HALVINGS):
        trial = stepped(placement, share * step, settings.length_mm)
        there = evaluate(measure, points_mm, trial, settings.length_mm, previous=now.feet, used=now.used)
        if there.cost_mm2 <= now.cost_mm2 * (1.0 + 1e-12) + (_ROUNDING * settings.size_mm) ** 2:
            return trial, there
        share *= 0.5
    return placement, None
