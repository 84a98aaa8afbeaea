"""The first step from far off: the principal axes of a cloud laid on those of its target.

Where the cloud covers the target, this one step leads as near as three or four steps of a fit.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from cmm_align.numerics.fit_steps import FitSettings
from cmm_align.numerics.linearisation import Evaluation, Measure, evaluate
from cmm_align.numerics.observability import spectrum
from cmm_align.numerics.pose_starts import ALIKE, Frame, principal_frame
from cmm_align.numerics.rigid_fit import Look
from cmm_align.numerics.steering import Placement

Array = NDArray[np.float64]

COVERED: Final = 0.2
"""Lateral spreads that differ by no more than this may be those of a cloud that covers its target."""
NEARER: Final = 0.2
"""Share of the distances at the start that may be left: a step of the fit does about as much."""
_HALF_TURNS: Final = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]])


def laid_by_moments(
    measure: Measure, points_mm: Array, target_points_mm: Array, start: Placement, settings: FitSettings
) -> tuple[Placement, tuple[Look, ...]]:
    """Lay the principal axes of a cloud on those of its target, in the way that turns it least.

    Parameters
    ----------
    measure : Measure
        With a continuation past the border (facets).
    points_mm : ndarray, shape (n, 3), mm
        Measured points about their centroid.
    target_points_mm : ndarray, shape (m, 3), mm, frame `surface`
        Points spread evenly over the target.
    start : Placement
    settings : FitSettings

    Returns
    -------
    laid : Placement
        `start` itself where the axes tell nothing: the cloud covers a part of the target, two axes are
        alike, a motion is free (only its start value is right), or the points come not much nearer.
    looks : tuple of Look
        The record of the start; empty if no step was taken.
    """
    cloud, target = principal_frame(points_mm), principal_frame(target_points_mm)
    if not _tells(cloud, target):
        return start, ()
    turns = [target.axes * signs @ cloud.axes.T for signs in _HALF_TURNS]
    rotation = max(turns, key=lambda turn: float(np.sum(turn * start.rotation)))
    laid = Placement(rotation, target.centre_mm - rotation @ cloud.centre_mm)
    here = _looked_at(measure, points_mm, start, settings)
    there = _looked_at(measure, points_mm, laid, settings)
    free = spectrum(there.normal_matrix, settings.min_observability).free.any()
    if free or _typical_mm(there) > NEARER * _typical_mm(here):
        return start, ()
    return laid, (Look(0.0, here.cost_mm2, len(points_mm)),)


def _tells(cloud: Frame, target: Frame) -> bool:
    """Return whether every axis of the cloud can be one axis of the target only."""
    like = np.abs(cloud.spread_mm - target.spread_mm)[:2] <= COVERED * target.spread_mm[:2]
    apart = target.spread_mm[:2] >= ALIKE * target.spread_mm[1:]
    return bool(like.all() and apart.all())


def _looked_at(measure: Measure, points_mm: Array, placement: Placement, settings: FitSettings) -> Evaluation:
    """Measure every point, wherever it lies."""
    everywhere = np.ones(len(points_mm), dtype=bool)
    return evaluate(measure, points_mm, placement, settings.length_mm, used=everywhere)


def _typical_mm(now: Evaluation) -> float:
    """Return the median distance, mm: stray points are not heard."""
    return float(np.median(np.abs(now.feet.distance_mm)))
