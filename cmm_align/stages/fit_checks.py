"""What a fit must stand before it is called a result: it found the part, and no usual mistake explains it."""

from __future__ import annotations

from typing import Final

import numpy as np

from cmm_align.config import AlignConfig
from cmm_align.errors import GeometryError, NumericsError, WrongStageError
from cmm_align.model import Nominal, PointKind, PointSet
from cmm_align.numerics.rigid_fit import FitResult
from cmm_align.pose import Pose
from cmm_align.stages.fit_doctor import diagnose, explain_failure
from cmm_align.surfaces.protocol import Mask

LARGEST_RMS: Final = 0.01
"""A fit whose RMS is above this share of the size has found nothing."""
ON_SURFACE: Final = 0.5
"""Share of the points that must end on the nominal."""


def consulted(
    measured: PointSet,
    nominal: Nominal,
    near: FitResult,
    found: Pose,
    frame: Pose,
    config: AlignConfig,
    *,
    steering: Mask | None = None,
) -> tuple[str, ...]:
    """Ask the fit doctor; refuse on clear evidence of a mistake, pass suspicions on.

    Parameters
    ----------
    measured : PointSet
    nominal : Nominal
    near : FitResult
        Fit of the sample.
    found, frame : Pose
        ``part_from_machine`` after the fit, and where it started.
    config : AlignConfig
    steering : ndarray of bool, shape (N,), optional
        The points to look at, where a fit region leaves the others alone; all without it.

    Raises
    ------
    WrongStageError
        If the data are clearly a mistake and nobody said to go on.
    """
    on = float(np.mean(near.evaluation.inside))
    rms = float(np.sqrt(near.evaluation.cost_mm2))
    if on < ON_SURFACE or rms > LARGEST_RMS * nominal.surface.bounds.diagonal_mm:
        return ()
    contact = measured.kind is PointKind.CONTACT
    points = measured.points_mm if steering is None else measured.points_mm[steering]
    seen = diagnose(points, nominal, found, frame, contact=contact)
    if seen.clear and not config.trust_me:
        first = seen.clear[0]
        raise WrongStageError(
            first.words, where=measured.source, remedy=f"{first.remedy}; --trust-me goes on all the same"
        )
    return seen.warnings + tuple(finding.words for finding in seen.clear)


def explained(
    failure: NumericsError, measured: PointSet, nominal: Nominal, start: Pose | None
) -> NumericsError:
    """Return a failure with what would make the points fit, if anything does."""
    contact = measured.kind is PointKind.CONTACT
    reasons = explain_failure(measured.points_mm, nominal, start=start, contact=contact)
    if not reasons:
        return failure
    return NumericsError(
        failure.what, where=measured.source, remedy=f"{reasons[0].words}; {reasons[0].remedy}"
    )


def check_fit(result: FitResult, size_mm: float) -> None:
    """Refuse a fit that has found nothing: a refusal is better than a plausible wrong answer.

    Raises
    ------
    NumericsError
        If the points do not lie on the nominal, or the fit did not converge.
    """
    share = float(np.mean(result.evaluation.inside))
    rms = float(np.sqrt(result.evaluation.cost_mm2))
    if share < ON_SURFACE:
        raise NumericsError(
            f"no fit: only {100.0 * share:.0f} % of the points lie on the nominal",
            remedy="check that the files belong together, or give a start pose with --initial",
        )
    if rms > LARGEST_RMS * size_mm:
        raise NumericsError(
            f"no fit: the RMS is {rms:.3g} mm on a part of {size_mm:.4g} mm",
            remedy="check the files, the side and the tip radius, or give a start pose with --initial",
        )
    if not result.converged:
        raise NumericsError(
            f"not converged after {result.iterations} iterations ({result.stop_reason}, RMS {rms:.3g} mm)",
            remedy="give a start pose with --initial",
        )


def check_enough(n_used: int, n_motions: int, locked: tuple[str, ...], where: str) -> None:
    """Refuse fewer points than motions.

    Parameters
    ----------
    n_used, n_motions : int
        Points that steer the fit, and motions that it may use.
    locked : tuple of str
        Motions that it may not use.
    where : str
        Source of the points.

    Raises
    ------
    GeometryError
        If the points cannot determine the motions.
    """
    if n_used >= n_motions:
        return
    free = [axis for axis in ("rx", "ry", "rz", "tx", "ty", "tz") if axis not in locked]
    raise GeometryError(
        f"{n_used} points steer the fit",
        where=where,
        expected=f"at least {n_motions}, to tell {', '.join(free)}",
        remedy="measure more points on the nominal, widen the fit region, or lock motions",
    )
