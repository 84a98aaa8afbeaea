"""What the user should know although nothing failed: pure functions from a noun to warnings."""

from __future__ import annotations

from typing import Final

import numpy as np

from cmm_align.model import Alignment, Correction, DeviationMap, Nominal
from cmm_align.units import UM_PER_MM

TIGHT_FIT: Final = 0.5
"""Warn where the ball takes up this share of the concave radius."""
TWO_PATHS_NM: Final = 10.0
"""Warn where the two independent ways to a deviation differ by more."""
MANY_OUTSIDE: Final = 0.02
"""Warn where this share of the points lies outside the nominal."""
LOCKED_UNCERTAINTY_UM: Final = 100.0
"""Warn of a motion that is known no better than this."""


def of_nominal(nominal: Nominal) -> list[str]:
    """Return what to know about a nominal and the ball that touches it."""
    quality = nominal.quality
    if quality is None:
        return []
    texts = []
    radius = quality.min_concave_radius_mm
    if not quality.regular:
        texts.append(
            f"the ball does not fit everywhere: tip radius {nominal.tip_radius_mm:g} mm, smallest concave "
            f"radius {radius:.3g} mm; points there are left out"
            if radius is not None
            else "the equidistant surface is not regular everywhere; points there are left out"
        )
    elif radius is not None and nominal.tip_radius_mm > TIGHT_FIT * radius:
        texts.append(f"the ball is more than half as large as the smallest concave radius ({radius:.3g} mm)")
    if quality.surface_error_pv_nm > TWO_PATHS_NM:
        texts.append(
            f"the nominal's points are sparse: the surface through them is known to "
            f"{quality.surface_error_pv_nm:.0f} nm only; give more points, or the prescription"
        )
    return texts


def of_alignment(alignment: Alignment) -> list[str]:
    """Return what to know about an alignment."""
    report = alignment.report
    texts = [f"{motion}; held at the start value" for motion in report.unobservable]
    count = len(alignment.deviation_mm)
    if report.n_outside > MANY_OUTSIDE * count:
        texts.append(f"{report.n_outside} of {count} points lie outside the nominal")
    if report.n_outliers:
        texts.append(f"{report.n_outliers} of {count} points were left out of the fit as outliers")
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


def of_map(deviation_map: DeviationMap) -> list[str]:
    """Return what to know about a map."""
    count = deviation_map.deviation_mm.size
    unknown = int(np.isnan(deviation_map.deviation_mm).sum())
    if unknown > count // 2:
        return [f"{unknown} of {count} nodes of the map are unknown: no points near them"]
    return []


def of_correction(correction: Correction) -> list[str]:
    """Return what to know about a correction."""
    if correction.worth_another_pass:
        return []
    return [f"another pass is not worth it: {correction.reason}"]
