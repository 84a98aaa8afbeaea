"""The fit itself: a sample first, then all points, then what was asked for beyond least squares."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmm_align.config import AlignConfig
from cmm_align.errors import NumericsError
from cmm_align.model import MIN_POINTS, Fiducials, FitStep, FreeScale, Nominal
from cmm_align.numerics.fit_steps import FitSettings
from cmm_align.numerics.free_scale import scale_look
from cmm_align.numerics.linearisation import Evaluation, Measure, evaluate
from cmm_align.numerics.outliers import OutlierRule, outlier_rule
from cmm_align.numerics.rigid_fit import FitResult, fit, joined
from cmm_align.numerics.steering import AXES, Placement, Steering
from cmm_align.stages.constraints import datum_terms
from cmm_align.stages.selection import Selection
from cmm_align.stages.way import held_at_the_start
from cmm_align.surfaces.contact_area import contact_areas
from cmm_align.surfaces.protocol import Array
from cmm_align.units import UM_PER_MM

ROBUST_ROUNDS: Final = 12
"""Rounds of fitting and judging the sample; the rule is frozen then."""
ROUNDING: Final = 1e-9
"""Least robust sigma, as a share of the size."""
SAMPLE_TOLERANCE: Final = 1e-6
"""The sample is left when a step moves nothing by more than this: all points say the rest."""
SCALE_ROUNDS: Final = 10
LARGEST_SCALE: Final = 2e-3
"""A free scale that leaves one by more than this is no thermal expansion."""


class Cloud(NamedTuple):
    """The measured points about their centroid, and all that a fit of them needs."""

    points_mm: Array
    """Shape (N, 3), mm, frame `machine`, times `scale`."""
    centroid: Array
    """Shape (3,), mm, frame `machine`."""
    scale: float
    radius_mm: float
    """Tip radius; 0 for contact points."""
    measure: Measure
    settings: FitSettings
    steering: Steering
    touched_mm: Array
    """Centroid as measured, before the fixed scale."""


class Way(NamedTuple):
    """How the cloud came near the nominal."""

    start: Placement
    """Where it began: motions that the data cannot tell are held there."""
    result: FitResult


@dataclass(frozen=True, slots=True)
class Fitted:
    """A cloud at its best placement, and how it came there."""

    cloud: Cloud
    near: FitResult
    """The sample at its best."""
    result: FitResult
    selection: Selection
    steps: tuple[FitStep, ...]
    iterations: int
    certificate: Mapping[str, float] = field(default_factory=dict)
    proof: tuple[int, ...] = ()
    """Rows of the points that prove a minimum zone, a least stock, or that no position will do."""
    free_scale: FreeScale | None = None
    scale_response: Array | None = None
    """Motion per unit of the free scale, shape (6,), scaled, times the scale's standard uncertainty."""


def best_fit(
    cloud: Cloud,
    few: NDArray[np.intp],
    way: Way,
    selection: Selection,
    config: AlignConfig,
    *,
    nominal: Nominal,
    fiducials: Fiducials | None,
    tell: Callable[[str, float], None],
) -> Fitted:
    """Fit a sample robustly, then all points with the rule that the sample gave.

    Parameters
    ----------
    cloud : Cloud
    few : ndarray of int, shape (k,)
        The sample.
    way : Way
    selection : Selection
        Without an outlier rule as yet.
    config : AlignConfig
    nominal : Nominal
    fiducials : Fiducials or None
    tell : callable
        Told what is going on.
    """
    sample, sampled = cloud.points_mm[few], len(few) < len(cloud.points_mm)
    settings = cloud.settings
    if sampled:
        settings = replace(settings, tolerance=max(SAMPLE_TOLERANCE, settings.tolerance))
    steering = cloud.steering.of(few)
    near, selection = _refined(cloud.measure, sample, way.result, settings, steering, selection, config)
    if fiducials is not None:
        sigma = max(float(np.sqrt(near.evaluation.cost_mm2)), ROUNDING * settings.size_mm)
        datum = datum_terms(fiducials, nominal, cloud.touched_mm, cloud.scale, sigma)
        share = len(few) / len(cloud.points_mm)  # a sample stands for all points, fiducials for themselves
        steering = steering._replace(datum=datum._replace(weights=datum.weights * share))
        cloud = cloud._replace(steering=cloud.steering._replace(datum=datum))
        judged, selection = _refined(
            cloud.measure, sample, near, settings, steering, replace(selection, rule=None), config
        )
        near = joined(near, judged)
    placement = near.placement
    if near.spectral.free.any():
        placement = held_at_the_start(cloud.measure, sample, way.start, near, settings, steering)
    result, steps = near, record("way", way.result) + record("sample", near)
    iterations = way.result.iterations + near.iterations
    by_area = config.weights == "area" and bool(near.evaluation.inside.any())
    if by_area:
        tell("areas", 0.3)
        cloud = cloud._replace(steering=cloud.steering._replace(weights=_areas(cloud, placement)))
    if sampled or by_area or placement is not near.placement:
        tell("all points", 0.4)
        result = fit(
            cloud.measure,
            cloud.points_mm,
            placement,
            cloud.settings,
            select=selection,
            curvature=near.curvature if sampled else None,
            steering=cloud.steering,
        )
        steps += record("all", result)
        iterations += result.iterations
    return Fitted(cloud, near, result, selection, steps, iterations)


