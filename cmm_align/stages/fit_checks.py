"""What a fit must stand before it is called a result: it found the part, and no usual mistake explains it."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from cmm_align.config import AlignConfig
from cmm_align.errors import GeometryError, NumericsError, WrongStageError
from cmm_align.model import Fiducials, Nominal, PointKind, PointSet, PointStatus
from cmm_align.numerics.fit_steps import FitSettings
from cmm_align.numerics.free_offset import free_offset
from cmm_align.numerics.linearisation import Measure
from cmm_align.numerics.observability import spectrum
from cmm_align.numerics.rigid_fit import FitResult
from cmm_align.pose import Pose
from cmm_align.stages.fit_doctor import diagnose, explain_failure
from cmm_align.surfaces.geometry import unit_normal
from cmm_align.surfaces.protocol import Array, Mask
from cmm_align.units import UM_PER_MM

LARGEST_RMS: Final = 0.01
"""A fit whose RMS is above this share of the size has found nothing."""
ON_SURFACE: Final = 0.5
"""Share of the points that must end on the nominal."""
BELONG: Final = 0.6
"""Share of the points that must lie on the nominal and be no outliers; less is two parts or clampings."""
NO_BALL_MM: Final = 1e-3
"""A ball of this radius stands for none: contact points on a raw nominal."""
LARGEST_OFFSET_MM: Final = 0.2
"""Contact points do not lie farther off than this; tips are larger."""
EXPLAINED: Final = 0.5
"""Share of the RMS that may be left where an offset explains the data."""
FIDUCIAL_OFF: Final = (3.0, 10.0)
"""Standard uncertainties by which a fiducial may be off: more is told, much more is refused."""
FEW: Final = 20
"""Points that are too few to be a scan."""
CLOSE: Final = 0.05
"""Points whose spread is below this share of the size lie in one place."""


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


def check_contact(
    measure: Measure, sample_mm: Array, near: FitResult, settings: FitSettings, *, where: str
) -> None:
    """Refuse contact points that lie off the nominal all round, where nobody said how large the ball was.

    Parameters
    ----------
    measure : Measure
        Distance to the nominal itself.
    sample_mm : ndarray, shape (k, 3), mm
        Points about their centroid.
    near : FitResult
        Of the sample.
    settings : FitSettings
    where : str
        Source of the points.

    Raises
    ------
    WrongStageError
        If one common offset explains most of what is left.
    """
    used = near.evaluation.used & near.evaluation.inside
    free = free_offset(measure, sample_mm, near.placement, settings.length_mm, settings.size_mm, used)
    rms = float(np.sqrt(near.evaluation.cost_mm2))
    if abs(free.offset_mm) > LARGEST_OFFSET_MM and free.rms_mm < EXPLAINED * rms:
        raise WrongStageError(
            f"an offset of {free.offset_mm:.3g} mm all round would lower the RMS from "
            f"{rms * UM_PER_MM:.3g} to {free.rms_mm * UM_PER_MM:.3g} um: "
            "tip centres of a ball of that radius, not contact points",
            where=where,
            remedy="give --tip-radius in place of --contact-points; --trust-me goes on all the same",
        )


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
            remedy="raise --iterations, or give a start pose with --initial",
        )


def check_belonging(status: NDArray[np.uint8], where: str) -> None:
    """Refuse a fit of which too many points are no part.

    Parameters
    ----------
    status : ndarray of uint8, shape (N,)
        `PointStatus`.
    where : str
        Source of the points.

    Raises
    ------
    NumericsError
        If outliers and points beside the nominal are more than they may be.
    """
    strays = int(np.count_nonzero((status == PointStatus.OUTSIDE) | (status == PointStatus.OUTLIER)))
    if strays > (1.0 - BELONG) * len(status):
        raise NumericsError(
            f"only {len(status) - strays} of {len(status)} points lie on the part",
            where=where,
            expected=f"{100.0 * BELONG:.0f} % or more",
            remedy="are these two clampings, or two parts? --outliers keep uses every point",
        )


def check_fiducials(there_mm: Array, fiducials: Fiducials, *, trusted: bool) -> tuple[str, ...]:
    """Hold fiducials against what was said of them.

    Parameters
    ----------
    there_mm : ndarray, shape (m, 3), mm, frame `part`
        Where the fit has laid them.
    fiducials : Fiducials
    trusted : bool
        Whether to go on although one is far off.

    Returns
    -------
    tuple of str
        Those that are off by more than three of their standard uncertainties.

    Raises
    ------
    WrongStageError
        If one is off by more than ten.
    """
    off = there_mm - fiducials.nominal_mm
    times = np.abs(off) / fiducials.sigma_mm
    notes = []
    worst_first = np.argsort(-times, axis=None)[: int(np.count_nonzero(times > FIDUCIAL_OFF[0]))]
    for row, axis in zip(*np.unravel_index(worst_first, times.shape), strict=True):
        words = (
            f"fiducial {fiducials.names[row]} is {off[row, axis] * UM_PER_MM:+.4g} um off along "
            f"{'xyz'[axis]}, {times[row, axis]:.1f} times its standard uncertainty"
        )
        if times[row, axis] > FIDUCIAL_OFF[1] and not trusted:
            raise WrongStageError(
                words,
                expected="fiducials and surface that agree",
                remedy="check names, places and uncertainties; --trust-me goes on all the same",
            )
        notes.append(words)
    return tuple(notes)


def check_spread(result: FitResult, nominal: Nominal, settings: FitSettings, where: str) -> None:
    """Refuse a few points in one place that cannot tell what the nominal could.

    Parameters
    ----------
    result : FitResult
    nominal : Nominal
    settings : FitSettings
    where : str
        Source of the points.

    Raises
    ------
    GeometryError
        If motions are free that the whole nominal would hold, and the points are few or close together.
    """
    n_free, used = int(np.count_nonzero(result.spectral.free)), result.evaluation.used
    if n_free == 0:
        return
    few = int(np.count_nonzero(used)) < FEW
    x, y = result.evaluation.feet.x_mm[used], result.evaluation.feet.y_mm[used]
    close = float(np.hypot(np.std(x), np.std(y))) < CLOSE * settings.size_mm if len(x) else False
    if not (few or close):
        return
    more = n_free - _free_of_nominal(nominal, settings)
    if more > 0:
        raise GeometryError(
            f"{len(x)} points within {np.ptp(x):.3g} x {np.ptp(y):.3g} mm leave {n_free} motions free",
            where=where,
            expected=f"points that tell {more} of them more, as the whole nominal would",
            remedy="measure points spread over the nominal, or lock motions",
        )


def _free_of_nominal(nominal: Nominal, settings: FitSettings) -> int:
    """Return how many motions the whole nominal leaves free."""
    b = nominal.surface.bounds
    cell = (np.arange(24) + 0.5) / 24
    x, y = (
        a.ravel()
        for a in np.meshgrid(b.x_min + cell * (b.x_max - b.x_min), b.y_min + cell * (b.y_max - b.y_min))
    )
    inside = nominal.surface.contains(x, y)
    jet = nominal.surface.jet(x[inside], y[inside])
    normals = unit_normal(jet, nominal.side)
    points = np.stack([x[inside], y[inside], jet.z], axis=1)
    arm = points - points.mean(axis=0)
    length = float(np.sqrt(np.mean(np.sum(arm**2, axis=1))))
    rows = np.hstack([np.cross(arm, normals) / length, normals])
    return int(np.count_nonzero(spectrum(rows.T @ rows / len(rows), settings.min_observability).free))


def check_enough(n_used: int, n_motions: int, locked: tuple[str, ...], where: str) -> None:
    """Refuse fewer points than motions.

    Parameters
    ----------
    n_used, n_motions : int
        Points that steer the fit, and how many it takes.
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
        expected=f"at least {n_motions}, to tell {', '.join(free)} and to leave a deviation to judge by",
        remedy="measure more points on the nominal, widen the fit region, or lock motions",
    )
