"""Stage 2, align: the rigid motion that lays the measured tip centres on the equidistant surface.

1. Find the way: a few points on a light net of facets (the paper's method), from the frame as it is; where
   that may have led astray, a search over all poses.
2. Refine: the same points, orthogonal foot points on the smooth nominal, outliers left out.
   Ask whether the result looks like one of the usual mistakes (tip radius, side, contact points).
3. Finish: all points that touched the nominal and are no outliers, plain (or weighted) least squares; on
   request another criterion, or a scale.
4. Check: the deviation once more by a second path, from a smooth surface through the equidistant points.

The source paper is Photonics 2025, 12(5), 469, doi 10.3390/photonics12050469, section 2.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cmm_align.config import ALIGN_CHOICES, AlignConfig
from cmm_align.errors import NumericsError, UsageError
from cmm_align.model import (
    Alignment,
    Fiducials,
    FitReport,
    FitStep,
    Nominal,
    PointKind,
    PointSet,
    PointStatus,
    frozen_array,
)
from cmm_align.numerics.chunked import in_threads
from cmm_align.numerics.fit_steps import FitSettings
from cmm_align.numerics.linearisation import Measure, even_sample
from cmm_align.numerics.steering import Placement, Steering
from cmm_align.numerics.triangle_net import triangle_net
from cmm_align.pose import Pose
from cmm_align.stages.alignment_report import Regions, checked, reported
from cmm_align.stages.best_fit import Cloud, Fitted, Way, best_fit, scaled, with_criterion
from cmm_align.stages.constraints import (
    check_choices,
    limits_of_points,
    lock_of,
    locked_motions,
    start_of,
    stated_weights,
    thermal_scale,
)
from cmm_align.stages.fit_checks import (
    NO_BALL_MM,
    check_belonging,
    check_contact,
    check_enough,
    check_fiducials,
    check_fit,
    check_spread,
    consulted,
    explained,
)
from cmm_align.stages.plausibility import check_measured
from cmm_align.stages.reference_methods import reference_pose
from cmm_align.stages.selection import Selection, status_of
from cmm_align.stages.way import find_the_way
from cmm_align.surfaces.distance import facet_measure, smooth_measure
from cmm_align.surfaces.envelope import inside_raster
from cmm_align.surfaces.protocol import Array
from cmm_align.surfaces.region import Region, region_from_text
from cmm_align.units import NM_PER_MM, RAD_PER_DEG, UM_PER_MM

ROUGHNESS_FACTOR: Final = 0.2
"""Mean square of the slopes of noise in squares of its PV over the spacing, with a margin of three."""

NO_REPORT: Final = FitReport(0, "", False, (), {}, float("nan"), "smooth", 0, 0)

Progress = Callable[[str, float], None]


def align(
    measured: PointSet,
    nominal: Nominal,
    config: AlignConfig = AlignConfig(),
    *,
    start: Pose | None = None,
    fiducials: Fiducials | None = None,
    tolerance: tuple[Array, Array] | None = None,
    regions: Regions | None = None,
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
        ``part_from_machine`` to start from; without it the machine's frame (or what three fiducials say), and
        a search over all poses where that is not good enough.
    fiducials : Fiducials, optional
        Places that the part is known to have, as soft datum terms: one whose uncertainty equals the RMS of
        the deviations counts as much as one point.
    tolerance : tuple of ndarray, each of shape (N,), mm, optional
        Least and largest deviation of each point for ``criterion = "within-tolerance"``; without it, those of
        `config` hold for all.
    regions : Regions, optional
        In place of the regions that `config` names.
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
    UsageError
        If choices contradict each other.
    NumericsError
        If no fit is found or it does not converge; no result is returned then.

    Notes
    -----
    Sign: a bump outwards is positive. Accuracy tested: noise-free points from 20, 10, 20 mm and 20, 10, 20
    degrees end below 1e-6 nm PV.
    """
    for name, known in ALIGN_CHOICES.items():
        if getattr(config, name) not in known:
            raise UsageError(f"{name} {getattr(config, name)!r}", expected=", ".join(known))
    check_measured(measured, nominal)
    if config.method != "foot-point":
        if fiducials is not None:
            raise UsageError(f"method {config.method} with fiducials", expected="the points alone")
        return _by_reference(measured, nominal, config, start, regions)
    check_choices(config, fiducials)
    regions = regions or _regions(config, nominal)
    limits = limits_of_points(len(measured), config, tolerance)
    tell = progress or (lambda _what, _share: None)
    if start is None and fiducials is not None and config.search != "always":
        start = start_of(fiducials)
    frame = start or Pose.identity("part", "machine")
    cloud = _cloud(measured, nominal, config, frame)

    tell("finding the way", 0.0)
    few = even_sample(len(measured), config.coarse_points)
    lock = cloud.steering.lock
    way_start, way, notes = find_the_way(
        cloud.points_mm[few],
        cloud.centroid,
        nominal,
        cloud.radius_mm,
        cloud.settings,
        start,
        config.search,
        lock,
    )
    tell("refining", 0.2)
    raster = inside_raster(nominal.surface) if cloud.radius_mm > 0.0 else None
    rule = Selection(nominal, cloud.radius_mm, config.edge_proud_um / UM_PER_MM, regions.fit, raster=raster)
    fitted = best_fit(
        cloud, few, Way(way_start, way), rule, config, nominal=nominal, fiducials=fiducials, tell=tell
    )
    if config.max_iterations > 0:
        tell("looking for mistakes", 0.6)
        notes += _examined(measured, nominal, fitted, few, config, regions, start)
        if config.scale == "free":
            tell("scale", 0.6)
            fitted = scaled(fitted)
        if config.criterion != "least-squares":
            tell(config.criterion, 0.6)
            fitted = with_criterion(fitted, config.criterion, limits)
    tell("second path", 0.8)
    bare = _laid(measured, nominal, fitted, regions.report)
    if config.max_iterations > 0:
        check_belonging(bare.status, measured.source)
        if fiducials is not None:
            at_size = cloud.centroid + cloud.scale * (fiducials.measured_mm - cloud.touched_mm)
            notes += check_fiducials(
                bare.part_from_machine.apply(at_size), fiducials, trusted=config.trust_me
            )
    found = reported(bare, measured, fitted, config, regions, frame, notes)
    return checked(found, fitted, config, tell)


