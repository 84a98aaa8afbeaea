"""The second path to every deviation, and what the operator should know of a measurement."""

from __future__ import annotations

from typing import Final

import numpy as np

from cmm_align.config import AlignConfig
from cmm_align.model import Nominal, PointKind, PointSet
from cmm_align.numerics.chunked import in_threads
from cmm_align.numerics.foot_point import Feet, foot_points
from cmm_align.numerics.linearisation import Placement, even_sample, moved
from cmm_align.surfaces.equidistant import limits_of
from cmm_align.surfaces.protocol import Array, Mask, Surface

TWO_PATH_POINTS: Final = 100_000
"""Points that are measured by both paths."""


def two_path_difference_mm(
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

    Parameters
    ----------
    centred : ndarray, shape (n, 3), mm
        Measured points about their centroid.
    placement : Placement
    feet : Feet
        Of all points, with the deviations of the first path.
    inside : ndarray of bool, shape (n,)
    nominal : Nominal
    radius : float
        Tip radius, mm; 0 for contact points.
    config : AlignConfig
    """
    pick = even_sample(len(centred), TWO_PATH_POINTS)
    centred, inside, feet = centred[pick], inside[pick], feet.of(pick)
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


def warnings_of(
    measured: PointSet, nominal: Nominal, inside: Mask, outlying: Mask, config: AlignConfig
) -> tuple[str, ...]:
    """Return what the operator should know, a sentence each.

    Parameters
    ----------
    measured : PointSet
    nominal : Nominal
    inside, outlying : ndarray of bool, shape (N,)
        Which points lie on the nominal, and which of them are outliers.
    config : AlignConfig
    """
    found = []
    ids = measured.ids[outlying]
    if measured.kind is PointKind.UNSTATED:
        found.append("the file does not say what its points are: taken for tip centres")
    outside = int(np.count_nonzero(~inside))
    if outside:
        found.append(f"{outside} of {len(measured)} points lie outside the nominal and were left out")
    quality = nominal.quality
    if quality is not None and not quality.regular:
        found.append(
            f"the ball (radius {nominal.tip_radius_mm:g} mm) does not fit everywhere: "
            f"smallest concave radius {quality.min_concave_radius_mm:.4g} mm"
        )
    if len(ids):
        named = ", ".join(str(i) for i in ids[:5]) + (" ..." if len(ids) > 5 else "")
        many = "outliers were left out of the fit: points" if len(ids) > 1 else "outlier was left out: point"
        found.append(f"{len(ids)} {many} {named}")
    if measured.weight is not None and config.weights != "stated":
        found.append("the points state weights, which were not used: --weights stated uses them")
    return tuple(found)
