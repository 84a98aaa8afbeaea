"""Newton's method for the rigid motion that lays points on a surface.

The unknown is the *total* motion: the points stay as they were measured, every iteration moves the
originals anew, so nothing drifts. The matrix is Gauss-Newton's plus the second-order term of the distance
where the surface is smooth, so that the steps converge quadratically although form error is left.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmm_align.numerics.fit_steps import (
    LINEAR,
    ROUNDING,
    FitSettings,
    clamped,
    downhill,
    last_step,
    movement_of,
)
from cmm_align.numerics.foot_point import Feet
from cmm_align.numerics.linearisation import (
    Evaluation,
    Measure,
    curvature_term,
    evaluate,
    moved,
    rows_of,
    total_weight,
)
from cmm_align.numerics.observability import Spectrum, free_part, spectrum
from cmm_align.numerics.rotations import (
    left_jacobian,
    rotation_from_vector,
    vector_from_rotation,
)
from cmm_align.numerics.steering import FREELY, Placement, Steering, allowed_motions, held

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_ULPS: Final = 4.0 * float(np.finfo(np.float64).eps)
_RECOUNT: Final = (1e-5, 1e-3)
"""Which points count is decided anew only after steps of this share of the size: after larger ones a
cloud could slide off the surface and call the few points left a good fit, after smaller ones it stays. Who
leaves then stays out: on the brink, a point may leave because it counts and come back because it does not."""
_OF_SIGMA: Final = 0.03
"""After a sample, an error this small beside the standard uncertainty of the pose is no error."""


class Look(NamedTuple):
    """One line of the record of a fit: the state after a step."""

    movement_mm: float
    """The most that the step has moved a point, mm; 0 for the start."""
    cost_mm2: float
    """Mean squared distance, mm^2."""
    n_used: int


class FitResult(NamedTuple):
    """How a fit ended."""

    placement: Placement
    evaluation: Evaluation
    spectral: Spectrum
    iterations: int
    """Steps taken."""
    stop_reason: str
    converged: bool
    looks: tuple[Look, ...]
    """The start, and the state after each step."""
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
    steering: Steering = FREELY,
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
    steering : Steering
        Weights, datum terms and locked motions.

    Returns
    -------
    FitResult
        The best placement seen, never one that is worse than the start.

    Notes
    -----
    Safeguards: steps in the observable motions only; rotation clamped, translation re-solved; a step that
    raises the cost is halved.
    """
    placement, length = held(steering.lock, start), settings.length_mm
    now = evaluate(measure, points_mm, placement, length, previous=previous, used=used, steering=steering)
    if used is None:
        now = _recounted(points_mm, placement, now, select(now), length, steering)
    bend = curvature
    looks = [_look(0.0, now)]
    iterations, left = 0, np.zeros(len(points_mm), dtype=bool)
    reason, converged = "max iterations", False
    last_movement = np.inf
    spectral = _spectrum(placement, now, settings, steering)
    while True:
        if curvature is None and measure.hessian is not None:
            bend = curvature_term(measure.hessian, points_mm, placement, now, length, steering.weights)
        step = clamped(spectral, now, settings, bend, locked=steering.lock is not None)
        movement = movement_of(step, settings)
        tolerance = settings.tolerance * settings.size_mm
        # After a sample, what is far below the uncertainty of the pose is no error either.
        slack = 0.0 if curvature is None else _OF_SIGMA * _sigma_mm(now, spectral)
        linear = movement**2 / settings.size_mm <= max(LINEAR * settings.size_mm, slack)
        ends = linear and movement**2 / last_movement <= max(tolerance, slack)
        rest, may_step = _at_rest(movement, now, settings), 0 < iterations < settings.max_iterations
        if rest or (ends and may_step):
            if may_step and (not rest or _is_all_that_is_left(movement, now, settings)):
                placement, now = last_step(points_mm, placement, step, now, length, steering)
                iterations += 1
                looks.append(_look(movement, now))
            reason, converged = rest or "next step below tolerance", True
            break
        if iterations >= settings.max_iterations:
            break
        trial, there = downhill(measure, points_mm, placement, step, now, settings, steering)
        if there is None:
            # A step this small that gains nothing is the optimum seen through rounding.
            converged = movement <= np.sqrt(settings.tolerance) * settings.size_mm
            reason = "no further decrease"
            break
        if used is None and _RECOUNT[0] < movement / settings.size_mm < _RECOUNT[1]:
            chosen = select(there) & ~left
            left |= there.used & ~chosen
            there = _recounted(points_mm, trial, there, chosen, length, steering)
        placement, now, last_movement = trial, there, movement
        iterations += 1
        looks.append(_look(movement, now))
        spectral = _spectrum(placement, now, settings, steering)
    return FitResult(placement, now, spectral, iterations, reason, converged, tuple(looks), bend)


