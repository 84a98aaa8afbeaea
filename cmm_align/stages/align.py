"""Stage 2, align: the rigid motion that lays the measured tip centres on the equidistant surface.

1. Find the way: a few points on a light net of facets (the paper's method), from the frame as it is; where
   that may have led astray, a search over all poses.
2. Refine: the same points, orthogonal foot points on the smooth nominal, outliers left out.
   Ask whether the result looks like one of the usual mistakes (tip radius, side, contact points).
3. Finish: all points that lie on the nominal and are no outliers, plain least squares.
4. Check: the deviation once more by a second path, from a smooth surface through the equidistant points.

The source paper is Photonics 2025, 12(5), 469, doi 10.3390/photonics12050469, section 2.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from cmm_align.config import AlignConfig
from cmm_align.errors import NumericsError, UsageError, WrongStageError
from cmm_align.model import (
    MIN_POINTS,
    Alignment,
    FitReport,
    Nominal,
    PointKind,
    PointSet,
    frozen_array,
)
from cmm_align.numerics.linearisation import Evaluation, Measure, Placement, even_sample
from cmm_align.numerics.observability import free_motions_in_words
from cmm_align.numerics.outliers import OutlierRule, outlier_rule, outliers
from cmm_align.numerics.rigid_fit import FitResult, FitSettings, Select, fit, on_the_surface
from cmm_align.numerics.triangle_net import triangle_net
from cmm_align.pose import Pose
from cmm_align.stages.fit_doctor import diagnose, explain_failure
from cmm_align.stages.plausibility import check_measured
from cmm_align.stages.pose_uncertainty import covariance_of, pose_sigma, turned
from cmm_align.stages.second_path import two_path_difference_mm, warnings_of
from cmm_align.stages.way import find_the_way, held_at_the_start
from cmm_align.surfaces.distance import facet_measure, smooth_measure
from cmm_align.surfaces.protocol import Array, Mask
from cmm_align.units import NM_PER_MM, RAD_PER_DEG, UM_PER_MM

CHOICES: Final = {
    "distance": ("smooth", "facet"),
    "outliers": ("reject", "keep"),
    "search": ("auto", "always", "never"),
    "criterion": ("least-squares", "minimum-zone", "least-stock"),
}
"""What the settings with names may be."""
ROBUST_ROUNDS: Final = 12
"""Rounds of fitting and judging the sample; the rule is frozen then."""
ROUNDING: Final = 1e-9
"""Least robust sigma, as a share of the size."""
SAMPLE_TOLERANCE: Final = 1e-6
"""The sample is left when a step moves nothing by more than this: all points say the rest."""
LARGEST_RMS: Final = 0.01
"""A fit whose RMS is above this share of the size has found nothing."""
ON_SURFACE: Final = 0.5
"""Share of the points that must end on the nominal."""
ROUGHNESS_FACTOR: Final = 0.2
"""Mean square of the slopes of noise in squares of its PV over the spacing, with a margin of three."""

NO_REPORT: Final = FitReport(0, "", False, (), {}, float("nan"), (), "smooth", 0, 0)

Progress = Callable[[str, float], None]


def align(
    measured: PointSet,
    nominal: Nominal,
    config: AlignConfig = AlignConfig(),
    *,
    start: Pose | None = None,
    progress: Progress | None = None,
) -> Alignment:
    """Lay measured points on a nominal by least squares of the deviations.

    Parameters
    ----------
    measured : PointSet
        Tip centres, mm, frame `machine`; contact points if their kind says so (then the tip radius is
        not taken off again).
    nominal : Nominal
        With its equidistant surface; its net too for ``distance = "facet"``.
    config : AlignConfig
    start : Pose, optional
        ``part_from_machine`` to start from; without it the machine's frame, and a search over all poses
        where that is not good enough.
    progress : callable, optional
        Told what is going on and the share that is done.

    Returns
    -------
    Alignment
        Deviations are along the normal of the nominal at the foot point, positive = excess material, NaN
        for points that do not lie on the nominal. Motions that the data cannot tell keep their start value
        and are named in the report.

    Raises
    ------
    WrongStageError, GeometryError, UnitsError
        If the points cannot be a measurement of this nominal.
    NumericsError
        If no fit is found or it does not converge; no result is returned then.

    Notes
    -----
    Sign: a bump outwards is positive. Accuracy tested: noise-free points from 20, 10, 20 mm and 20, 10, 20
    degrees end below 1e-6 nm PV.
    """
    for name, known in CHOICES.items():
        if getattr(config, name) not in known:
            raise UsageError(f"{name} {getattr(config, name)!r}", expected=", ".join(known))
    check_measured(measured, nominal)
    contact = measured.kind is PointKind.CONTACT
    radius = 0.0 if contact else nominal.tip_radius_mm
    tell = progress or (lambda _what, _share: None)

    centroid = measured.points_mm.mean(axis=0)
    centred = measured.points_mm - centroid
    length = float(np.sqrt(np.mean(np.sum(centred**2, axis=1))))
    size = nominal.surface.bounds.diagonal_mm
    settings = _settings(config, nominal, size, length)
    measure = _measure(nominal, radius, config)

    tell("finding the way", 0.0)
    evaluate_only = config.max_iterations == 0
    few = centred[even_sample(len(centred), config.coarse_points)]
    way_start, way, ties = find_the_way(few, centroid, nominal, radius, settings, start, config.search)
    tell("refining", 0.2)
    sampled = len(few) < len(centred)
    begun = replace(settings, tolerance=SAMPLE_TOLERANCE) if sampled else settings
    near, select = _refine(measure, few, way, begun, config)
    placement = near.placement
    if near.spectral.free.any():
        placement = held_at_the_start(measure, few, way_start, near, settings)
    result = near
    if sampled or placement is not near.placement:
        tell("all points", 0.4)
        bend = near.curvature if sampled else None
        result = fit(measure, centred, placement, settings, select=select, curvature=bend)
    notes = ties
    if not evaluate_only:
        notes += _consulted(
            measured, nominal, near, centroid, start or Pose.identity("part", "machine"), config
        )
        try:
            _check_fit(result, size)
        except NumericsError as failure:
            raise _explained(failure, measured, nominal, start) from None
    certificate: Mapping[str, float] = {}
    if config.criterion != "least-squares" and not evaluate_only:
        tell(config.criterion, 0.6)
        result, certificate = _zone(measure, centred, result, settings, config)
    tell("second path", 0.8)
    bare = _laid(measured, nominal, result, centroid, radius)
    two_path = two_path_difference_mm(
        centred, result.placement, result.evaluation.feet, result.evaluation.inside, nominal, radius, config
    )
    fits = (way, near) if result is near else (way, near, result)
    turn = nominal.surface_from_part.inverse()
    spectral = turned(result.spectral, turn)
    covariance, correlated = covariance_of(result, centred, length, turn.rotation)
    inside = result.evaluation.inside
    middle = bare.part_from_machine.apply(centroid[None])[0]
    report = FitReport(
        iterations=sum(f.iterations for f in fits),
        stop_reason="evaluated only" if evaluate_only else result.stop_reason,
        converged=result.converged,
        unobservable=free_motions_in_words(spectral, middle, length),
        pose_sigma=pose_sigma(covariance, spectral),
        two_path_difference_nm=two_path * NM_PER_MM,
        cost_history_mm2=sum((f.costs_mm2 for f in fits), ()),
        distance=config.distance,
        n_outside=int(np.count_nonzero(~inside)),
        n_outliers=int(np.count_nonzero(inside & ~bare.used)),
        warnings=notes + warnings_of(measured, nominal, inside, inside & ~bare.used),
        criterion=config.criterion,
        certificate=certificate,
        correlated=correlated,
    )
    return replace(bare, covariance=frozen_array(covariance), report=report)


def _pose(placed: Placement, centroid: Array, nominal: Nominal) -> Pose:
    """Return ``part_from_machine`` of a placement of the cloud."""
    shift = placed.position_mm - placed.rotation @ centroid
    return nominal.surface_from_part.inverse() @ Pose(placed.rotation, shift, "surface", "machine")


def _laid(
    measured: PointSet, nominal: Nominal, result: FitResult, centroid: Array, radius: float
) -> Alignment:
    """Return the points as the fit has laid them; what is known of the pose comes on top."""
    part_from_machine = _pose(result.placement, centroid, nominal)
    part_from_surface = nominal.surface_from_part.inverse()
    feet, inside = result.evaluation.feet, result.evaluation.inside
    normals = part_from_surface.rotate(feet.normal)
    tips_part = part_from_machine.apply(measured.points_mm)
    return Alignment(
        nominal=nominal,
        part_from_machine=part_from_machine,
        covariance=frozen_array(np.zeros((6, 6))),
        tip_centre_machine_mm=measured.points_mm,
        tip_centre_part_mm=frozen_array(tips_part),
        contact_part_mm=frozen_array(tips_part - radius * normals),
        normals=frozen_array(normals),
        deviation_mm=frozen_array(np.where(inside, feet.distance_mm, np.nan)),
        used=frozen_array(result.evaluation.used & inside, np.bool_),
        ids=measured.ids,
        report=NO_REPORT,
    )


def _settings(config: AlignConfig, nominal: Nominal, size: float, length: float) -> FitSettings:
    """Return the settings of a fit.

    A nominal that is rough itself breaks its own symmetries: what its roughness can tell is not told.
    """
    rough = 0.0
    if nominal.quality is not None:
        slope = nominal.quality.surface_error_pv_nm / NM_PER_MM / max(min(nominal.quality.spacing_mm), 1e-12)
        rough = ROUGHNESS_FACTOR * slope**2 if np.isfinite(slope) else 0.0
    return FitSettings(
        size_mm=size,
        length_mm=length,
        tolerance=config.step_tolerance,
        max_iterations=config.max_iterations,
        max_rotation_rad=config.max_rotation_step_deg * RAD_PER_DEG,
        min_observability=max(config.min_observability, rough),
    )


def _measure(nominal: Nominal, radius: float, config: AlignConfig) -> Measure:
    """Return how deviations are measured in the last iterations."""
    if config.distance == "smooth":
        return smooth_measure(nominal.surface, nominal.side, radius)
    net = nominal.equidistant
    if net is None:
        raise UsageError("the facets of the nominal were not loaded", expected="distance = smooth")
    points = net.points_mm if radius > 0.0 else net.nominal_points_mm
    return facet_measure(triangle_net(nominal.surface_from_part.apply(points), net.triangles), nominal.side)


def _refine(
    measure: Measure, few: Array, way: FitResult, settings: FitSettings, config: AlignConfig
) -> tuple[FitResult, Select]:
    """Fit the sample and judge it in turn, until the same points are left out twice; freeze that rule."""
    result = fit(measure, few, way.placement, settings)
    few_on = int(np.count_nonzero(result.evaluation.inside)) < MIN_POINTS
    if config.outliers == "keep" or config.max_iterations == 0 or few_on:
        return result, on_the_surface
    rule = _rule(result.evaluation, settings)
    for _ in range(ROBUST_ROUNDS):
        chosen = _select(rule)(result.evaluation)
        if np.array_equal(chosen, result.evaluation.used):
            break
        again = fit(measure, few, result.placement, settings, used=chosen, previous=result.evaluation.feet)
        result = again._replace(
            iterations=result.iterations + again.iterations, costs_mm2=result.costs_mm2 + again.costs_mm2
        )
        if result.evaluation.inside.any():
            rule = _rule(result.evaluation, settings)
    return result, _select(rule)


def _rule(now: Evaluation, settings: FitSettings) -> OutlierRule:
    """Make the outlier rule from the points that count as yet: what is out does not hide what is left."""
    on = now.used & now.inside
    x, y, e = (a[on] for a in now.feet[:3])
    return outlier_rule(x, y, e, ROUNDING * settings.size_mm)


def _select(rule: OutlierRule) -> Select:
    """Choose the points that lie on the surface and are no outliers."""

    def select(now: Evaluation) -> Mask:
        wrong = outliers(rule, now.feet.x_mm, now.feet.y_mm, now.feet.distance_mm)
        return now.inside & ~wrong

    return select


def _zone(
    measure: Measure, centred: Array, result: FitResult, settings: FitSettings, config: AlignConfig
) -> tuple[FitResult, Mapping[str, float]]:
    """Go on from least squares to the criterion asked for; return its proof beside it."""
    from cmm_align.numerics.minimum_zone import least_stock, minimum_zone  # only where it is asked for

    solve = minimum_zone if config.criterion == "minimum-zone" else least_stock
    now = result.evaluation
    zone = solve(measure, centred, result.placement, settings, used=now.used & now.inside, previous=now.feet)
    if not zone.converged:
        raise NumericsError(
            f"the {config.criterion} fit did not converge ({zone.stop_reason})",
            remedy="use --criterion least-squares",
        )
    certificate = {
        "zone_um": zone.t_mm * UM_PER_MM,
        "residual": float(zone.certificate_residual),
        "n_active": float(len(zone.active)),
    }
    done = result._replace(
        placement=zone.placement,
        evaluation=zone.evaluation,
        iterations=result.iterations + zone.iterations,
        stop_reason=zone.stop_reason,
    )
    return done, certificate


def _consulted(
    measured: PointSet, nominal: Nominal, near: FitResult, centroid: Array, frame: Pose, config: AlignConfig
) -> tuple[str, ...]:
    """Ask the fit doctor; refuse on clear evidence of a mistake, pass suspicions on."""
    if not _plausible(near, nominal.surface.bounds.diagonal_mm):
        return ()
    found = _pose(near.placement, centroid, nominal)
    contact = measured.kind is PointKind.CONTACT
    seen = diagnose(measured.points_mm, nominal, found, frame, contact=contact)
    if seen.clear and not config.trust_me:
        first = seen.clear[0]
        raise WrongStageError(
            first.words, where=measured.source, remedy=f"{first.remedy}; --trust-me goes on all the same"
        )
    return seen.warnings + tuple(finding.words for finding in seen.clear)


def _plausible(result: FitResult, size: float) -> bool:
    """Return whether a fit has found the part at all."""
    on = float(np.mean(result.evaluation.inside))
    return on >= ON_SURFACE and float(np.sqrt(result.evaluation.cost_mm2)) <= LARGEST_RMS * size


def _explained(
    failure: NumericsError, measured: PointSet, nominal: Nominal, start: Pose | None
) -> NumericsError:
    """Add what would make the points fit, if anything does."""
    contact = measured.kind is PointKind.CONTACT
    reasons = explain_failure(measured.points_mm, nominal, start=start, contact=contact)
    if not reasons:
        return failure
    return NumericsError(
        failure.what, where=measured.source, remedy=f"{reasons[0].words}; {reasons[0].remedy}"
    )


def _check_fit(result: FitResult, size: float) -> None:
    """Refuse a fit that has found nothing: a refusal is better than a plausible wrong answer."""
    share = float(np.mean(result.evaluation.inside))
    rms = float(np.sqrt(result.evaluation.cost_mm2))
    if share < ON_SURFACE:
        raise NumericsError(
            f"no fit: only {100.0 * share:.0f} % of the points lie on the nominal",
            remedy="check that the files belong together, or give a start pose with --initial",
        )
    if rms > LARGEST_RMS * size:
        raise NumericsError(
            f"no fit: the RMS is {rms:.3g} mm on a part of {size:.4g} mm",
            remedy="check the files, the side and the tip radius, or give a start pose with --initial",
        )
    if not result.converged:
        raise NumericsError(
            f"not converged after {result.iterations} iterations ({result.stop_reason}, RMS {rms:.3g} mm)",
            remedy="give a start pose with --initial",
        )
