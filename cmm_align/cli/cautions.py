"""What the user should know although nothing failed: pure functions from a noun to warnings."""

from __future__ import annotations

from typing import Final

import numpy as np

from cmm_align.config import AlignConfig
from cmm_align.model import Alignment, Correction, DeviationMap, Nominal, NominalQuality, PointStatus
from cmm_align.stages.map_grid import points_apart
from cmm_align.units import UM_PER_MM

TIGHT_FIT: Final = 0.5
"""Warn where the ball takes up this share of the concave radius."""
TWO_PATHS_NM: Final = 10.0
"""Warn where the two independent ways to a deviation differ by more."""
LOCKED_UNCERTAINTY_UM: Final = 100.0
"""Warn of a motion that is known no better than this."""
ALIKE: Final = 0.95
"""Correlation above which two unknowns can hardly be told apart."""
FULL_COVERAGE: Final = 0.95
"""Warn of a map that knows less than this share of the nominal."""
WIDE_TOLERANCE: Final = 20.0
"""Warn of a tolerance more than so many times the value judged."""
FEW_NODES: Final = 36
"""Warn of a map with fewer nodes: as many as the shapes that PVr takes away."""
MANY_CONTINUED: Final = 0.05
"""Warn where more than this share of the nodes is continued without data."""


def of_nominal(nominal: Nominal) -> list[str]:
    """Return what to know about a nominal and the ball that touches it."""
    quality = nominal.quality
    if quality is None:
        return []
    texts = []
    radius = quality.min_concave_radius_mm
    if not quality.regular:
        texts.append(_too_large(nominal, quality))
    elif radius is not None and nominal.tip_radius_mm > TIGHT_FIT * radius:
        texts.append(f"the ball is more than half as large as the smallest concave radius ({radius:.3g} mm)")
    if quality.surface_error_pv_nm > TWO_PATHS_NM:
        texts.append(
            f"the nominal's points are sparse: the surface through them is known to "
            f"{quality.surface_error_pv_nm:.0f} nm only; give more points, or the prescription"
        )
    return texts


def _too_large(nominal: Nominal, quality: NominalQuality) -> str:
    """Return where the ball does not fit, how much of the part that concerns, and which ball would."""
    text = f"the ball does not fit everywhere: tip radius {nominal.tip_radius_mm:g} mm"
    radius, at = quality.min_concave_radius_mm, quality.min_concave_at_mm
    if radius is not None and at is not None:
        text += f", smallest concave radius {radius:.3g} mm at x = {at[0]:.4g}, y = {at[1]:.4g} mm"
    if quality.n_not_reached:
        share = 100.0 * quality.n_not_reached / quality.n_points
        text += f"; {quality.n_not_reached} of {quality.n_points} nodes ({share:.2g} %) are not reached"
    if quality.max_held_off_mm:
        text += f", the ball stays up to {quality.max_held_off_mm * UM_PER_MM:.3g} um off"
    return text + (f"; a ball of radius {radius:.3g} mm or less fits" if radius is not None else "")


def of_alignment(alignment: Alignment) -> list[str]:
    """Return what to know about an alignment."""
    report = alignment.report
    texts = list(report.warnings)
    texts += [f"{motion}; held at the start value" for motion in report.unobservable]
    if report.free_scale is not None:
        alike = [name for name, rho in report.free_scale.correlation.items() if abs(rho) > ALIKE]
        if alike:
            texts.append(
                f"the free scale can hardly be told from {', '.join(alike)}: form error can feign it; "
                "prefer --temperature and --expansion"
            )
    if report.two_path_difference_nm > TWO_PATHS_NM:
        texts.append(
            f"two ways to the same deviation differ by {report.two_path_difference_nm:.0f} nm: "
            "the nominal's points are too sparse for more"
        )
    for name, sigma in report.pose_sigma.items():
        if name.endswith("_um") and np.isfinite(sigma) and sigma > LOCKED_UNCERTAINTY_UM:
            texts.append(
                f"{name.removesuffix('_um')} is known to {sigma / UM_PER_MM:.2g} mm only: "
                "the form is too weak to say more"
            )
    return texts


