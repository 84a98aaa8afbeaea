"""The way to the best placement under limits: linear programmes within a trust region, and Newton's steps.

Every step is judged by distances measured anew, so that the best placement seen is never worse than the
start. What is lowered is ``t + penalty v``, v being the largest excess over limits that must hold: with a
penalty above the multipliers of those limits its minimum keeps them (exact penalty, Fletcher 1987, ch. 14).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmm_align.errors import InputError, NumericsError
from cmm_align.numerics.fit_steps import FitSettings, stepped
from cmm_align.numerics.foot_point import Feet
from cmm_align.numerics.linearisation import Evaluation, Measure, Placement, evaluate
from cmm_align.numerics.observability import spectrum
from cmm_align.numerics.zone_faces import Faces, Look, cells_of, look, worst_by_cell
from cmm_align.numerics.zone_newton import Proof, levelled, newton_step, proof
from cmm_align.numerics.zone_programme import Step, linear_step

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]

ROUNDING: Final = 16.0 * float(np.finfo(np.float64).eps)
"""What t cannot resolve, as a share of the size."""
_PROMISE: Final = 1e-9
"""A promised gain below this share of the scale is the tolerance of the solver: Newton does the rest."""
_KEPT: Final = 0.1
"""A step is taken if it keeps this share of its promise."""
_WIDEN: Final = 0.75
_BEYOND: Final = 4.0
"""Newton's step may be this many times as long as the programme's."""
_LEVELLINGS: Final = 2
_TOUCHING: Final = 1e-8
"""Faces within this share of the scale of their limit touch it."""
_FINISHING: Final = 4
_LONGEST_FINISH: Final = 1e-3
_AROUND: Final = 2
"""How many of the weakest motions are looked along for another optimum."""
_FAR: Final = (1.0, -1.0, 3.0, -3.0)
"""How far, in motions over which curvature matters."""
_LOWER: Final = 1e-7
"""Another optimum is lower if it is so by this share of the scale."""
_PENALTY: Final = 10.0
"""Mm of t for one mm of broken hard limits; raised where it does not suffice."""
_MOST_PENALTY: Final = 1e6


class Found(NamedTuple):
    """How a search ended."""

    faces: Faces
    first: Look
    at: Look
    basis: Array
    """Motions that were free to move at the end, scaled, shape (6, k)."""
    proved: Proof
    scale_mm: float
    iterations: int
    programmes: int
    stop_reason: str
    nothing_gained: bool
    """The last programme promised no more than rounding."""
    penalty: float
    working: Indices
    """Faces that mattered."""


@dataclass(frozen=True, slots=True)
class Search:
    """What stays the same while a zone is fitted."""

    measure: Measure
    points_mm: Array
    """Measured points about their centroid, shape (n, 3), mm."""
    settings: FitSettings
    motions: Array | None
    """Motions that may be used, scaled, shape (6, k); None for all."""
    upper_mm: Array
    """Shape (n,), mm; infinite where there is none."""
    lower_mm: Array
    lower_is_hard: bool

    def run(self, start: Placement, used: Mask | None, previous: Feet | None) -> Found:
        """Search from a start, and look around for a lower optimum beside the one found.

        Parameters
        ----------
        start : Placement
        used : ndarray of bool, shape (n,), optional
        previous : Feet, optional

        Notes
        -----
        Curvature can make more than one optimum. Around the first, the few faces that matter are searched
        again from both sides along the weakest motions, as far as curvature needs to matter; where they
        promise less, all points are asked.
        """
        best = self._descended(start, used, previous)
        if not best.nothing_gained or self.motions is not None:  # turns to and fro would creep past a lock
            return best
        reach = float(np.sqrt(best.scale_mm * self.settings.size_mm))
        weakest = best.basis[:, :_AROUND].T
        for motion in np.concatenate([f * reach * weakest for f in _FAR]):
            try:
                there = self._on_few(best, motion)
                if there is None:
                    continue
                other = self._descended(there, best.faces.used, best.at.evaluation.feet)
            except NumericsError:  # off the nominal
                continue
            penalty = max(best.penalty, other.penalty)
            lower = best.at.merit(penalty) - other.at.merit(penalty) > _LOWER * best.scale_mm
            winner = other if lower else best
            best = winner._replace(
                first=best.first,
                iterations=best.iterations + other.iterations,
                programmes=best.programmes + other.programmes,
            )
        return best

    def _on_few(self, best: Found, motion: Array) -> Placement | None:
        """Search the faces that matter from beside an optimum; None if that promises nothing lower."""
        n = len(self.points_mm)
        limited = np.flatnonzero(np.isfinite(best.at.g_mm))
        few = np.unique(np.concatenate([best.working, worst_by_cell(best.faces, best.at.g_mm, limited)]) % n)
        some = replace(
            self,
            points_mm=self.points_mm[few],
            upper_mm=self.upper_mm[few],
            lower_mm=self.lower_mm[few],
            motions=best.basis,
        )
        start = stepped(best.at.placement, motion, self.settings.length_mm)
        feet = best.at.evaluation.feet.of(few)
        found = some._descended(start, np.ones(len(few), dtype=bool), feet)
        lower = best.at.merit(best.penalty) - found.at.merit(best.penalty) > _LOWER * best.scale_mm
        return found.at.placement if lower else None

    def _descended(self, start: Placement, used: Mask | None, previous: Feet | None) -> Found:
        """Go down from a start to the nearest optimum."""
        faces, first = self._begin(start, used, previous)
        size = self.settings.size_mm
        distance = first.evaluation.feet.distance_mm[faces.used]
        scale = max(float(np.abs(distance).max()), abs(first.t_mm), ROUNDING * size)
        radius = float(np.sqrt(scale * size))  # the sagitta of a part as round as large is the scale
        working = worst_by_cell(faces, first.g_mm, np.flatnonzero(np.isfinite(first.g_mm)))
        penalty, at, iterations, programmes = _PENALTY, first, 0, 0
        reason, nothing = "max iterations", False
        while True:
            basis = self._basis(at.evaluation)
            step = linear_step(
                self.points_mm,
                faces,
                at,
                basis,
                self.settings.length_mm,
                working=working,
                radius_mm=radius,
                scale_mm=scale,
                penalty=penalty,
            )
            programmes += step.programmes
            working = step.working
            if self._too_cheap(faces, step, penalty):
                penalty *= 10.0
                continue
            promise = at.merit(penalty) - step.merit_mm
            if promise <= max(_PROMISE * scale, ROUNDING * size):
                reason, nothing = "no motion lowers it", True
                break
            if iterations >= self.settings.max_iterations:
                break
            there, length, share = self._best(faces, at, basis, step, promise, penalty)
            if there is None:
                radius = 0.25 * min(length, radius)
                if radius <= ROUNDING * size:
                    reason = "no further decrease"
                    break
                continue
            at = there
            iterations += 1
            if share > _WIDEN:
                radius = max(radius, 2.0 * length)
        proved = self._proof(faces, at, basis, step.faces, scale)
        if nothing:
            at, proved = self._finished(faces, at, basis, proved, penalty, scale)
        if first.merit(penalty) < at.merit(penalty):  # the start was the optimum, in rounding
            at = first
            proved = self._proof(faces, at, basis, step.faces, scale)
        return Found(
            faces, first, at, basis, proved, scale, iterations, programmes, reason, nothing, penalty, working
        )

    def _begin(self, start: Placement, used: Mask | None, previous: Feet | None) -> tuple[Faces, Look]:
        """Look at the start, twice: the first look is rough."""
        rough = self._evaluated(start, previous, used)
        now = self._evaluated(start, rough.feet, rough.used)
        counts = now.used
        if not counts.any():
            raise NumericsError("no zone: no point counts", remedy="check the start and the selection")
        if used is not None and np.count_nonzero(used) != np.count_nonzero(counts):
            raise NumericsError("no zone: points that count have no foot on the nominal")
        limited = counts & (np.isfinite(self.upper_mm) | np.isfinite(self.lower_mm))
        if not limited.any():
            raise InputError("no point has a tolerance limit", expected="at least one finite limit")
        cell = cells_of(now.feet, counts)
        faces = Faces(self.upper_mm, self.lower_mm, self.lower_is_hard, counts, cell)
        return faces, look(faces, start, now)

    def _evaluated(self, placement: Placement, previous: Feet | None, used: Mask | None) -> Evaluation:
        """Measure all points."""
        return evaluate(
            self.measure, self.points_mm, placement, self.settings.length_mm, previous=previous, used=used
        )

    def _basis(self, now: Evaluation) -> Array:
        """Return the motions that may be used and that the points can tell, shape (6, k)."""
        allowed = None if self.motions is None else np.linalg.qr(self.motions)[0]
        spectral = spectrum(now.normal_matrix, self.settings.min_observability, allowed)
        result: Array = spectral.motions[:, ~spectral.free]
        return result

    def _too_cheap(self, faces: Faces, step: Step, penalty: float) -> bool:
        """Return whether hard limits may stay broken only because that costs too little."""
        if not faces.lower_is_hard:
            return False
        paid = float(step.multipliers[step.faces >= len(faces.cell)].sum())
        if paid < 0.5 * penalty:
            return False
        if penalty >= _MOST_PENALTY:
            raise NumericsError("no position has material everywhere", remedy="check the side and the radius")
        return True

    def _seen(self, faces: Faces, at: Look, motion: Array) -> Look:
        """Return the faces after a motion."""
        placement = stepped(at.placement, motion, self.settings.length_mm)
        return look(faces, placement, self._evaluated(placement, at.evaluation.feet, faces.used))

    def _best(
        self, faces: Faces, at: Look, basis: Array, step: Step, promise: float, penalty: float
    ) -> tuple[Look | None, float, float]:
        """Try Newton's step, the programme's, and both levelled.

        Returns the first that keeps enough of its promise (or None), the length of the programme's step, mm,
        and the share of the promise kept.
        """
        scale = self.settings.length_mm
        length = float(np.abs(basis.T @ step.motion).max())
        active = (step.faces, step.multipliers)
        newton = newton_step(self.measure, self.points_mm, faces, at, basis, scale, active)
        tries = [newton, step.motion]
        if float(np.abs(newton - step.motion).max()) <= 1e-6 * length:
            tries = [newton]
        for motion in tries:
            reach = float(np.abs(basis.T @ motion).max())
            held = motion * min(1.0, _BEYOND * length / reach) if reach > 0.0 else motion
            if float(np.linalg.norm(held[:3])) > self.settings.max_rotation_rad * scale:
                continue
            there = self._seen(faces, at, held)
            for _ in range(_LEVELLINGS + 1):
                share = (at.merit(penalty) - there.merit(penalty)) / promise
                if share > _KEPT:
                    return there, length, share
                if not np.isfinite(there.t_mm):
                    break
                back = levelled(self.points_mm, faces, there, basis, scale, step.faces)
                if float(np.abs(back).max()) > 0.5 * length:
                    break
                there = self._seen(faces, there, back)
        return None, length, 0.0

    def _proof(self, faces: Faces, at: Look, basis: Array, hint: Indices, scale: float) -> Proof:
        """Find the multipliers at a placement anew."""
        slack = max(_TOUCHING * scale, ROUNDING * self.settings.size_mm)
        length = self.settings.length_mm
        return proof(self.points_mm, faces, at, basis, length, hint=hint, slack_mm=slack)

    def _finished(
        self, faces: Faces, at: Look, basis: Array, proved: Proof, penalty: float, scale: float
    ) -> tuple[Look, Proof]:
        """Sharpen a found optimum by Newton's steps on the faces of its proof.

        A step is kept if it lowers what is minimised, or leaves it in rounding and sharpens the proof.
        """
        floor = ROUNDING * self.settings.size_mm
        for _ in range(_FINISHING):
            active = (proved.faces, proved.multipliers)
            motion = newton_step(
                self.measure, self.points_mm, faces, at, basis, self.settings.length_mm, active
            )
            length = float(np.linalg.norm(motion))
            if not floor < length < _LONGEST_FINISH * self.settings.size_mm:
                break
            there = self._seen(faces, at, motion)
            gain = at.merit(penalty) - there.merit(penalty)
            again = self._proof(faces, there, basis, proved.faces, scale)
            if not (gain > 0.0 or (gain > -floor and again.residual < proved.residual)):
                break
            at, proved = there, again
        return at, proved
