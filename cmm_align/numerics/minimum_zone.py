"""The narrowest zone, the least stock, the position inside a tolerance band: minimax fits with their proof.

All three are one problem: limits on the deviation of every point, and the motion with the smallest largest
excess t over them.

- *Minimum zone* (Chebyshev): both limits 0, so t = max|e|. The profile value of ISO 1101 is ``2 t``.
- *Least stock*: e >= 0 everywhere, without exception, and the largest e as small as possible.
- *Tolerance band*: lo_i <= e_i <= hi_i. The margin is -t: it passes if that is not negative.

Solved by successive linear programmes within a trust region, feet measured again after every step, with
Newton's step on the active points where that is better (Anthony et al., "Reference software for finding
Chebyshev best-fit geometric elements", Precision Engineering 19, 28, 1996; `zone_search`, `zone_newton`).

Accuracy. Feet are exact at the end, so t is what the points say at that placement, in rounding. That no other
one is better, the multipliers l_i prove: for any motion x (scaled as in `linearisation`)

    t(x) >= sum l_i g_i + (sum l_i s_i J_i) . x + x^T W x / 2,   W = sum l_i d2 g_i / dx2,

up to third order. So ``t - sum l_i g_i`` (the gap) bounds what linear motions could gain, the certificate
residual times |x| what inexact multipliers hide, and a negative eigenvalue -c of W (curvature over
the part: about 1 / radius) at most ``c |x|^2 / 2``, which matters only for motions as large as sqrt(2 t / c).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cmm_align.errors import InputError
from cmm_align.numerics.fit_steps import FitSettings
from cmm_align.numerics.foot_point import Feet
from cmm_align.numerics.linearisation import Evaluation, Measure, Placement
from cmm_align.numerics.zone_faces import is_hard
from cmm_align.numerics.zone_newton import weighted_curvature
from cmm_align.numerics.zone_search import Found, Search

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]

_CONVERGED: Final = 1e-6
"""Certificate residual of an optimum; exact ones are some 1e-15."""


@dataclass(frozen=True, slots=True)
class ZoneResult:
    """The best placement under limits, and the proof that there is none better nearby."""

    placement: Placement
    evaluation: Evaluation
    """At `placement`, feet exact."""
    t_mm: float
    """Largest excess over the (soft) limits, mm: half the width of the minimum zone; the least stock."""
    broken_mm: float
    """Largest excess over limits that must hold, mm: rounding, or the fit has not converged."""
    active: Indices
    """The points that hold the zone, shape (m,): indices into the points given, each with a multiplier."""
    sides: NDArray[np.intp]
    """Shape (m,): +1 where the upper limit holds, -1 where the lower one does (``s_i``)."""
    multipliers: Array
    """``l_i > 0``, sum 1, shape (m,): the share of each active point in the proof."""
    certificate_residual: float
    """``||sum l_i s_i J_i||``, scaled, over the motions that were free to move: 0 at an optimum."""
    gap_mm: float
    """``t - sum l_i g_i``, mm: what a linear motion could gain at most, when the residual is 0."""
    curvature_per_mm: float
    """Smallest eigenvalue of ``W = sum l_i d2 g_i / dx2``, 1/mm, scaled motions; 0 for facets."""
    t_start_mm: float
    """t at the start, mm."""
    broken_start_mm: float
    """`broken_mm` at the start."""
    iterations: int
    """Steps taken."""
    programmes: int
    """Linear programmes solved."""
    stop_reason: str
    converged: bool

    @property
    def margin_mm(self) -> float:
        """What is left to the tightest limit at the best placement, mm; negative if it does not fit."""
        return -self.t_mm

    @property
    def passes(self) -> bool:
        """Whether a placement was found in which every point keeps its limits."""
        return self.t_mm <= 0.0 and self.broken_mm <= 0.0

    @property
    def proof_reach_mm(self) -> float:
        """How far the proof of ``t > 0`` reaches, mm of scaled motion.

        For every motion |x| below this, the active points alone break their limits: the smallest root of
        ``(t - gap) - residual x - max(0, -curvature) x^2 / 2``. 0 if it proves nothing.
        """
        height = self.t_mm - self.gap_mm
        if height <= 0.0:
            return 0.0
        slope, bend = self.certificate_residual, max(0.0, -self.curvature_per_mm) / 2.0
        divisor = slope + float(np.sqrt(slope**2 + 4.0 * bend * height))
        return 2.0 * height / divisor if divisor > 0.0 else np.inf


def minimum_zone(
    measure: Measure,
    points_mm: Array,
    start: Placement,
    settings: FitSettings,
    *,
    used: Mask | None = None,
    previous: Feet | None = None,
    motions: Array | None = None,
) -> ZoneResult:
    """Find the placement with the smallest max|e|.

    Parameters
    ----------
    measure : Measure
    points_mm : ndarray, shape (n, 3), mm
        Measured points about their centroid.
    start : Placement
        The least-squares fit.
    settings : FitSettings
        As for `rigid_fit.fit`; motions below `min_observability` stay as they are.
    used : ndarray of bool, shape (n,), optional
        Points that count throughout; without it, those that lie on the surface at the start.
    previous : Feet, optional
        Feet near the start, to begin from.
    motions : ndarray, shape (6, k), optional
        Motions that may be used, one a column, scaled; without it, all six. The others stay as they are up to
        the square of the turn, and no other optimum is looked for beside the first.

    Returns
    -------
    ZoneResult
        Never a larger max|e| than the start's.

    Raises
    ------
    NumericsError
        If no point counts or one that counts has no foot at the start.

    Notes
    -----
    Tested on data made from multipliers: t to 1e-9 relative, pose to 1e-10 mm, residual below 1e-12.
    """
    zero = np.zeros(len(points_mm))
    search = Search(measure, points_mm, settings, motions, zero, zero, False)
    return _result(search, search.run(start, used, previous))


def least_stock(
    measure: Measure,
    points_mm: Array,
    start: Placement,
    settings: FitSettings,
    *,
    allowance_mm: float = 0.0,
    used: Mask | None = None,
    previous: Feet | None = None,
    motions: Array | None = None,
) -> ZoneResult:
    """Find the placement with material everywhere and the smallest largest deviation.

    "Go down t to clean up everywhere": every ``e_i >= allowance`` and ``t = max e_i``. The largest and
    not the mean deviation is minimised, because it is what the machine is told to go down, and it does not
    depend on how densely the points were taken.

    Parameters
    ----------
    measure, points_mm, start, settings, used, previous, motions
        As for `minimum_zone`: points of shape (n, 3), mm, motions of shape (6, k), scaled.
    allowance_mm : float
        Least material that has to be left everywhere, mm.

    Returns
    -------
    ZoneResult
        ``broken_mm`` is rounding: some 1e-15 of the size.

    Raises
    ------
    NumericsError
        As `minimum_zone`; also if no placement has material everywhere.
    """
    n = len(points_mm)
    search = Search(measure, points_mm, settings, motions, np.zeros(n), np.full(n, float(allowance_mm)), True)
    return _result(search, search.run(start, used, previous))


def within_tolerance(
    measure: Measure,
    points_mm: Array,
    start: Placement,
    settings: FitSettings,
    *,
    lower_mm: Array,
    upper_mm: Array,
    used: Mask | None = None,
    previous: Feet | None = None,
    motions: Array | None = None,
) -> ZoneResult:
    """Find the placement with the largest margin to the limits of every point.

    Is there any position in which it passes? If ``passes``, the one returned, with `margin_mm` to spare. If
    not, the active points prove it: weighted with their multipliers, no motion within `proof_reach_mm`
    brings them all inside.

    Parameters
    ----------
    measure, points_mm, start, settings, used, previous, motions
        As for `minimum_zone`.
    lower_mm, upper_mm : ndarray, shape (n,), mm
        ``lower_i <= e_i <= upper_i``; infinite where a point has no limit.

    Returns
    -------
    ZoneResult

    Raises
    ------
    InputError
        If limits are NaN, crossed, of the wrong shape, or if no point has one.
    NumericsError
        As `minimum_zone`.
    """
    n = len(points_mm)
    lower, upper = (np.asarray(a, dtype=np.float64) for a in (lower_mm, upper_mm))
    if lower.shape != (n,) or upper.shape != (n,):
        raise InputError(f"tolerance limits of shape {lower.shape} and {upper.shape}", expected=f"({n},)")
    wrong = np.flatnonzero(~(lower <= upper) | (lower == np.inf) | (upper == -np.inf))
    if len(wrong):
        i = int(wrong[0])
        raise InputError(
            f"tolerance limits {lower[i]:g} and {upper[i]:g} mm of point {i}", expected="lower <= upper"
        )
    search = Search(measure, points_mm, settings, motions, upper, lower, False)
    return _result(search, search.run(start, used, previous))


def _result(search: Search, found: Found) -> ZoneResult:
    """Put a result together."""
    at, proved = found.at, found.proved
    n = len(search.points_mm)
    held = proved.faces
    bend = weighted_curvature(
        search.measure, search.points_mm, at, held, proved.multipliers, search.settings.length_mm
    )
    curvature = float(np.linalg.eigvalsh(found.basis.T @ bend @ found.basis).min(initial=np.inf))
    limit = np.where(is_hard(found.faces, held), 0.0, at.t_mm)
    gap = float(proved.multipliers @ (limit - at.g_mm[held]))
    active, sides, multipliers = held % n, np.where(held < n, 1, -1).astype(np.intp), proved.multipliers
    for array in (active, sides, multipliers):
        array.setflags(write=False)
    return ZoneResult(
        placement=at.placement,
        evaluation=at.evaluation,
        t_mm=at.t_mm,
        broken_mm=at.broken_mm,
        active=active,
        sides=sides,
        multipliers=multipliers,
        certificate_residual=proved.residual,
        gap_mm=gap,
        curvature_per_mm=curvature,
        t_start_mm=found.first.t_mm,
        broken_start_mm=found.first.broken_mm,
        iterations=found.iterations,
        programmes=found.programmes,
        stop_reason=found.stop_reason,
        converged=found.nothing_gained or proved.residual <= _CONVERGED,
    )
