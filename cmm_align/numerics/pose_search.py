"""Where does the part lie? A search over all orientations and places, and what its answers are worth.

Many first guesses run downhill on few points, the best go on with more, those that end in the same place
become one, the best few are fitted and judged by all points given. The same input gives the same answer.
Along free motions (a sphere turns, a plane slides) every member of the orbit fits alike; the one nearest to
the anchor is returned, so that no clocking is made up.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmm_align.numerics.fit_steps import FitSettings
from cmm_align.numerics.linearisation import Evaluation, Measure, Placement, evaluate, moved
from cmm_align.numerics.observability import Spectrum, spectrum
from cmm_align.numerics.outliers import MAD_SIGMA
from cmm_align.numerics.pose_batch import Settled, fixed_order, scores, settle
from cmm_align.numerics.pose_evidence import equal_factor, independent_number, tie_factor
from cmm_align.numerics.pose_orbits import ALIKE, NEAR, held_near, same_place
from cmm_align.numerics.pose_starts import Starts, first_guesses
from cmm_align.numerics.rigid_fit import fit
from cmm_align.numerics.rotations import vector_from_rotation

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

FACET_OBSERVABILITY: Final = 1e-5
"""Facets break symmetries a little: on them, weaker motions than this are left alone."""
ORBIT_OBSERVABILITY: Final = 1e-4
"""Motions weaker than this are looked at whether they are free: the way along them must fit alike."""
STEP_TOLERANCE: Final = 1e-4
"""A fit on facets is left when a step moves nothing by more than this share of the size."""
_STAGES: Final = ((48, 5, 64, np.inf), (200, 10, 12, 100.0), (500, 12, 4, 10.0))
"""Points, most steps, most placements kept, and the score, in those of the best, that gives up one."""
_LAST_STEPS: Final = 8
"""Most steps of a fit of all points: the batches have done the way."""
_FIT_POINTS: Final = 1500
_ROUNDING: Final = 1e-12
"""Scores below this share of the size are rounding."""
_TRIMS: Final = 3
_SIGMAS: Final = 3.0 * MAD_SIGMA
_LEAST: Final = 1e-3
"""Share of the size below which no distance counts as stray while the way is found."""


class Candidate(NamedTuple):
    """One place where the cloud may lie."""

    placement: Placement
    rms_mm: float
    """RMS distance to the facets of the points inside, strays left out, mm."""
    inside: float
    """Share of the points that lie on the target."""
    iterations: int
    """Steps taken, of the batches and of the fit."""
    score_mm: float
    """Trimmed RMS of all points over the share inside, mm: the order of the candidates."""
    independent: float
    """Number of independent values that the correlated distances are worth."""
    used: Mask
    """Points that the fit listened to, shape (n,)."""


def search(
    measure: Measure,
    points_mm: Array,
    target_points_mm: Array,
    settings: FitSettings,
    *,
    start: Placement | None = None,
) -> tuple[Candidate, ...]:
    """Find where a cloud may lie on a surface, from nothing.

    Parameters
    ----------
    measure : Measure
        Distance to the facets of a light net, continued past its border.
    points_mm : ndarray, shape (n, 3), mm
        Measured points about their centroid; some thousand are enough.
    target_points_mm : ndarray, shape (m, 3), mm, frame `surface`
        Nodes of the net, spread evenly.
    settings : FitSettings
        Of the fit; its tolerance and observability are widened to what facets can carry.
    start : Placement, optional
        A placement to try as well. Free motions and equal candidates keep near it.

    Returns
    -------
    tuple of Candidate
        Best first, at most four, each in another place. Rotations are proper.

    Notes
    -----
    Tested: 200 of 200 random poses of the demo window; half windows; strips; a tenth of gross outliers.
    """
    coarse = replace(
        settings,
        tolerance=max(STEP_TOLERANCE, settings.tolerance),
        max_iterations=min(settings.max_iterations, _LAST_STEPS),
        min_observability=max(FACET_OBSERVABILITY, settings.min_observability),
    )
    anchor = _anchor(points_mm, target_points_mm, start)
    order = fixed_order(len(points_mm))
    starts, steps = _descend(measure, points_mm[order], target_points_mm, coarse, anchor)
    placements = [Placement(r, p) for r, p in zip(starts.rotations, starts.positions_mm, strict=True)]
    sample = points_mm[order[:_FIT_POINTS]]
    found = [_candidate(measure, points_mm, sample, p, coarse, steps) for p in placements]
    found.sort(key=lambda pair: pair[0].score_mm)
    near = start is not None and anchor is start
    ranked = _ranked(_one_an_orbit(measure, sample, found, anchor, coarse), anchor, near, coarse)
    loose = replace(coarse, min_observability=max(ORBIT_OBSERVABILITY, coarse.min_observability))
    return tuple(
        c._replace(placement=held_near(measure, sample, c.placement, s, loose, anchor)) for c, s in ranked
    )


def _anchor(points_mm: Array, target_points_mm: Array, start: Placement | None) -> Placement:
    """Return the start if it lies near the target; its orientation over the middle of it if not."""
    middle = target_points_mm.mean(axis=0)
    if start is None:
        return Placement(np.eye(3), middle)
    reach = float(np.linalg.norm(target_points_mm - middle, axis=1).max())
    away = float(np.linalg.norm(start.position_mm - middle))
    return start if away <= reach else Placement(start.rotation, middle)


def _descend(
    measure: Measure, shuffled_mm: Array, target_points_mm: Array, settings: FitSettings, anchor: Placement
) -> tuple[Starts, int]:
    """Run all first guesses downhill, on more and more points; return the few that are left."""
    starts = first_guesses(shuffled_mm, target_points_mm)
    starts = Starts(
        np.concatenate([anchor.rotation[None], starts.rotations]),
        np.concatenate([anchor.position_mm[None], starts.positions_mm]),
    )
    steps, anchored = 0, True
    for number, iterations, most, hopeless in _STAGES:
        ended = settle(measure, shuffled_mm[:number], starts, settings, iterations)
        steps += ended.iterations
        worst = hopeless * float(ended.score_mm.min())
        anchored = anchored and float(ended.score_mm[0]) <= worst
        rows = _apart(ended, most, worst, [0] if anchored else [], settings)
        starts = Starts(ended.starts.rotations[rows], ended.starts.positions_mm[rows])
    return starts, steps


def _apart(ended: Settled, most: int, worst: float, rows: list[int], settings: FitSettings) -> list[int]:
    """Return the best placements that lie apart from each other, after those that are kept anyway."""
    rotation, position = ended.starts
    for k in np.argsort(ended.score_mm, kind="stable"):
        if ended.score_mm[k] > worst:
            break
        cosine = 0.5 * (np.einsum("kij,ij->k", rotation[rows], rotation[k]) - 1.0)
        turn = np.arccos(np.clip(cosine, -1.0, 1.0)) * settings.length_mm
        shift = np.linalg.norm(position[rows] - position[k], axis=1)
        if rows and float((turn + shift).min()) <= NEAR * settings.size_mm:
            continue
        rows = [*rows, int(k)]
        if len(rows) == most:
            break
    return rows


def _candidate(
    measure: Measure,
    points_mm: Array,
    sample_mm: Array,
    placement: Placement,
    settings: FitSettings,
    steps: int,
) -> tuple[Candidate, Spectrum]:
    """Fit a sample without strays and, at last, without those past the border; judge all points."""
    used = np.ones(len(sample_mm), dtype=bool)
    now = fit(measure, sample_mm, placement, replace(settings, max_iterations=0), used=used)
    for number in range(_TRIMS):
        kept = _kept(now.evaluation, settings)
        if number and np.array_equal(kept, used):
            break
        used = kept
        again = fit(measure, sample_mm, now.placement, settings, used=used)
        now = again._replace(iterations=now.iterations + again.iterations)
    end = now.placement
    everywhere = np.ones(len(points_mm), dtype=bool)
    there = evaluate(measure, points_mm, end, settings.length_mm, used=everywhere)
    good = _kept(there, settings)
    distance, inside = there.feet.distance_mm, there.inside & good
    rms = float(np.sqrt(np.mean(distance[inside] ** 2))) if inside.any() else np.inf
    candidate = Candidate(
        placement=end,
        rms_mm=rms,
        inside=float(np.mean(there.inside)),
        iterations=steps + now.iterations,
        score_mm=float(scores(distance[None], there.inside[None])[0]),
        independent=independent_number(moved(points_mm[inside], end), distance[inside]),
        used=good,
    )
    weakest = max(ORBIT_OBSERVABILITY, settings.min_observability)
    return candidate, spectrum(now.evaluation.normal_matrix, weakest)


def _kept(evaluation: Evaluation, settings: FitSettings) -> Mask:
    """Return the points that lie inside and near the rest; all near the rest if hardly any lies inside."""
    distance, inside = evaluation.feet.distance_mm, evaluation.inside
    among = inside if float(np.mean(inside)) >= 0.5 else np.ones(len(inside), dtype=bool)
    off = np.abs(distance - np.median(distance[among]))
    kept: Mask = among & (off <= max(_SIGMAS * float(np.median(off[among])), _LEAST * settings.size_mm))
    return kept


def _one_an_orbit(
    measure: Measure,
    sample_mm: Array,
    found: list[tuple[Candidate, Spectrum]],
    anchor: Placement,
    settings: FitSettings,
) -> list[tuple[Candidate, Spectrum]]:
    """Let one candidate stand for each orbit: the best one, or one like it that is nearer to the anchor."""
    distinct: list[tuple[Candidate, Spectrum]] = []
    for candidate, spectral in found:
        for k, (other, free) in enumerate(distinct):
            if same_place(measure, sample_mm, other.placement, candidate.placement, free, settings):
                nearer = _away(candidate.placement, anchor, settings) < _away(
                    other.placement, anchor, settings
                )
                if free.free.any() and nearer and candidate.score_mm <= ALIKE * other.score_mm:
                    distinct[k] = (candidate, spectral)
                break
        else:
            distinct.append((candidate, spectral))
    return distinct


def _ranked(
    distinct: list[tuple[Candidate, Spectrum]], anchor: Placement, near: bool, settings: FitSettings
) -> list[tuple[Candidate, Spectrum]]:
    """Sort by score; of those that the data cannot tell from the best, the nearest to the start leads.

    A start within a radian and an rms radius is evidence: it decides near ties, any other one equals only.
    """
    distinct = sorted(distinct, key=lambda pair: pair[0].score_mm)
    best = distinct[0][0]

    def equal(candidate: Candidate) -> bool:
        factor = equal_factor(int(np.count_nonzero(best.used)))
        if near and _away(candidate.placement, anchor, settings) <= settings.length_mm:
            factor = max(factor, tie_factor(min(best.independent, candidate.independent)))
        return candidate.score_mm <= max(best.score_mm * factor, _ROUNDING * settings.size_mm)

    lead = min(
        (k for k, (c, _) in enumerate(distinct) if equal(c)),
        key=lambda k: _away(distinct[k][0].placement, anchor, settings),
    )
    return [distinct[lead], *distinct[:lead], *distinct[lead + 1 :]]


def _away(placement: Placement, anchor: Placement, settings: FitSettings) -> float:
    """Return how far a placement lies from the anchor, mm."""
    turn = vector_from_rotation(placement.rotation @ anchor.rotation.T)
    shift = placement.position_mm - anchor.position_mm
    return float(np.linalg.norm(turn)) * settings.length_mm + float(np.linalg.norm(shift))
