"""Placements that differ by free motions only: one orbit, one answer.

On a sphere, a plane, a surface of revolution a whole family of placements fits alike. Facets and form error
blur that, and a weak freeform comes near to it, so an orbit is believed only if the way along it fits.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from cmm_align.numerics.fit_steps import FitSettings
from cmm_align.numerics.linearisation import Measure, Placement, evaluate, moved
from cmm_align.numerics.observability import Spectrum, free_part, spectrum
from cmm_align.numerics.pose_batch import scores
from cmm_align.numerics.rigid_fit import without_free_drift
from cmm_align.numerics.rotations import left_jacobian, rotation_from_vector, vector_from_rotation

Array = NDArray[np.float64]

NEAR: Final = 0.03
"""Placements that move no point apart by more than this share of the size are the same."""
BETWEEN: Final = (0.25, 0.5, 0.75)
"""Shares of the way along an orbit at which it is looked whether it is one."""
ALIKE: Final = 1.5
"""Scores along one orbit differ by less than this factor: facets and form error are not symmetric."""
FACETS: Final = 3e-5
"""Share of the size that facets may differ by along an orbit, where there is hardly any form error."""
_ROUNDS: Final = 10
_MOVED: Final = 1e-4
"""Share of the size below which nothing is left to take back."""


def same_place(
    measure: Measure,
    points_mm: Array,
    one: Placement,
    other: Placement,
    spectral: Spectrum,
    settings: FitSettings,
) -> bool:
    """Return whether two placements differ by little but free motions.

    Parameters
    ----------
    measure, settings
        Distance to the facets, and what keeps the fit safe.
    points_mm : ndarray, shape (n, 3), mm
        Few points about their centroid.
    one, other : Placement
    spectral : Spectrum
        At `one`.

    Notes
    -----
    A weak motion is no free one: what lies on one orbit fits alike on the way from one to the other.
    """
    w = vector_from_rotation(other.rotation @ one.rotation.T)
    t = np.linalg.solve(left_jacobian(w), other.position_mm - one.position_mm)
    motion = np.concatenate([w * settings.length_mm, t])
    near = NEAR * settings.size_mm
    if float(np.linalg.norm(motion)) <= near:
        return True
    if not spectral.free.any() or float(np.linalg.norm(motion - free_part(spectral, motion))) > near:
        return False
    between = []
    for share in BETWEEN:
        turn = share * w
        rotation = rotation_from_vector(turn) @ one.rotation
        between.append(Placement(rotation, one.position_mm + left_jacobian(turn) @ (share * t)))
    ends = max(score_of(measure, points_mm, one), score_of(measure, points_mm, other))
    bar = max(ALIKE * ends, FACETS * settings.size_mm)
    return all(score_of(measure, points_mm, p) <= bar for p in between)


def held_near(
    measure: Measure,
    points_mm: Array,
    end: Placement,
    spectral: Spectrum,
    settings: FitSettings,
    anchor: Placement,
) -> Placement:
    """Move back along the free motions to the anchor, unless the fit suffers: then they are but weak.

    Parameters
    ----------
    measure : Measure
    points_mm : ndarray, shape (n, 3), mm
        Points about their centroid.
    end, anchor : Placement
        Where a fit ended, and where its free motions are taken back to.
    spectral : Spectrum
        At `end`.
    settings : FitSettings
    """
    held = end
    for _ in range(_ROUNDS if spectral.free.any() else 0):
        held, movement = without_free_drift(anchor, held, spectral, settings.length_mm)
        if movement <= _MOVED * settings.size_mm:
            break
        spectral = spectrum_at(measure, points_mm, held, settings)
    bar = max(ALIKE * score_of(measure, points_mm, end), FACETS * settings.size_mm)
    return held if score_of(measure, points_mm, held) <= bar else end


def score_of(measure: Measure, points_mm: Array, placement: Placement) -> float:
    """Return the score, mm, of one placement of points of shape (n, 3), mm."""
    feet, inside = measure.distance(moved(points_mm, placement), None)
    return float(scores(feet.distance_mm[None], inside[None])[0])


def spectrum_at(measure: Measure, points_mm: Array, placement: Placement, settings: FitSettings) -> Spectrum:
    """Return what points of shape (n, 3), mm, can tell at a placement; every point counts."""
    everywhere = np.ones(len(points_mm), dtype=bool)
    there = evaluate(measure, points_mm, placement, settings.length_mm, used=everywhere)
    return spectrum(there.normal_matrix, settings.min_observability)