def _examined(
    measured: PointSet,
    nominal: Nominal,
    fitted: Fitted,
    few: NDArray[np.intp],
    config: AlignConfig,
    regions: Regions,
    start: Pose | None,
) -> tuple[str, ...]:
    """Refuse a fit that is none, or that a mistake explains; return what is to be told."""
    cloud = fitted.cloud
    notes: tuple[str, ...] = ()
    if regions.fit is not None:  # before anything is made of so few
        _check_enough(fitted, config, measured, nominal)
    if cloud.radius_mm > 0.0 or nominal.tip_radius_mm > NO_BALL_MM:
        near = _pose(fitted.near.placement, cloud, nominal)
        steering = None if regions.fit is None else fitted.result.evaluation.used
        frame = start or Pose.identity("part", "machine")
        notes = consulted(measured, nominal, fitted.near, near, frame, config, steering=steering)
    elif not config.trust_me:
        check_contact(cloud.measure, cloud.points_mm[few], fitted.near, cloud.settings, where=measured.source)
    try:
        check_fit(fitted.result, cloud.settings.size_mm)
    except NumericsError as failure:
        raise explained(failure, measured, nominal, start) from None
    _check_enough(fitted, config, measured, nominal)
    return notes


def _check_enough(fitted: Fitted, config: AlignConfig, measured: PointSet, nominal: Nominal) -> None:
    """Refuse points that are too few for the motions and a deviation to judge by, or badly spread."""
    locked = locked_motions(config)
    used, steering = fitted.result.evaluation.used, fitted.cloud.steering
    weighing = used if steering.weights is None else used & (steering.weights > 0.0)
    spare = 0 if steering.datum is not None else 1
    check_enough(int(np.count_nonzero(weighing)), 6 - len(locked) + spare, locked, measured.source)
    check_spread(fitted.result, nominal, fitted.cloud.settings, measured.source)


def _by_reference(
    measured: PointSet, nominal: Nominal, config: AlignConfig, start: Pose | None, regions: Regions | None
) -> Alignment:
    """Take the pose from a method of the literature, and measure the deviations there as always."""
    plain = AlignConfig()
    for name in ("criterion", "weights", "lock", "scale", "fit_region", "expansion_per_k"):
        if getattr(config, name) != getattr(plain, name):
            raise UsageError(
                f"method {config.method} with {name} {getattr(config, name)!r}",
                expected="plain least squares: the reference methods know nothing else",
            )
    reference = reference_pose(config.method, measured, nominal, config, start=start)
    there = replace(config, method="foot-point", max_iterations=0, search="never")
    found = align(measured, nominal, there, start=reference.part_from_machine, regions=regions)
    report = replace(
        found.report,
        method=config.method,
        iterations=reference.iterations,
        stop_reason=reference.stop_reason,
        converged=reference.converged,
        steps=tuple(
            FitStep(config.method, float("nan"), c, len(measured)) for c in reference.cost_history_mm2
        ),
    )
    return replace(found, report=report)


