"""The rows of the summary of `align`: (label, value with unit), most telling first, and its verdict."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

from cmm_align.model import Alignment, FitReport, MonteCarlo, PointStatus, PoseKnowledge, Verdict
from cmm_align.model.removed_motion import words as removed_words
from cmm_align.pose import Pose
from cmm_align.report.wording import calm, extreme, in_nm, in_um, signed, triple, two_digits
from cmm_align.units import DEG_PER_RAD, UM_PER_MM

Rows = list[tuple[str, str]]

PPM: Final = 1e6
MOST_OUTLIERS: Final = 10
"""Outliers that are listed on the screen; all are in the file."""


def of_alignment(alignment: Alignment) -> Rows:
    """Return the summary of `align`."""
    r = alignment.report
    e = alignment.deviation_mm[alignment.judged]
    low, high = float(e.min()), float(e.max())
    rows = [
        ("points", _points(alignment)),
        ("RMS", in_um(math.sqrt(float((e**2).mean())))),
        ("PV", f"{in_um(high - low)}  ({extreme(low)} to {extreme(high)})"),
        ("part_from_machine", _pose(alignment.part_from_machine)),
        _known(r),
    ]
    if r.unobservable:
        rows.append(("not observable", ", ".join(r.unobservable) + "; held at the start value"))
    rows += _choices(r)
    if r.knowledge is not None and r.knowledge.weak:
        rows += _weakly(r.knowledge)
    if r.monte_carlo is not None:
        rows += _simulated(r.monte_carlo)
    if r.bidirectional is not None:
        rows.append(("the other way", r.bidirectional.words))
    return rows


def _known(report: FitReport) -> tuple[str, str]:
    """Say how well the pose is known: where it matters, at the edge of the part."""
    k = report.knowledge
    if k is None or not math.isfinite(k.edge_sigma_um):
        return "uncertainty (k=1)", _pose_sigma(report.pose_sigma, report.locked)
    how = "k=1" if report.criterion == "least-squares" else "k=1, as of least squares"
    return (
        "pose known to",
        f"{two_digits(k.edge_sigma_um)} um along the normal at the edge of the part ({how})",
    )


def _weakly(knowledge: PoseKnowledge) -> Rows:
    """Name the motions that the form hardly holds, each with how far it may displace the edge."""
    told = []
    for motion in knowledge.weak:
        name = motion.words.partition(" (nearly a ")[2].removesuffix(")") or motion.words
        told.append(f"{name}, {in_um(motion.sigma_um / UM_PER_MM)}")
    return [("weakly known" if k == 0 else "", line) for k, line in enumerate(told)]


def _choices(report: FitReport) -> Rows:
    """Say what was asked for beyond the plain fit."""
    rows = []
    if report.method != "foot-point":
        rows.append(("method", f"{report.method}: a reference method, not for the shop"))
    if report.criterion != "least-squares":
        rows.append(("criterion", _criterion(report)))
    if report.locked:
        rows.append(("locked", f"{', '.join(report.locked)} in frame {report.lock_frame}, as at the start"))
    if report.weights != "equal":
        words = {"sigma": "by stated uncertainty", "area": "by area", "stated": "as stated"}
        rows.append(("weights", words[report.weights]))
    if report.fit_region or report.report_region:
        fit, told = report.fit_region or "the whole nominal", report.report_region or "the whole nominal"
        rows.append(("regions", f"fitted on {fit}; numbers of {told}"))
    if report.n_fiducials:
        rows.append(("datum terms", f"{report.n_fiducials} coordinates of fiducials beside the points"))
    if report.free_scale is not None:
        name, rho = max(report.free_scale.correlation.items(), key=lambda item: abs(item[1]))
        ppm = (report.scale - 1.0) * PPM
        sigma = report.free_scale.sigma * PPM
        rows.append(
            ("scale", f"{ppm:+.2f} ppm, u {two_digits(sigma)} ppm; correlation with {name} {rho:+.3f}")
        )
    elif report.scale != 1.0:
        rows.append(("scale", f"{(report.scale - 1.0) * PPM:+.2f} ppm, from the temperature"))
    return rows


def _simulated(simulated: MonteCarlo) -> Rows:
    """Return what a Monte Carlo says."""
    rows = [
        (
            "Monte Carlo",
            f"{simulated.n} measurements with MPE {simulated.mpe} um: {_pose_sigma(simulated.pose_sigma)}",
        )
    ]
    for name, spread in (("RMS", simulated.rms), ("PV", simulated.pv)):
        told = f"{name} {calm(spread.mean_um)} um, 95 % from {calm(spread.low_um)} to {calm(spread.high_um)}"
        rows.append(("", f"{told} (measured {calm(spread.measured_um)})"))
    return rows


def verdict_of_alignment(alignment: Alignment) -> tuple[Verdict, tuple[str, ...]]:
    """Return the verdict where a tolerance or limits were given, and a sentence for each.

    Returns
    -------
    verdict : Verdict
    reasons : tuple of str
    """
    r = alignment.report
    outcomes, reasons = [], []
    if r.criterion == "within-tolerance":
        margin = -r.certificate["zone_um"]
        ids = ", ".join(str(number) for number in r.proof_ids)
        outcomes.append(Verdict.PASS if margin >= 0.0 else Verdict.FAIL)
        reasons.append(
            f"there is a position within tolerance, with {calm(margin)} um to spare"
            if margin >= 0.0
            else f"no position is within tolerance: {calm(-margin)} um are missing, points {ids} prove it"
        )
        left = r.n_outliers + r.n_apart
        if margin >= 0.0 and left:
            outcomes[-1] = Verdict.UNDECIDED
            reasons[-1] += f"; but {left} points, outliers or outside the fit region, were not asked"
    if r.removed is not None and r.removed.verdict != Verdict.NONE:
        outcomes.append(Verdict(r.removed.verdict))
        lines = removed_words(r.removed)
        reasons += [line for line in lines if "limit" in line] or list(lines)
    for verdict in (Verdict.FAIL, Verdict.UNDECIDED, Verdict.PASS):
        if verdict in outcomes:
            return verdict, tuple(reasons)
    return Verdict.NONE, ()


def _points(alignment: Alignment) -> str:
    """Say how many points steered the fit, and what became of the others."""
    r, used = alignment.report, alignment.used
    counts = [(r.n_outside, "outside"), (r.n_outliers, "outliers")]
    for count, what in (
        (r.n_edge, "on the edge"),
        (r.n_not_reached, "not reached"),
        (r.n_apart, "outside the fit region" if r.fit_region else "on the brink"),
    ):
        counts += [(count, what)] if count else []
    left = ", ".join(f"{count} {what}" for count, what in counts)
    judged = int(alignment.judged.sum())
    apart = "" if judged == int(used.sum()) else f"; numbers of {judged}"
    return f"{int(used.sum())} of {len(used)} used; {left}{apart}"


def _criterion(report: FitReport) -> str:
    """Say what the fit made small, and how well that is proved."""
    if not report.certificate:
        return report.criterion
    proof = report.certificate
    if report.criterion == "within-tolerance":
        return f"within-tolerance, margin {-proof['zone_um']:+.4g} um, proved to {proof['residual']:.0e}"
    return (
        f"{report.criterion}, {proof['zone_um']:.4g} um, proved by {proof['n_active']:.0f} points "
        f"to {proof['residual']:.0e}"
    )


def details_of_alignment(alignment: Alignment) -> Rows:
    """Return what `align` has to say beyond its summary."""
    r = alignment.report
    turn = alignment.part_from_machine.rotation_vector_rad()
    rows = [
        ("uncertainty (k=1)", _pose_sigma(r.pose_sigma, r.locked)),
        ("rotation vector", f"({triple(turn * DEG_PER_RAD, 6)}) deg"),
        ("stopped", f"after {r.iterations} iterations: {r.stop_reason}"),
        ("distance", r.distance),
        ("two paths differ by", in_nm(r.two_path_difference_nm)),
        ("criterion", _criterion(r)),
    ]
    if r.knowledge is not None:
        rows += [("the pose" if k == 0 else "", line) for k, line in enumerate(r.knowledge.words())]
    if r.removed is not None:
        rows += [("removed" if k == 0 else "", line) for k, line in enumerate(removed_words(r.removed))]
    rows += _outliers(alignment)
    if r.cost_history_mm2:
        steps = ", ".join(f"{math.sqrt(max(c, 0.0)) * UM_PER_MM:.4g}" for c in r.cost_history_mm2)
        rows.append(("RMS before each step", f"{steps} um"))
    return rows


def _outliers(alignment: Alignment) -> Rows:
    """List the largest outliers, with id and place."""
    e = alignment.deviation_mm
    found = outliers_of(alignment)[:MOST_OUTLIERS]
    rows = []
    for number, k in enumerate(found):
        x, y, z = alignment.contact_part_mm[k]
        place = f"({signed(float(x), 2)}, {signed(float(y), 2)}, {signed(float(z), 2)}) mm"
        told = f"point {alignment.ids[k]} at {place}: {extreme(float(e[k]))}"
        rows.append(("outliers" if number == 0 else "", told))
    return rows


def outliers_of(alignment: Alignment) -> list[int]:
    """Return the rows of the outliers, largest deviation first."""
    rows = (alignment.status == PointStatus.OUTLIER).nonzero()[0]
    return sorted((int(k) for k in rows), key=lambda k: -abs(float(alignment.deviation_mm[k])))


def _pose(pose: Pose) -> str:
    turn = pose.rotation_vector_rad()
    angle = math.sqrt(float((turn**2).sum())) * DEG_PER_RAD
    return f"shift ({triple(pose.translation_mm, 4)}) mm, turned by {angle:.4f} deg"


def _pose_sigma(sigma: Mapping[str, float], locked: Sequence[str] = ()) -> str:
    """Return the uncertainties of the motions, each in the unit that suits its size."""
    words = []
    for key, value in sigma.items():
        name, _, unit = key.rpartition("_")
        if name in locked or not math.isfinite(value):
            words.append(f"{name} {'locked' if name in locked else 'unknown'}")
            continue
        larger = {"um": "mm", "urad": "mrad"}.get(unit)
        if larger is not None and value >= UM_PER_MM:
            value, unit = value / UM_PER_MM, larger  # noqa: PLW2901 - the same value in another unit
        words.append(f"{name} {two_digits(value)} {unit}")
    return ", ".join(words)