def scaled(fitted: Fitted) -> Fitted:
    """Go on from the best motions to the best scale of the cloud.

    Parameters
    ----------
    fitted : Fitted

    Raises
    ------
    NumericsError
        If the data cannot tell a scale, or it is not near one.
    """
    cloud, result = fitted.cloud, fitted.result
    length, iterations = cloud.settings.length_mm, fitted.iterations
    steps = fitted.steps
    for _ in range(SCALE_ROUNDS):
        seen = scale_look(cloud.points_mm, result, length, cloud.steering)
        if not np.isfinite(seen.sigma):
            raise NumericsError(
                "the data cannot tell a scale: the motions do all that it could",
                remedy="leave --scale free out, or state temperature and expansion",
            )
        cloud = _grown(cloud, 1.0 + seen.step)
        if abs(cloud.scale - 1.0) > LARGEST_SCALE:
            raise NumericsError(
                f"the free scale runs to {cloud.scale:.5f}",
                expected=f"1 within {LARGEST_SCALE:g}",
                remedy="check the units and the tip radius; fix the scale by temperature and expansion",
            )
        result = fit(
            cloud.measure,
            cloud.points_mm,
            result.placement,
            cloud.settings,
            used=result.evaluation.used,
            previous=result.evaluation.feet,
            steering=cloud.steering,
        )
        steps += record("scale", result)
        iterations += result.iterations
        if abs(seen.step) <= cloud.settings.tolerance:
            break
    else:
        raise NumericsError("the free scale did not settle", remedy="leave --scale free out")
    names = (*AXES, "tip_radius")
    known = {name: float(c) for name, c in zip(names, seen.correlation, strict=True) if np.isfinite(c)}
    return replace(
        fitted,
        cloud=cloud,
        result=result,
        steps=steps,
        iterations=iterations,
        free_scale=FreeScale(seen.sigma, known),
        scale_response=seen.response * seen.sigma,
    )


