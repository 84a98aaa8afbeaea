"""Stage 2, align: the rigid motion that lays the measured tip centres on the equidistant surface.

1. Find the way: a few points on a light net of facets, from wherever the part lies (the paper's method).
2. Refine: the same points, orthogonal foot points on the smooth nominal.
3. Finish: all points that lie on the nominal.
4. Check: the deviation once more by a second path, from a smooth surface through the equidistant points.

The source paper is Photonics 2025, 12(5), 469, doi 10.3390/photonics12050469, section 2.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np

from cmm_align.config import AlignConfig
from cmm_align.errors import NumericsError, UsageError
from cmm_align.model import Alignment, FitReport, Nominal, PointKind, PointSet, frozen_array
from cmm_align.numerics.foot_point import Feet, foot_points
from cmm_align.numerics.linearisation import Measure, Placement, evaluate, in_threads, moved
from cmm_align.numerics.observability import Spectrum, free_motions_in_words, spectrum, uncertain_axes
from cmm_align.numerics.rigid_fit import FitResult, FitSettings, fit, without_free_drift
from cmm_align.numerics.triangle_net import triangle_net
from cmm_align.pose import Pose
from cmm_align.stages.plausibility import check_measured
from cmm_align.surfaces.distance import facet_measure, light_net, smooth_measure
from cmm_align.surfaces.equidistant import limits_of
from cmm_align.surfaces.protocol import Array, Mask, Surface
from cmm_align.units import NM_PER_MM, RAD_PER_DEG, UM_PER_MM, URAD_PER_RAD

DISTANCES: Final = ("smooth", "facet")
COARSE_TOLERANCE: Final = 1e-3
"""The light net is left when a step moves nothing by more than this share of the size."""
SAMPLE_TOLERANCE: Final = 1e-6
"""The sample is left when a step moves nothing by more than this: all points say the rest."""
COARSE_OBSERVABILITY: Final = 1e-5
"""Facets break symmetries a little: on them, weaker motions than this are left alone."""
LARGEST_RMS: Final = 0.01
"""A fit whose RMS is above this share of the size has found nothing."""
ON_SURFACE: Final = 0.5
"""Share of the points that must end on the nominal."""
WAY_POINTS: Final = 5000
"""Points that are enough to find the way."""
ROUGHNESS_FACTOR: Final = 0.2
"""Mean square of the slopes of noise in squares of its PV over the spacing, with a margin of three."""
FREE_ROUNDS: Final = 20
TRIMS: Final = 6
"""Rounds in which stray points are left out while the way is found."""
TWO_PATH_POINTS: Final = 200_000
"""Points that are measured by both paths."""
MAD_SIGMA: Final = 1.4826
"""Sigma of a normal distribution in median absolute deviations."""
SUSPECT: Final = 6.0
"""Points beyond this many robust sigma are reported."""

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
        ``part_from_machine`` to start from; without it the frames are taken to be near each other, or the
        cloud is moved onto the nominal first if they are not.
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
    if config.distance not in DISTANCES:
        raise UsageError(f"distance {config.distance!r}", expected="smooth or facet")
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
    few = centred[:: max(1, -(-len(centred) // config.coarse_points))]
    way_start, way = _find_the_way(few, centroid, nominal, radius, settings, start)
    tell("refining", 0.2)
    sampled = len(few) < len(centred)
    near = fit(
        measure, few, way.placement, replace(settings, tolerance=SAMPLE_TOLERANCE) if sampled else settings
    )
    begun = near.placement
    if near.spectral.free.any():
        begun = _held_at_the_start(measure, few, way_start, near, settings)
    result = near
    if sampled or begun is not near.placement:
        tell("all points", 0.4)
        result = fit(measure, centred, begun, settings, curvature=near.curvature if sampled else None)
    fits = (way, near) if result is near else (way, near, result)
    done = sum(f.iterations for f in fits)
    costs = sum((f.costs_mm2 for f in fits), ())
    _check_fit(result, size, evaluate_only)
    tell("second path", 0.8)

    surface_from_machine = Pose(
        result.placement.rotation,
        result.placement.position_mm - result.placement.rotation @ centroid,
        "surface",
        "machine",
    )
    part_from_surface = nominal.surface_from_part.inverse()
    part_from_machine = part_from_surface @ surface_from_machine
    feet, inside = result.evaluation.feet, result.evaluation.inside
    deviation = np.where(inside, feet.distance_mm, np.nan)
    two_path = _two_path_difference_mm(centred, result.placement, feet, inside, nominal, radius, config)
    normals = part_from_surface.rotate(feet.normal)
    tips_part = part_from_machine.apply(measured.points_mm)
    contacts = tips_part - radius * normals
    covariance = _covariance(result, length, part_from_surface.rotation)
    report = FitReport(
        iterations=done,
        stop_reason="evaluated only" if evaluate_only else result.stop_reason,
        converged=result.converged,
        unobservable=free_motions_in_words(
            _turned(result.spectral, part_from_surface), part_from_machine.apply(centroid[None])[0], length
        ),
        pose_sigma=_pose_sigma(covariance, _turned(result.spectral, part_from_surface)),
        two_path_difference_nm=two_path * NM_PER_MM,
        cost_history_mm2=costs,
        distance=config.distance,
        n_outside=int(np.count_nonzero(~inside)),
        n_outliers=0,
        warnings=_warnings(measured, nominal, deviation[inside], measured.ids[inside]),
    )
    return Alignment(
        nominal=nominal,
        part_from_machine=part_from_machine,
        covariance=frozen_array(covariance),
        tip_centre_machine_mm=measured.points_mm,
        tip_centre_part_mm=frozen_array(tips_part),
        contact_part_mm=frozen_array(contacts),
        normals=frozen_array(normals),
        deviation_mm=frozen_array(deviation),
        used=frozen_array(result.evaluation.used & inside, np.bool_),
        ids=measured.ids,
        report=report,
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


def _find_the_way(
    few: Array,
    centroid: Array,
    nominal: Nominal,
    radius: float,
    settings: FitSettings,
    start: Pose | None,
) -> tuple[Placement, FitResult]:
    """Bring the cloud near the nominal on a light net of facets; every point counts, wherever it lies."""
    few = few[:: -(-len(few) // WAY_POINTS)]
    net = light_net(nominal.surface, nominal.side, radius)
    measure = facet_measure(net, nominal.side)
    surface_from_part = nominal.surface_from_part
    pose = surface_from_part @ (start or Pose.identity("part", "machine"))
    placement = Placement(pose.rotation, pose.apply(centroid[None])[0])
    everywhere = np.ones(len(few), dtype=bool)
    if start is None:
        there = evaluate(measure, few, placement, settings.length_mm, used=everywhere)
        near = float(np.mean(there.inside)) >= ON_SURFACE / 2.0
        if not near and settings.max_iterations > 0:  # not near each other: move the cloud onto the nominal
            placement = Placement(pose.rotation, net.points_mm.mean(axis=0))
    coarse = replace(
        settings,
        tolerance=COARSE_TOLERANCE,
        min_observability=max(COARSE_OBSERVABILITY, settings.min_observability),
    )
    way = fit(measure, few, placement, coarse, used=everywhere)
    for _ in range(TRIMS):  # touches of the fixture must not lead astray; who is kept, all points say later
        kept = _near_the_rest(way.evaluation.feet.distance_mm, COARSE_TOLERANCE * settings.size_mm)
        if np.array_equal(kept, way.evaluation.used):
            break
        again = fit(measure, few, way.placement, coarse, used=kept)
        way = again._replace(
            iterations=way.iterations + again.iterations, costs_mm2=way.costs_mm2 + again.costs_mm2
        )
    return placement, way


def _held_at_the_start(
    measure: Measure, few: Array, start: Placement, near: FitResult, settings: FitSettings
) -> Placement:
    """Move back along the free motions to where the part lay before the fit."""
    placement, spectral = near.placement, near.spectral
    for _ in range(FREE_ROUNDS):
        placement, movement = without_free_drift(start, placement, spectral, settings.length_mm)
        if movement <= settings.tolerance * settings.size_mm:
            break
        there = evaluate(measure, few, placement, settings.length_mm)
        spectral = spectrum(there.normal_matrix, settings.min_observability)
    return placement


def _near_the_rest(distance_mm: Array, least_mm: float) -> Mask:
    """Return which distances lie within three robust sigma, or within `least_mm`, of their median."""
    off = np.abs(distance_mm - np.median(distance_mm))
    kept: Mask = off <= max(3.0 * MAD_SIGMA * float(np.median(off)), least_mm)
    return kept


def _check_fit(result: FitResult, size: float, evaluate_only: bool) -> None:
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
    if not result.converged and not evaluate_only:
        raise NumericsError(
            f"not converged after {result.iterations} iterations ({result.stop_reason}, RMS {rms:.3g} mm)",
            remedy="give a start pose with --initial",
        )


def _two_path_difference_mm(
    centred: Array,
    placement: Placement,
    feet: Feet,
    inside: Mask,
    nominal: Nominal,
    radius: float,
    config: AlignConfig,
) -> float:
    """Measure deviations again on the smooth equidistant surface; return the largest difference.

    For facets the other path is the foot point on the nominal, minus the tip radius. Of more than
    `TWO_PATH_POINTS` points an even sample is taken.
    """
    pick = slice(None, None, -(-len(centred) // TWO_PATH_POINTS))
    centred, inside, feet = centred[pick], inside[pick], Feet(*(a[pick] for a in feet))
    facet = config.distance == "facet"
    other: Surface | None = nominal.surface if facet else nominal.equidistant_surface
    if other is None:
        return float("nan")
    taken_off = radius if facet else 0.0
    limits = limits_of(other)

    def work(part: slice) -> float:
        points = moved(centred[part], placement)
        if radius == 0.0:  # contact points: put the ball back, to land on the equidistant surface
            points = points + nominal.tip_radius_mm * feet.normal[part]
        start = points - (feet.distance_mm[part] + taken_off)[:, None] * feet.normal[part]
        second = foot_points(other.jet, nominal.side, points, start[:, 0], start[:, 1], limits)
        known = inside[part] & other.contains(second.x_mm, second.y_mm)
        difference = np.abs(second.distance_mm - taken_off - feet.distance_mm[part])[known]
        return float(difference.max(initial=0.0))

    return max(in_threads(work, len(centred)))


def _covariance(result: FitResult, length: float, part_from_surface: Array) -> Array:
    """Return the covariance of a small motion about the centroid, frame `part`, shape (6, 6).

    ``s^2 (J^T J)^-1`` on the observable motions, for errors that are independent from point to point.
    """
    keep = ~result.spectral.free
    motions = result.spectral.motions[:, keep]
    n = max(int(np.count_nonzero(result.evaluation.used)), 1)
    freedom = max(n - int(np.count_nonzero(keep)), 1)
    variance = result.evaluation.cost_mm2 * n / freedom
    scaled = (motions / result.spectral.values[keep]) @ motions.T * (variance / n)
    unscale = np.diag([1.0 / length] * 3 + [1.0] * 3)
    turn = np.kron(np.eye(2), part_from_surface)
    covariance: Array = turn @ unscale @ scaled @ unscale @ turn.T
    return covariance


def _pose_sigma(covariance: Array, spectral: Spectrum) -> dict[str, float]:
    """Return the standard uncertainty of each motion about the centroid; infinite where one is free."""
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    sigma = np.where(uncertain_axes(spectral), np.inf, sigma)
    names = ("rx_urad", "ry_urad", "rz_urad", "tx_um", "ty_um", "tz_um")
    units = (URAD_PER_RAD,) * 3 + (UM_PER_MM,) * 3
    return {name: float(s * u) for name, s, u in zip(names, sigma, units, strict=True)}


def _turned(spectral: Spectrum, part_from_surface: Pose) -> Spectrum:
    """Return the motions in frame `part`."""
    return spectral._replace(motions=np.kron(np.eye(2), part_from_surface.rotation) @ spectral.motions)


def _warnings(
    measured: PointSet, nominal: Nominal, deviation_mm: Array, ids: np.typing.NDArray[np.int64]
) -> tuple[str, ...]:
    """Return what the operator should know, a sentence each."""
    found = []
    if measured.kind is PointKind.UNSTATED:
        found.append("the file does not say what its points are: taken for tip centres")
    outside = len(measured) - len(deviation_mm)
    if outside:
        found.append(f"{outside} of {len(measured)} points lie outside the nominal and were left out")
    quality = nominal.quality
    if quality is not None and not quality.regular:
        found.append(
            f"the ball (radius {nominal.tip_radius_mm:g} mm) does not fit everywhere: "
            f"smallest concave radius {quality.min_concave_radius_mm:.4g} mm"
        )
    middle = float(np.median(deviation_mm))
    sigma = MAD_SIGMA * float(np.median(np.abs(deviation_mm - middle)))
    suspect = np.abs(deviation_mm - middle) > SUSPECT * sigma
    count = int(np.count_nonzero(suspect))
    rounding = 1e-9 * nominal.surface.bounds.diagonal_mm
    if sigma > rounding and count:
        named = ", ".join(str(i) for i in ids[suspect][:5]) + (" ..." if count > 5 else "")
        found.append(
            f"{count} points deviate by more than {SUSPECT:g} robust sigma (kept in the fit): {named}"
        )
    return tuple(found)
