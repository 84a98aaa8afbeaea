"""The fit doctor: is the ball as large as it is said to be, and on the side it is said to be on.

A fit takes the stated offset (tip radius, or nothing for contact points) off every distance. If the points
truly lie at another distance h, the fit moves them along the normal and its RMS hardly tells. Two things do:

- the *free offset*: h fitted together with the pose. Known where the part is steep. What a wrong offset
  leaves is the rest of a constant, the same as the rest of ``1 - |n_z|``, since n_z is a motion.
- the *start offset*: where the points lie in the frame they came in. Known if they all lie at one distance
  there, so that nothing but the normal is left to be wrong.

Where neither tells, the doctor says so: RMS alone chooses nothing. A constant offset after the best rigid
motion looks like power, so as much power as the rest of the form error is always allowed for.
What each mistake leaves stands in `stages.mistakes`.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from cmm_align.model import Nominal
from cmm_align.numerics.fit_steps import FitSettings
from cmm_align.numerics.foot_point import Feet
from cmm_align.numerics.free_offset import FreeOffset, free_offset, leverage_of
from cmm_align.numerics.linearisation import Measure, Placement, moved, rows_of
from cmm_align.numerics.outliers import MAD_SIGMA
from cmm_align.numerics.rigid_fit import fit
from cmm_align.numerics.rotations import vector_from_rotation
from cmm_align.pose import Pose
from cmm_align.stages.findings import Diagnosis, Evidence, Finding
from cmm_align.stages.fit_failure import explain_failure
from cmm_align.stages.mistakes import Mistake, mistakes_of
from cmm_align.surfaces.distance import smooth_measure
from cmm_align.surfaces.protocol import Array, Mask
from cmm_align.units import UM_PER_MM

__all__ = ["Diagnosis", "Evidence", "Finding", "diagnose", "explain_failure"]

POINTS: Final = 600
"""Points that are looked at."""
FEWEST: Final = 12
FORM: Final = 5e-5
"""Form error that may look like an offset, RMS, as a share of the size: 6 um on a part of 120 mm."""
SURE: Final = 3.0
"""A value this many standard uncertainties away is excluded."""
STARTED: Final = 0.1
"""The start frame speaks if the spread of the distances is below this share of what it would reveal."""
LOOSE: Final = 0.02
"""How well a start frame is expected to be set along the normal, in tip radii, beside its spread."""
WORN: Final = 0.1
"""An offset wrong by up to this share of the radius may be a worn or badly calibrated ball."""
GROSS: Final = 1e-4
"""A fit whose RMS is above this share of the size is asked whether the part is mirrored."""
_STRAY: Final = 6.0


class _Case(NamedTuple):
    """Points, nominal and the ordinary fit."""

    nominal: Nominal
    measure: Measure
    points_mm: Array
    used: Mask
    placement: Placement
    start: Placement
    stated_mm: float
    length_mm: float
    size_mm: float
    rms_mm: float
    feet: Feet


class _Start(NamedTuple):
    offset_mm: float
    spread_mm: float


def diagnose(
    points_machine_mm: Array, nominal: Nominal, found: Pose, start: Pose, *, contact: bool = False
) -> Diagnosis:
    """Look at an ordinary fit and name the usual mistakes.

    Parameters
    ----------
    points_machine_mm : ndarray, shape (n, 3), mm, frame `machine`
        All points or a fair sample; at most `POINTS` are used.
    nominal : Nominal
    found : Pose
        ``part_from_machine`` of the fit.
    start : Pose
        ``part_from_machine`` of the frame that the points came in: the identity, or what the user gave;
        never the outcome of a search.
    contact : bool
        The points were said to be contact points.

    Returns
    -------
    Diagnosis
        With no finding where the data agree with what was said of them.

    Notes
    -----
    Table and reasons: the module's docstring. Thresholds are shares of the radius, the size and the
    uncertainty, so the answer does not depend on the scale.
    """
    case = _case(points_machine_mm, nominal, found, start, contact=contact)
    radius = nominal.tip_radius_mm
    if case is None:
        return Diagnosis((), np.nan, np.nan, np.inf, np.nan, np.nan, np.nan, np.nan)
    mistakes = mistakes_of(radius, contact=contact)
    free, u = _free(case, radius)
    began = _at_the_start(case)
    other = np.nan if contact else _rms_at(case, -radius)
    findings = _by_free_offset(case, mistakes, free, u, radius)
    if not any(f.evidence is Evidence.CLEAR for f in findings):
        findings += _by_start(case, mistakes, began, free, u, radius)
        findings += _mirrored(case, points_machine_mm, start, contact=contact)
    told = u <= 0.25 * radius or (
        began.spread_mm <= STARTED * radius and abs(began.offset_mm - case.stated_mm) <= 0.25 * radius
    )
    if not findings and not told:
        findings += (_untold(case, other, radius),)
    order = list(Evidence)
    ranked = tuple(sorted(findings, key=lambda f: order.index(f.evidence)))
    power = _power(case) if free is None else free.power
    offset = np.nan if free is None else free.offset_mm
    return Diagnosis(ranked, case.rms_mm, offset, u, began.offset_mm, began.spread_mm, other, power)


def _case(
    points_machine_mm: Array, nominal: Nominal, found: Pose, start: Pose, *, contact: bool
) -> _Case | None:
    """Gather a sample of the points and the fit; None if too few lie on the nominal."""
    n = len(points_machine_mm)
    pick = np.linspace(0, n - 1, min(n, POINTS)).round().astype(np.intp)
    few = points_machine_mm[pick]
    centroid = few.mean(axis=0)
    points = few - centroid
    length = float(np.sqrt(np.mean(np.sum(points**2, axis=1))))
    turn = nominal.surface_from_part
    placement, began = (
        Placement(pose.rotation, pose.apply(centroid[None])[0]) for pose in (turn @ found, turn @ start)
    )
    measure = smooth_measure(nominal.surface, nominal.side, 0.0)
    stated = 0.0 if contact else nominal.tip_radius_mm
    p = moved(points, placement)
    feet, used = measure.distance(p, None)
    feet, used = measure.distance(p, feet)
    if np.count_nonzero(used) < FEWEST:
        return None
    used = used & _together(feet.distance_mm, used)
    rms = float(np.sqrt(np.mean((feet.distance_mm[used] - stated) ** 2)))
    size = nominal.surface.bounds.diagonal_mm
    return _Case(nominal, measure, points, used, placement, began, stated, length, size, rms, feet)


def _together(distance_mm: Array, known: Mask) -> Mask:
    """Return which distances are no outliers."""
    middle = float(np.median(distance_mm[known]))
    off = np.abs(distance_mm - middle)
    mask: Mask = off <= _STRAY * MAD_SIGMA * max(float(np.median(off[known])), 1e-12 * abs(middle))
    mask |= off == 0.0
    return mask


def _free(case: _Case, radius: float) -> tuple[FreeOffset | None, float]:
    """Fit the offset where it can be known; return it with its standard uncertainty, mm."""
    rows = rows_of(moved(case.points_mm, case.placement), case.placement, case.feet, case.length_mm)
    leverage, _ = leverage_of(rows[:6, case.used].T, _flat(case))
    if FORM * case.size_mm >= 0.5 * radius * leverage:
        return None, np.inf
    free = free_offset(case.measure, case.points_mm, case.placement, case.length_mm, case.size_mm, case.used)
    if not (np.isfinite(free.rms_mm) and free.leverage > 0.0):
        return None, np.inf
    form = max(free.rms_mm, FORM * case.size_mm)
    u = float(np.hypot(free.rms_mm / np.sqrt(free.n), form)) / free.leverage
    return (free, u) if u <= 0.5 * radius else (None, np.inf)


def _flat(case: _Case) -> Array:
    """Return the places of the used feet in the plane, shape (n, 2), mm."""
    return np.stack([case.feet.x_mm, case.feet.y_mm], axis=1)[case.used]


def _power(case: _Case) -> float:
    """Return how far an offset looks like power on this part."""
    rows = rows_of(moved(case.points_mm, case.placement), case.placement, case.feet, case.length_mm)
    return leverage_of(rows[:6, case.used].T, _flat(case))[1]


def _at_the_start(case: _Case) -> _Start:
    """Measure the points in the frame they came in; NaN if they do not lie above the nominal there."""
    p = moved(case.points_mm, case.start)
    feet, inside = case.measure.distance(p, None)
    feet, inside = case.measure.distance(p, feet)
    known = case.used & inside
    if np.count_nonzero(known) < 0.8 * np.count_nonzero(case.used):
        return _Start(np.nan, np.nan)
    return _Start(float(np.mean(feet.distance_mm[known])), float(np.std(feet.distance_mm[known])))


def _rms_at(case: _Case, offset_mm: float) -> float:
    """Return the RMS of an ordinary fit with another offset, mm."""
    stated = case.measure

    def distance(points_mm: Array, previous: Feet | None) -> tuple[Feet, Mask]:
        feet, inside = stated.distance(points_mm, previous)
        return feet._replace(distance_mm=feet.distance_mm - offset_mm), inside

    up = case.feet.normal[case.used].mean(axis=0)
    up /= np.linalg.norm(up)
    begun = case.placement._replace(
        position_mm=case.placement.position_mm + (offset_mm - case.stated_mm) * up
    )
    settings = FitSettings(case.size_mm, case.length_mm, 1e-7, 20, 0.5, 1e-8)
    result = fit(Measure(distance), case.points_mm, begun, settings, used=case.used)
    return float(np.sqrt(result.evaluation.cost_mm2))


def _by_free_offset(
    case: _Case, mistakes: tuple[Mistake, ...], free: FreeOffset | None, u: float, radius: float
) -> tuple[Finding, ...]:
    """Compare the fitted offset with what each mistake would leave."""
    if free is None:
        return ()
    off = free.offset_mm - case.stated_mm
    said = f"free offset {free.offset_mm:.4g} +- {u:.2g} mm instead of {case.stated_mm:.4g} mm"
    if abs(off) < SURE * u:
        noise = free.rms_mm / (free.leverage * np.sqrt(free.n))
        if abs(off) > SURE * noise and 2.0 * free.rms_mm**2 < case.rms_mm**2:
            return (_looks_like_power(case, free, radius),)
        return ()
    near = sorted(
        (m for m in mistakes if abs(free.offset_mm - m.offset_mm) < SURE * u),
        key=lambda m: abs(free.offset_mm - m.offset_mm),
    )
    gain = f"RMS {_um(case.rms_mm)} um as stated, {_um(free.rms_mm)} um with it"
    if not near:
        if abs(off) <= WORN * radius:
            return (_looks_like_power(case, free, radius),)
        words = f"{said}, which none of the usual mistakes explains ({gain})"
        return (Finding("offset", words, Evidence.SUSPECT, "check the tip radius and the nominal"),)
    first, *rest = near
    also = _along_one_axis(case, free, radius) if first.name == "tip-centres" else ""
    also += "".join(f"; less likely: {m.words}" for m in rest)
    return (Finding(first.name, f"{said}: {first.words}{also} ({gain})", Evidence.CLEAR, first.remedy),)


def _looks_like_power(case: _Case, free: FreeOffset, radius: float) -> Finding:
    """Report an offset that is a little wrong: it may be the ball, and it may not."""
    off = free.offset_mm - case.stated_mm
    noise = free.rms_mm / (free.leverage * np.sqrt(free.n))
    of = "a tip radius" if case.stated_mm > 0.0 else "an offset"
    words = (
        f"{of} {off:+.3g} mm off (noise alone: +- {noise:.2g} mm) would lower the RMS from "
        f"{_um(case.rms_mm)} to {_um(free.rms_mm)} um: a worn or badly calibrated ball, or power in the "
        f"part; they correlate at {free.power:.2f}"
    )
    remedy = "calibrate the ball; the deviations stay as the stated radius gives them"
    return Finding("worn-ball" if abs(off) <= WORN * radius else "power", words, Evidence.SUSPECT, remedy)


def _along_one_axis(case: _Case, free: FreeOffset, radius: float) -> str:
    """Say so if the points would be tip centres but for one shift by the radius in the start frame."""
    shift = free.placement.position_mm - case.start.position_mm
    turn = np.linalg.norm(vector_from_rotation(free.placement.rotation @ case.start.rotation.T))
    far = float(np.linalg.norm(shift))
    if turn * case.length_mm > STARTED * radius or abs(far - radius) > 0.25 * radius:
        return ""
    return f", shifted by {far:.4g} mm: the radius was taken off along one axis instead of the normal"


def _by_start(
    case: _Case,
    mistakes: tuple[Mistake, ...],
    began: _Start,
    free: FreeOffset | None,
    u: float,
    radius: float,
) -> tuple[Finding, ...]:
    """Compare the distance in the start frame with what each mistake would leave there."""
    off = began.offset_mm - case.stated_mm
    if not (np.isfinite(off) and began.spread_mm <= STARTED * abs(off)):
        return ()
    wide = 0.1 * radius + SURE * began.spread_mm
    near = [m for m in mistakes if abs(began.offset_mm - m.offset_mm) <= wide]
    if not near:
        return ()
    first = min(near, key=lambda m: abs(began.offset_mm - m.offset_mm))
    said = (
        f"in the frame of the file the points lie {began.offset_mm:.5g} mm (spread {began.spread_mm:.2g} mm) "
        f"from the nominal instead of {case.stated_mm:.5g} mm"
    )
    if free is not None and abs(free.offset_mm - first.offset_mm) > SURE * u:
        words = (
            f"{said}, but their shape says {free.offset_mm:.4g} +- {u:.2g} mm: the frame is shifted, as if "
            "its zero was set with the ball's centre"
        )
        return (Finding("frame-shifted", words, Evidence.SUSPECT, "check the zero of the part's frame"),)
    tight = SURE * began.spread_mm + LOOSE * radius
    sure = abs(began.offset_mm - first.offset_mm) <= min(tight, 0.15 * abs(first.offset_mm - case.stated_mm))
    words = (
        f"{said}: {first.words}, unless the frame's zero was set so (RMS {_um(case.rms_mm)} um as stated, "
        f"{_um(_rms_at(case, first.offset_mm))} um like this: RMS does not choose)"
    )
    return (Finding(first.name, words, Evidence.CLEAR if sure else Evidence.SUSPECT, first.remedy),)


def _mirrored(case: _Case, points_mm: Array, start: Pose, *, contact: bool) -> tuple[Finding, ...]:
    """Ask whether another reading of the axes fits far better than the ordinary fit."""
    if case.rms_mm <= GROSS * case.size_mm:
        return ()
    found = explain_failure(points_mm, case.nominal, start=start, contact=contact, rms_mm=case.rms_mm)
    return tuple(f for f in found if f.evidence is Evidence.CLEAR)


def _untold(case: _Case, other_mm: float, radius: float) -> Finding:
    """Say that nothing speaks for the radius or the side."""
    if case.stated_mm == 0.0:
        what, other = "whether these are contact points", ""
        remedy = "check that the tip radius was taken off once, along the normal"
    else:
        what = f"the tip radius ({radius:.4g} mm) or its side"
        other = f" (RMS {_um(case.rms_mm)} um as stated, {_um(other_mm)} um on the other side)"
        remedy = "check --side and --tip-radius of offset by hand"
    why = "the part is too flat and the frame of the file is not the part's"
    return Finding("untold", f"the data cannot tell {what}: {why}{other}", Evidence.UNTOLD, remedy)


def _um(length_mm: float) -> str:
    return f"{length_mm * UM_PER_MM:.4g}"