def with_criterion(fitted: Fitted, criterion: str, limits_mm: tuple[Array, Array]) -> Fitted:
    """Go on from least squares to another criterion.

    Parameters
    ----------
    fitted : Fitted
    criterion : str
        minimum-zone, least-stock or within-tolerance.
    limits_mm : tuple of ndarray, each of shape (N,), mm
        Least and largest deviation of every point, for within-tolerance; empty for the others.

    Raises
    ------
    NumericsError
        If it does not converge.
    """
    from cmm_align.numerics import minimum_zone as zone  # only where it is asked for

    cloud, result = fitted.cloud, fitted.result
    now, lock = result.evaluation, cloud.steering.lock
    motions = None
    if lock is not None or result.spectral.free.any():  # what is held stays held
        motions = result.spectral.motions[:, ~result.spectral.free]
    solve: Callable[..., zone.ZoneResult]
    if criterion == "within-tolerance":
        solve = partial(zone.within_tolerance, lower_mm=limits_mm[0], upper_mm=limits_mm[1])
    else:
        solve = zone.minimum_zone if criterion == "minimum-zone" else zone.least_stock
    found = solve(
        cloud.measure,
        cloud.points_mm,
        result.placement,
        cloud.settings,
        used=now.used & now.inside,
        previous=now.feet,
        motions=motions,
    )
    shown = criterion == "within-tolerance" and found.passes  # one such position is enough
    if not (found.converged or shown):
        raise NumericsError(
            f"the {criterion} fit did not converge ({found.stop_reason})",
            remedy="use --criterion least-squares",
        )
    certificate = {
        "zone_um": found.t_mm * UM_PER_MM,
        "residual": float(found.certificate_residual),
        "n_active": float(len(found.active)),
        "gap_um": found.gap_mm * UM_PER_MM,
        "proof_reach_um": found.proof_reach_mm * UM_PER_MM,
    }
    done = result._replace(
        placement=found.placement, evaluation=found.evaluation, stop_reason=found.stop_reason
    )
    after = FitStep("criterion", 0.0, found.evaluation.cost_mm2, int(np.count_nonzero(found.evaluation.used)))
    return replace(
        fitted,
        result=done,
        steps=(*fitted.steps, after),
        iterations=fitted.iterations + found.iterations,
        certificate=certificate,
        proof=tuple(int(k) for k in found.active),
    )


def record(phase: str, result: FitResult) -> tuple[FitStep, ...]:
    """Return the record of a fit as it goes into the report."""
    return tuple(FitStep(phase, float(k.movement_mm), float(k.cost_mm2), k.n_used) for k in result.looks)


def _refined(
    measure: Measure,
    sample: Array,
    start: FitResult,
    settings: FitSettings,
    steering: Steering,
    selection: Selection,
    config: AlignConfig,
) -> tuple[FitResult, Selection]:
    """Fit the sample and judge it in turn, until the same points are left out twice; freeze that rule."""
    result = fit(measure, sample, start.placement, settings, select=selection, steering=steering)
    on = result.evaluation.used & result.evaluation.inside
    if config.outliers == "keep" or config.max_iterations == 0 or int(np.count_nonzero(on)) < MIN_POINTS:
        return result, selection
    selection = replace(selection, rule=_rule(result.evaluation, settings))
    for _ in range(ROBUST_ROUNDS):
        chosen = selection(result.evaluation)
        if np.array_equal(chosen, result.evaluation.used):
            break
        feet = result.evaluation.feet
        again = fit(
            measure, sample, result.placement, settings, used=chosen, previous=feet, steering=steering
        )
        result = joined(result, again)
        if (again.evaluation.used & again.evaluation.inside).any():
            selection = replace(selection, rule=_rule(result.evaluation, settings))
    return result, selection


def _rule(now: Evaluation, settings: FitSettings) -> OutlierRule:
    """Make the outlier rule from the points that count as yet: what is out does not hide what is left."""
    on = now.used & now.inside
    x, y, e = (a[on] for a in now.feet[:3])
    return outlier_rule(x, y, e, ROUNDING * settings.size_mm)


def _areas(cloud: Cloud, placement: Placement) -> Array:
    """Return the share of the nominal's area that each point on it stands for, mean 1; 0 for the others."""
    there = evaluate(cloud.measure, cloud.points_mm, placement, cloud.settings.length_mm)
    on = there.inside
    areas = np.zeros(len(on))
    feet = there.feet
    areas[on] = contact_areas(feet.x_mm[on], feet.y_mm[on], feet.normal[on])
    return np.asarray(areas / areas[on].mean(), dtype=np.float64)


def _grown(cloud: Cloud, factor: float) -> Cloud:
    """Return the cloud scaled about its centroid, fiducials too."""
    datum = cloud.steering.datum
    if datum is not None:
        datum = datum._replace(points_mm=datum.points_mm * factor)
    return cloud._replace(
        points_mm=cloud.points_mm * factor,
        scale=cloud.scale * factor,
        steering=cloud.steering._replace(datum=datum),
    )