def joined(first: FitResult, second: FitResult) -> FitResult:
    """Return the second fit with the record of the first before it: what went on where it had ended."""
    looks = first.looks + second.looks[1:]
    return second._replace(iterations=first.iterations + second.iterations, looks=looks)


def _at_rest(movement: float, now: Evaluation, settings: FitSettings) -> str:
    """Say why no further step needs measuring; nothing if one does."""
    if movement <= settings.tolerance * settings.size_mm:
        return "step below tolerance"
    return "residual at rounding" if now.cost_mm2 <= (ROUNDING * settings.size_mm) ** 2 else ""


def _is_all_that_is_left(movement: float, now: Evaluation, settings: FitSettings) -> bool:
    """Return whether the residual is no more than a short step explains: noise-free points, nearly home."""
    size, rms = settings.size_mm, float(np.sqrt(now.cost_mm2))
    return _ULPS * size < rms <= movement <= float(np.sqrt(LINEAR)) * size


def _look(movement: float, now: Evaluation) -> Look:
    return Look(movement, now.cost_mm2, int(np.count_nonzero(now.used)))


def _spectrum(placement: Placement, now: Evaluation, settings: FitSettings, steering: Steering) -> Spectrum:
    allowed = allowed_motions(steering.lock, placement, settings.length_mm)
    return spectrum(now.normal_matrix, settings.min_observability, allowed, now.datum_matrix)


def _sigma_mm(now: Evaluation, spectral: Spectrum) -> float:
    """Return the standard uncertainty of the least certain observable motion, mm."""
    weakest = float(spectral.values[~spectral.free].min(initial=np.inf))
    return float(np.sqrt(now.cost_mm2 / max(int(np.count_nonzero(now.used)), 1) / weakest))


def _recounted(
    points_mm: Array,
    placement: Placement,
    now: Evaluation,
    chosen: Mask,
    length_mm: float,
    steering: Steering,
) -> Evaluation:
    """Let exactly the chosen points count, by correcting the sums for those that changed."""
    chosen = chosen & np.isfinite(now.feet.distance_mm)
    changed = np.flatnonzero(chosen != now.used)
    if len(changed) == 0:
        return now
    weights = steering.weights
    before, after = total_weight(now.used, weights), total_weight(chosen, weights)
    total = np.zeros((7, 7))
    total[:6, :6], total[:6, 6], total[6, 6] = now.normal_matrix, now.gradient, now.cost_mm2
    feet = now.feet.of(changed)
    rows = rows_of(moved(points_mm[changed], placement), placement, feet, length_mm)
    rows = np.where(np.isfinite(rows), rows, 0.0)
    sign = np.where(chosen[changed], 1.0, -1.0)
    if weights is not None:
        sign = sign * weights[changed]
    total = (total * before + (rows * sign) @ rows.T) / after
    held = None if now.datum_matrix is None else now.datum_matrix * (before / after)
    return now._replace(
        datum_matrix=held,
        used=chosen,
        normal_matrix=total[:6, :6],
        gradient=total[:6, 6],
        cost_mm2=float(total[6, 6]),
    )


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
