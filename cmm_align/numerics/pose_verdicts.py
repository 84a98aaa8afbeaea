"""What may be said of the places found: rivals, whether the start was good enough, mirrored clouds."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cmm_align.numerics.fit_steps import FitSettings
from cmm_align.numerics.linearisation import Evaluation, Measure, Placement, moved
from cmm_align.numerics.pose_batch import fixed_order, settle
from cmm_align.numerics.pose_evidence import tie_factor
from cmm_align.numerics.pose_orbits import same_place, spectrum_at
from cmm_align.numerics.pose_search import ORBIT_OBSERVABILITY, Candidate, search
from cmm_align.numerics.pose_starts import first_guesses

Array = NDArray[np.float64]

_RIVAL_POINTS: Final = 100
_RIVAL_STEPS: Final = 15
_COVERED: Final = 0.9
_ROUNDING: Final = 1e-12
"""Distances below this share of the size are rounding."""
_TWINS: Final = 2.0
"""Two facetings of one surface differ by the root of two of their errors, and a margin."""


def near_ties(candidates: tuple[Candidate, ...], facet_error_mm: float = 0.0) -> tuple[Candidate, ...]:
    """Return the candidates, beside the first, that the data cannot clearly tell from it.

    Parameters
    ----------
    candidates : tuple of Candidate
        Best first.
    facet_error_mm : float
        RMS distance of the facets from the surface, mm: what they cannot tell is a near tie too.
    """
    best = candidates[0]
    return tuple(
        c
        for c in candidates[1:]
        if c.score_mm
        <= np.hypot(best.score_mm, _TWINS * facet_error_mm) * tie_factor(min(best.independent, c.independent))
    )


def good_enough(
    measure: Measure,
    points_mm: Array,
    target_points_mm: Array,
    way: Placement,
    evaluation: Evaluation,
    settings: FitSettings,
    facet_error_mm: float = 0.0,
) -> bool:
    """Return whether a fit from a start pose can be trusted without a search.

    The points are laid on the surface, and that perfect cloud is searched for rivals. If no rival of it comes
    nearer than twice the RMS of the fit, then by the triangle inequality no other placement of the cloud
    can fit better than this one.

    Parameters
    ----------
    measure, settings
        As for `pose_search.search`.
    points_mm, target_points_mm : ndarray, shape (n, 3), (m, 3), mm
        As for `pose_search.search`.
    way : Placement
        Where the fit ended.
    evaluation : Evaluation
        Of all points there.
    facet_error_mm : float
        RMS distance of the facets from the surface, mm. Rivals nearer than facets can tell are twins of a
        symmetric nominal: no search could choose among them, so the start does.
    """
    if float(np.mean(evaluation.inside)) < _COVERED:
        return False
    pick = np.flatnonzero(evaluation.inside & evaluation.used)
    order = fixed_order(len(pick))[:_RIVAL_POINTS]
    rms = float(np.sqrt(np.mean(evaluation.feet.distance_mm[pick] ** 2)))
    pick = pick[order]
    feet = evaluation.feet
    perfect = moved(points_mm[pick], way) - feet.distance_mm[pick, None] * feet.normal[pick]
    centre = perfect.mean(axis=0)
    perfect = perfect - centre
    here = Placement(np.eye(3), centre)
    coarse = replace(settings, min_observability=max(ORBIT_OBSERVABILITY, settings.min_observability))
    spectral = spectrum_at(measure, perfect, here, coarse)
    guesses = first_guesses(perfect, target_points_mm)
    ended = settle(measure, perfect, guesses, coarse, _RIVAL_STEPS)
    told = max(_TWINS * facet_error_mm, _ROUNDING * settings.size_mm)
    for k in np.flatnonzero((ended.score_mm < 2.0 * rms) & (ended.score_mm > told)):
        rival = Placement(ended.starts.rotations[k], ended.starts.positions_mm[k])
        if not same_place(measure, perfect, here, rival, spectral, coarse):
            return False
    return True


def is_mirrored(
    measure: Measure,
    points_mm: Array,
    target_points_mm: Array,
    settings: FitSettings,
    best: Candidate,
) -> bool:
    """Return whether the mirror image of the cloud fits clearly better than the cloud itself.

    Parameters
    ----------
    measure, settings
        As for `pose_search.search`.
    points_mm, target_points_mm : ndarray, shape (n, 3), (m, 3), mm
        As for `pose_search.search`.
    best : Candidate
        Of the cloud itself.

    Notes
    -----
    Clearly: by more than what separates near ties. A surface with a plane of symmetry fits its mirror
    image as well as itself, and is not called mirrored.
    """
    image = search(measure, points_mm * np.array([-1.0, 1.0, 1.0]), target_points_mm, settings)[0]
    factor = tie_factor(min(image.independent, best.independent))
    return image.score_mm * factor < best.score_mm
