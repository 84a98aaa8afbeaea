"""What is told of an alignment beside the pose: how well it is known, what it took away, who steered it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cmm_align.config import AlignConfig
from cmm_align.errors import NumericsError, UsageError
from cmm_align.model import (
    Alignment,
    FitReport,
    MotionLimits,
    PointSet,
    PointSpread,
    PointStatus,
    frozen_array,
)
from cmm_align.numerics.observability import free_motions_in_words
from cmm_align.pose import Pose
from cmm_align.stages.best_fit import Fitted
from cmm_align.stages.constraints import locked_motions
from cmm_align.stages.pose_knowledge import pose_knowledge
from cmm_align.stages.pose_uncertainty import covariance_of, pose_sigma, turned
from cmm_align.stages.removed_motion import removed_motion
from cmm_align.stages.second_path import two_path_difference_mm, warnings_of
from cmm_align.surfaces.protocol import Array
from cmm_align.surfaces.region import Region
from cmm_align.units import NM_PER_MM


class Regions(NamedTuple):
    """Where points steer the fit, and where they count in the numbers; None is everywhere."""

    fit: Region | None = None
    report: Region | None = None


def reported(
    bare: Alignment,
    measured: PointSet,
    fitted: Fitted,
    config: AlignConfig,
    regions: Regions,
    frame: Pose,
    notes: tuple[str, ...],
) -> Alignment:
    """Add what is known of the pose, and the report.

    Parameters
    ----------
    bare : Alignment
        As `align` has laid the points.
    measured : PointSet
    fitted : Fitted
    config : AlignConfig
    regions : Regions
    frame : Pose
        ``part_from_machine`` at the start: where the drawing's motions are counted from.
    notes : tuple of str
        What was noticed on the way.

    Raises
    ------
    UsageError
        If the report region holds no point.
    NumericsError
        If no point lies on the nominal.
    """
    cloud, result, nominal = fitted.cloud, fitted.result, bare.nominal
    inside, length = result.evaluation.inside, cloud.settings.length_mm
    if regions.report is None and not bare.judged.any():
        raise NumericsError(
            "none of the points lies on the nominal", where=measured.source, remedy="check the start pose"
        )
    if not bare.judged.any():
        raise UsageError(
            "the report region holds no measured point", where=measured.source, expected="points in it"
        )
    two_path = two_path_difference_mm(
        cloud.points_mm, result.placement, result.evaluation.feet, inside, nominal, cloud.radius_mm, config
    )
    turn = nominal.surface_from_part.inverse()
    spectral = turned(result.spectral, turn)
    covariance, correlated = covariance_of(
        result,
        cloud.points_mm,
        length,
        turn.rotation,
        cloud.steering,
        fitted.scale_response,
        by_sigma=config.weights == "sigma",
    )
    middle = bare.part_from_machine.apply(cloud.centroid[None])[0]
    n_used = int(np.count_nonzero(bare.used))
    rms = float(np.sqrt(np.mean(bare.deviation_mm[bare.used] ** 2))) if n_used else 0.0
    knowledge = pose_knowledge(
        nominal,
        spectral,
        covariance,
        middle,
        length,
        n_used,
        rms,
        min_observability=cloud.settings.min_observability,
    )
    removed = removed_motion(
        bare.part_from_machine,
        frame,
        nominal,
        covariance,
        MotionLimits(
            config.max_wedge_arcmin,
            config.max_decentre_um,
            config.max_clocking_arcmin,
            config.max_thickness_um,
        ),
        spectral=spectral,
        centroid_mm=middle,
        length_mm=length,
    )
    counts = {status: int(np.count_nonzero(bare.status == status)) for status in PointStatus}
    evaluated = config.max_iterations == 0
    report = FitReport(
        iterations=fitted.iterations,
        stop_reason="evaluated only" if evaluated else result.stop_reason,
        converged=result.converged,
        unobservable=free_motions_in_words(spectral, middle, length),
        pose_sigma=pose_sigma(covariance, spectral),
        two_path_difference_nm=two_path * NM_PER_MM,
        steps=fitted.steps,
        distance=config.distance,
        n_outside=counts[PointStatus.OUTSIDE],
        n_outliers=counts[PointStatus.OUTLIER],
        n_edge=counts[PointStatus.EDGE],
        n_not_reached=counts[PointStatus.NOT_REACHED],
        n_apart=counts[PointStatus.APART],
        warnings=notes + warnings_of(measured, nominal, inside, bare.status == PointStatus.OUTLIER, config),
        criterion=config.criterion,
        certificate=fitted.certificate,
        correlated=correlated,
        weights=config.weights,
        locked=locked_motions(config),
        lock_frame=config.lock_frame,
        fit_region="" if regions.fit is None else regions.fit.words,
        fit_region_text="" if regions.fit is None else regions.fit.text,
        report_region="" if regions.report is None else regions.report.words,
        report_region_text="" if regions.report is None else regions.report.text,
        n_fiducials=0 if cloud.steering.datum is None else len(cloud.steering.datum.weights),
        scale=cloud.scale,
        free_scale=fitted.free_scale,
        proof_ids=tuple(int(measured.ids[k]) for k in fitted.proof),
        knowledge=knowledge,
        removed=removed,
    )
    return replace(bare, covariance=frozen_array(covariance), report=report)


def checked(
    found: Alignment, fitted: Fitted, config: AlignConfig, tell: Callable[[str, float], None]
) -> Alignment:
    """Add what was asked for beyond the fit: simulated repetitions, the check the other way round.

    Parameters
    ----------
    found : Alignment
        With its report.
    fitted : Fitted
    config : AlignConfig
    tell : callable
        Told what is going on.
    """
    report = found.report
    if config.monte_carlo > 0:
        from cmm_align.stages.monte_carlo import monte_carlo  # only where it is asked for

        tell("Monte Carlo", 0.85)
        spectral = turned(fitted.result.spectral, found.nominal.surface_from_part.inverse())
        unscale = np.array([1.0 / fitted.cloud.settings.length_mm] * 3 + [1.0] * 3)
        simulated, spread = monte_carlo(
            found,
            config.mpe,
            config.monte_carlo,
            config.seed,
            motions=spectral.motions * unscale[:, None],
            weights=fitted.cloud.steering.weights,
        )
        report = replace(report, monte_carlo=simulated)
        found = replace(found, sigma_mm=_to_every_point(found, spread))
    if config.bidirectional:
        from cmm_align.stages.bidirectional import bidirectional  # only where it is asked for

        tell("the other way round", 0.9)
        report = replace(report, bidirectional=bidirectional(found))
    return replace(found, report=report)


def _to_every_point(found: Alignment, spread: PointSpread) -> Array:
    """Return the simulated uncertainty of every point, that of the nearest simulated one, shape (N,), mm."""
    if len(spread.index) == len(found.ids):
        return spread.sigma_mm
    from scipy.spatial import cKDTree  # slow to import

    tips = found.tip_centre_part_mm
    nearest = cKDTree(tips[spread.index]).query(tips)[1]
    every: Array = frozen_array(spread.sigma_mm[nearest])
    return every
