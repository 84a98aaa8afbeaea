"""Finding the way: from wherever the part lies to near the nominal, on a light net of facets.

The paper's method (facets of the projected equidistant surface) with few points; what is found here is only
a start for the smooth fit.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from cmm_align.errors import GeometryError
from cmm_align.model import Nominal
from cmm_align.numerics.fit_steps import FitSettings
from cmm_align.numerics.linearisation import Measure, evaluate, even_sample, moved
from cmm_align.numerics.moments import laid_by_moments
from cmm_align.numerics.observability import spectrum
from cmm_align.numerics.outliers import MAD_SIGMA
from cmm_align.numerics.pose_evidence import equal_factor
from cmm_align.numerics.pose_search import search as search_poses
from cmm_align.numerics.pose_verdicts import good_enough, is_mirrored, near_ties
from cmm_align.numerics.rigid_fit import FitResult, Look, fit, joined, without_free_drift
from cmm_align.numerics.rotations import vector_from_rotation
from cmm_align.numerics.steering import FREELY, Lock, Placement, Steering, allowed_motions, held
from cmm_align.numerics.triangle_net import TriangleNet
from cmm_align.pose import Pose
from cmm_align.surfaces.distance import facet_measure, light_net, smooth_measure
from cmm_align.surfaces.protocol import Array, Mask
from cmm_align.units import DEG_PER_RAD, UM_PER_MM

COARSE_TOLERANCE: Final = 1e-3
"""The light net is left when a step moves nothing by more than this share of the size."""
COARSE_OBSERVABILITY: Final = 1e-5
"""Facets break symmetries a little: on them, weaker motions than this are left alone."""
FREE_ROUNDS: Final = 20
WAY_POINTS: Final = 5000
"""Points that are enough to find the way."""
TRIMS: Final = 6
"""Rounds in which stray points are left out while the way is found."""
MIRROR_RMS: Final = 1e-3
"""Below this share of the size a fit is not suspected to be that of a mirror image."""
TIE_TOLERANCE: Final = 1e-6
TURN_DEG: Final = 1.0
NEAR: Final = 0.25
"""Share of the points over the nominal from which on both frames are taken to be near each other."""


def find_the_way(
    few: Array,
    centroid: Array,
    nominal: Nominal,
    radius: float,
    settings: FitSettings,
    start: Pose | None,
    search: str = "auto",
    lock: Lock | None = None,
) -> tuple[Placement, FitResult, tuple[str, ...]]:
    """Bring the cloud near the nominal on a light net of facets; every point counts, wherever it lies.

    The first step lays the principal axes on those of the net, where they tell.

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
    search : str
        Whether to search all poses: auto (if the start alone may have led astray and none was given),
        always, never.
    lock : Lock, optional
        Motions to hold at the start; nothing is searched then.

    Returns
    -------
    start : Placement
        Where it began: motions that the data cannot tell are held there.
    way : FitResult
        Where it ended.
    notes : tuple of str
        Other positions that fit nearly as well, with both residuals.

    Raises
    ------
    GeometryError
        If the cloud is mirrored.
    """
    few = few[even_sample(len(few), WAY_POINTS)]
    net = light_net(nominal.surface, nominal.side, radius)
    measure = facet_measure(net, nominal.side)
    surface_from_part = nominal.surface_from_part
    pose = surface_from_part @ (start or Pose.identity("part", "machine"))
    placement = Placement(pose.rotation, pose.apply(centroid[None])[0])
    everywhere = np.ones(len(few), dtype=bool)
    steering = Steering(lock=lock)
    if start is None and lock is None:
        there = evaluate(measure, few, placement, settings.length_mm, used=everywhere)
        near = float(np.mean(there.inside)) >= NEAR
        if not near and settings.max_iterations > 0:  # not near each other: move the cloud onto the nominal
            placement = Placement(pose.rotation, net.points_mm.mean(axis=0))
    coarse = replace(
        settings,
        tolerance=COARSE_TOLERANCE,
        min_observability=max(COARSE_OBSERVABILITY, settings.min_observability),
    )
    may_jump = lock is None and settings.max_iterations > 0
    begun = placement
    looks: tuple[Look, ...] = ()
    if may_jump:
        begun, looks = laid_by_moments(measure, few, net.points_mm, placement, coarse)
    way = fit(measure, few, begun, coarse, used=everywhere, steering=steering)
    if looks:
        way = _after_a_jump(looks, _apart_mm(few, placement, begun), way)
    if may_jump and _share_on(way) < NEAR:  # it has slid off: begin above the middle
        middle = Placement(placement.rotation, net.points_mm.mean(axis=0))
        again = fit(measure, few, middle, coarse, used=everywhere)
        if _share_on(again) > _share_on(way):
            way = _after_a_jump(way.looks, _apart_mm(few, way.placement, middle), again)
    for _ in range(TRIMS):  # touches of the fixture must not lead astray; who is kept, all points say later
        kept = _near_the_rest(way.evaluation.feet.distance_mm, COARSE_TOLERANCE * settings.size_mm)
        if np.array_equal(kept, way.evaluation.used):
            break
        again = fit(measure, few, way.placement, coarse, used=kept, steering=steering)
        way = joined(way, again)
    asked = search == "always" or (search == "auto" and start is None)
    if not asked or lock is not None or settings.max_iterations == 0:
        return placement, way, ()
    exact = smooth_measure(nominal.surface, nominal.side, radius)
    facet_error = _facet_error_mm(net, exact)
    if search == "auto" and good_enough(
        measure, few, net.points_mm, way.placement, way.evaluation, settings, facet_error
    ):
        return placement, way, ()
    return _searched(measure, exact, few, net, settings, placement, facet_error)


def _after_a_jump(looks: tuple[Look, ...], jump_mm: float, then: FitResult) -> FitResult:
    """Return a fit with the record that led to its start; the jump there is a step like any other."""
    landed = then.looks[0]._replace(movement_mm=jump_mm)
    return then._replace(iterations=len(looks) + then.iterations, looks=(*looks, landed, *then.looks[1:]))


def _apart_mm(points_mm: Array, one: Placement, other: Placement) -> float:
    """Return the most that a point moves from one placement to another, mm."""
    apart = moved(points_mm, other) - moved(points_mm, one)
    return float(np.linalg.norm(apart, axis=1).max())


def _share_on(way: FitResult) -> float:
    """Return the share of the points that lie over the nominal."""
    return float(np.mean(way.evaluation.inside))


def _facet_error_mm(net: TriangleNet, exact: Measure) -> float:
    """Return the rms distance of the middles of some facets from the surface, mm."""
    middles = net.points_mm[net.triangles[:: max(1, len(net.triangles) // 500)]].mean(axis=1)
    distance = exact.distance(middles, None)[0].distance_mm
    return float(np.sqrt(np.nanmean(distance**2)))


def _searched(
    measure: Measure,
    exact: Measure,
    few: Array,
    net: TriangleNet,
    settings: FitSettings,
    start: Placement,
    facet_error_mm: float,
) -> tuple[Placement, FitResult, tuple[str, ...]]:
    """Search all poses; let smooth fits settle what facets cannot, and say what stays open.

    Raises
    ------
    GeometryError
        If the cloud fits as its own mirror image only.
    """
    found = search_poses(measure, few, net.points_mm, settings, start=start)
    best = found[0]
    if best.rms_mm > MIRROR_RMS * settings.size_mm and is_mirrored(
        measure, few, net.points_mm, settings, best
    ):
        raise GeometryError(
            "the cloud is mirrored",
            expected="right-handed coordinates",
            remedy="swap the sign of one axis, or the order of two columns",
        )
    tied = [best, *near_ties(found, facet_error_mm)]
    notes: tuple[str, ...] = ()
    if len(tied) > 1:
        near = replace(settings, tolerance=TIE_TOLERANCE)
        ends = [fit(exact, few, one.placement, near, used=one.used) for one in tied]
        costs = [end.evaluation.cost_mm2 for end in ends]
        k = 0 if costs[0] <= min(costs) * equal_factor(len(few)) ** 2 else int(np.argmin(costs))
        best = tied[k]
        rest = [np.sqrt(c) * UM_PER_MM for n, c in enumerate(costs) if n != k]
        turns = [_turn_deg(end.placement, ends[k].placement) for n, end in enumerate(ends) if n != k]
        notes = tuple(
            f"the part fits nearly as well in another position, turned by {turn:.0f} deg: RMS "
            f"{other:.3g} um against {np.sqrt(costs[k]) * UM_PER_MM:.3g} um"
            for other, turn in zip(rest, turns, strict=True)
            if turn > TURN_DEG
        )
    settled = fit(measure, few, best.placement, replace(settings, max_iterations=0), used=best.used)
    return best.placement, settled._replace(iterations=best.iterations), notes


def _turn_deg(one: Placement, other: Placement) -> float:
    """Return the angle between two placements, degrees."""
    turn = vector_from_rotation(one.rotation @ other.rotation.T)
    return float(np.linalg.norm(turn)) * DEG_PER_RAD


def held_at_the_start(
    measure: Measure,
    few: Array,
    start: Placement,
    near: FitResult,
    settings: FitSettings,
    steering: Steering = FREELY,
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
    steering : Steering
    """
    placement, spectral = near.placement, near.spectral
    for _ in range(FREE_ROUNDS):
        placement, movement = without_free_drift(start, placement, spectral, settings.length_mm)
        if movement <= settings.tolerance * settings.size_mm:
            break
        placement = held(steering.lock, placement)
        there = evaluate(measure, few, placement, settings.length_mm, steering=steering)
        allowed = allowed_motions(steering.lock, placement, settings.length_mm)
        spectral = spectrum(there.normal_matrix, settings.min_observability, allowed, there.datum_matrix)
    return placement


def _near_the_rest(distance_mm: Array, least_mm: float) -> Mask:
    """Return which distances lie within three robust sigma, or within `least_mm`, of their median."""
    off = np.abs(distance_mm - np.median(distance_mm))
    kept: Mask = off <= max(3.0 * MAD_SIGMA * float(np.median(off)), least_mm)
    return kept
