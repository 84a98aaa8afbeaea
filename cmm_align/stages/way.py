"""Finding the way: from wherever the part lies to near the nominal, on a light net of facets.

The paper's method (facets of the projected equidistant surface) with few points; what is found here is only
a start for the smooth fit.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from cmm_align.model import Nominal
from cmm_align.numerics.linearisation import Measure, Placement, evaluate, even_sample
from cmm_align.numerics.observability import spectrum
from cmm_align.numerics.outliers import MAD_SIGMA
from cmm_align.numerics.rigid_fit import FitResult, FitSettings, fit, without_free_drift
from cmm_align.pose import Pose
from cmm_align.surfaces.distance import facet_measure, light_net
from cmm_align.surfaces.protocol import Array, Mask

COARSE_TOLERANCE: Final = 1e-3
"""The light net is left when a step moves nothing by more than this share of the size."""
COARSE_OBSERVABILITY: Final = 1e-5
"""Facets break symmetries a little: on them, weaker motions than this are left alone."""
FREE_ROUNDS: Final = 20
WAY_POINTS: Final = 5000
"""Points that are enough to find the way."""
TRIMS: Final = 6
"""Rounds in which stray points are left out while the way is found."""
NEAR: Final = 0.25
"""Share of the points over the nominal from which on both frames are taken to be near each other."""


def find_the_way(
    few: Array,
    centroid: Array,
    nominal: Nominal,
    radius: float,
    settings: FitSettings,
    start: Pose | None,
) -> tuple[Placement, FitResult]:
    """Bring the cloud near the nominal on a light net of facets; every point counts, wherever it lies.

    Parameters
    ----------
    few : ndarray, shape (n, 3), mm
        Measured points about their centroid, frame `machine`.
    centroid : ndarray, shape (3,), mm, frame `machine`
    nominal : Nominal
    radius : float
        Tip radius, mm; 0 for contact points.
    settings : FitSettings
    start : Pose or None
        ``part_from_machine`` to start from.

    Returns
    -------
    start : Placement
        Where it began.
    way : FitResult
        Where it ended.
    """
    few = few[even_sample(len(few), WAY_POINTS)]
    net = light_net(nominal.surface, nominal.side, radius)
    measure = facet_measure(net, nominal.side)
    surface_from_part = nominal.surface_from_part
    pose = surface_from_part @ (start or Pose.identity("part", "machine"))
    placement = Placement(pose.rotation, pose.apply(centroid[None])[0])
    everywhere = np.ones(len(few), dtype=bool)
    if start is None:
        there = evaluate(measure, few, placement, settings.length_mm, used=everywhere)
        near = float(np.mean(there.inside)) >= NEAR
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


def held_at_the_start(
    measure: Measure, few: Array, start: Placement, near: FitResult, settings: FitSettings
) -> Placement:
    """Move back along the free motions to where the part lay before the fit.

    Parameters
    ----------
    measure : Measure
    few : ndarray, shape (n, 3), mm
        Measured points about their centroid.
    start : Placement
    near : FitResult
    settings : FitSettings
    """
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