def _regions(config: AlignConfig, nominal: Nominal) -> Regions:
    """Return the regions that the settings name."""
    texts = (("fit_region", config.fit_region), ("report_region", config.report_region))
    return Regions(*(region_from_text(text, nominal.surface, name) if text else None for name, text in texts))


def _cloud(measured: PointSet, nominal: Nominal, config: AlignConfig, start: Pose) -> Cloud:
    """Return the points about their centroid with the surface they are measured against."""
    scale = thermal_scale(config)
    centroid = measured.centroid_mm
    centred = measured.points_mm - centroid
    at_size = centroid
    if scale != 1.0:  # a part grows about its datum, not about the middle of what was touched of it
        datum = start.inverse().translation_mm
        centred, at_size = centred * scale, datum + scale * (centroid - datum)
    radius = 0.0 if measured.kind is PointKind.CONTACT else nominal.tip_radius_mm
    length = float(np.sqrt(np.vdot(centred, centred) / len(centred)))
    surface_from_machine = nominal.surface_from_part @ start
    placed = Placement(surface_from_machine.rotation, surface_from_machine.apply(at_size[None])[0])
    return Cloud(
        centred,
        at_size,
        scale,
        radius,
        _measure(nominal, radius, config),
        _settings(config, nominal, length),
        Steering(
            weights=stated_weights(measured, config),
            lock=lock_of(config, nominal, start, placed, scale, centroid),
        ),
        touched_mm=centroid,
    )


def _pose(placed: Placement, cloud: Cloud, nominal: Nominal) -> Pose:
    """Return ``part_from_machine`` of a placement of the cloud, for points at their scale."""
    shift = placed.position_mm - placed.rotation @ cloud.centroid
    return nominal.surface_from_part.inverse() @ Pose(placed.rotation, shift, "surface", "machine")


def _laid(measured: PointSet, nominal: Nominal, fitted: Fitted, region: Region | None) -> Alignment:
    """Return the points as the fit has laid them; what is known of the pose comes on top."""
    cloud, result = fitted.cloud, fitted.result
    part_from_machine = _pose(result.placement, cloud, nominal)
    part_from_surface = nominal.surface_from_part.inverse()
    feet, inside = result.evaluation.feet, result.evaluation.inside
    used = result.evaluation.used & inside
    status = status_of(fitted.selection, feet, inside, used)
    judged = (status == PointStatus.USED) | (status == PointStatus.APART)
    if region is not None:
        judged[judged] = region.contains(feet.x_mm[judged], feet.y_mm[judged])
    normals = part_from_surface.rotate(feet.normal)
    at_size = measured.points_mm if cloud.scale == 1.0 else cloud.points_mm + cloud.centroid
    tips_part, contact_part = np.empty((2, *at_size.shape))
    deviation = np.empty(len(at_size))

    def lay(part: slice) -> None:
        tips_part[part] = part_from_machine.apply(at_size[part])
        contact_part[part] = tips_part[part] - cloud.radius_mm * normals[part]
        deviation[part] = np.where(inside[part], feet.distance_mm[part], np.nan)

    in_threads(lay, len(at_size))
    return Alignment(
        nominal=nominal,
        part_from_machine=part_from_machine,
        covariance=frozen_array(np.zeros((6, 6))),
        tip_centre_machine_mm=measured.points_mm,
        tip_centre_part_mm=frozen_array(tips_part),
        contact_part_mm=frozen_array(contact_part),
        normals=frozen_array(normals),
        deviation_mm=frozen_array(deviation),
        used=frozen_array(used, np.bool_),
        judged=frozen_array(judged, np.bool_),
        status=frozen_array(status, np.uint8),
        ids=measured.ids,
        report=NO_REPORT,
        sigma_mm=measured.sigma_mm,
    )


def _settings(config: AlignConfig, nominal: Nominal, length: float) -> FitSettings:
    """Return the settings of a fit.

    A nominal that is rough itself breaks its own symmetries: what its roughness can tell is not told.
    """
    rough = 0.0
    if nominal.quality is not None:
        slope = nominal.quality.surface_error_pv_nm / NM_PER_MM / max(min(nominal.quality.spacing_mm), 1e-12)
        rough = ROUGHNESS_FACTOR * slope**2 if np.isfinite(slope) else 0.0
    return FitSettings(
        size_mm=nominal.surface.bounds.diagonal_mm,
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