def of_tolerance(alignment: Alignment, config: AlignConfig) -> list[str]:
    """Return what to know about a tolerance that is far from what was measured."""
    if alignment.report.criterion != "within-tolerance":
        return []
    e = alignment.deviation_mm[alignment.judged]
    largest_um = float(np.abs(e).max()) * UM_PER_MM
    wide_um = max(config.tolerance_upper_um, -config.tolerance_lower_um)
    if wide_um <= WIDE_TOLERANCE * largest_um:
        return []
    return [
        f"the tolerance, {wide_um:g} um, is more than {WIDE_TOLERANCE:g} times the largest deviation, "
        f"{largest_um:.4g} um (a bare number is mm: --tolerance {wide_um / UM_PER_MM:g}um?)"
    ]


def of_map(deviation_map: DeviationMap) -> list[str]:
    """Return what to know about a map."""
    alignment = deviation_map.alignment
    texts = []
    if alignment.report.n_outliers:
        e = alignment.deviation_mm[alignment.status == PointStatus.OUTLIER] * UM_PER_MM
        worst = float(e[np.argmax(np.abs(e))])
        texts.append(
            f"{len(e)} points were left out as outliers, up to {worst:+.4g} um: they are not in the map nor "
            "in its numbers; if it is dirt, clean and measure again"
        )
    n_nodes, n_points = deviation_map.statistics.n, deviation_map.point_statistics.n
    if n_nodes < FEW_NODES:
        texts.append(
            f"{n_points} points make a map of only {n_nodes} nodes, {deviation_map.spacing_mm:.3g} mm apart; "
            "form between them is not seen, and PV is likely larger"
        )
    coverage = deviation_map.coverage
    if np.isfinite(coverage) and coverage < FULL_COVERAGE:
        whole = alignment.report.report_region.removeprefix("the ") or "nominal"
        texts.append(
            f"the map knows {100.0 * coverage:.0f} % of the {whole} only: its numbers and verdict say "
            "nothing about the rest"
        )
        n_apart, spacing_mm = points_apart(deviation_map)
        if spacing_mm > 0.0:
            texts.append(
                f"{n_apart} points lie too far apart for a grid of {deviation_map.spacing_mm:.3g} mm and are "
                f"in no node: --spacing {spacing_mm:.2g}mm takes them in"
            )
    return texts


def of_causes(deviation_map: DeviationMap) -> list[str]:
    """Return what to put right before a map is compensated."""
    found = deviation_map.root_causes
    cause = None if found is None else found.dominant
    if cause is None:
        return []
    return [
        f"a single cause may explain most of this map: {cause.words}; "
        "a correction would grind it into a freeform"
    ]


def of_tolerances(deviation_map: DeviationMap) -> list[str]:
    """Return what to know about tolerances that are far from what was measured."""
    judged = deviation_map.conformance.judgements if deviation_map.conformance is not None else ()
    return [
        f"the tolerance on {j.quantity}, {j.upper:g} {j.unit}, is more than {WIDE_TOLERANCE:g} times the "
        f"value judged, {j.measured:.4g} {j.unit}: is its unit right?"
        for j in judged
        if j.quantity != "band" and j.upper is not None and j.upper > WIDE_TOLERANCE * j.measured
    ]


def of_correction(correction: Correction) -> list[str]:
    """Return what to know about a correction."""
    texts = [] if correction.limits is None else list(correction.limits.warnings)
    share = continued_share(correction)
    if share > MANY_CONTINUED:
        texts.append(
            f"{100.0 * share:.0f} % of the nodes have no data of their own and are continued from "
            "neighbours: the picture hatches them"
        )
    if not correction.worth_another_pass:
        texts.append(f"another pass: {correction.reason}")
    return texts


def continued_share(correction: Correction) -> float:
    """Return the share of the nodes that are continued without data, 0 to 1."""
    inside = int(np.isfinite(correction.correction_mm).sum())
    return int(correction.extended.sum()) / max(inside, 1)
