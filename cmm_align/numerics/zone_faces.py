"""Limits on the deviations of points, seen as faces that a motion must stay below.

Every limit of a point is a *face*: ``g = e - upper`` and ``g = lower - e`` (mm), which a small motion x
changes by ``+-J x``. Wanted is the motion with the smallest t such that ``g <= t`` on all soft faces and
``g <= 0`` on all hard ones.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmm_align.numerics.chunked import in_threads
from cmm_align.numerics.foot_point import Feet
from cmm_align.numerics.linearisation import Evaluation, Placement, moved, rows_of

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

CELLS: Final = 12
"""The surface is cut into this many cells along x and along y."""


class Faces(NamedTuple):
    """The limits of n points: face i is the upper one of point i, face n + i its lower one."""

    upper_mm: Array
    """Shape (n,), mm; infinite where there is none."""
    lower_mm: Array
    """Shape (n,), mm; minus infinite where there is none."""
    lower_is_hard: bool
    """Lower limits must hold as they are; otherwise both kinds give way by the same t."""
    used: NDArray[np.bool_]
    """Which points count, shape (n,)."""
    cell: Indices
    """Where on the surface each point lies, shape (n,)."""


class Look(NamedTuple):
    """All faces under one placement."""

    placement: Placement
    evaluation: Evaluation
    g_mm: Array
    """Excess over the limits, shape (2 n,), mm; minus infinite where there is no face."""
    t_mm: float
    """Largest excess over a soft limit, mm."""
    broken_mm: float
    """Largest excess over a hard limit, not below 0, mm."""

    def merit(self, penalty: float) -> float:
        """Return what is minimised, mm: ``t`` plus the penalty for broken hard limits."""
        return self.t_mm + penalty * self.broken_mm


def cells_of(feet: Feet, used: NDArray[np.bool_]) -> Indices:
    """Return the number of the cell of the surface that each foot lies in, shape (n,)."""
    cell = np.zeros(len(used), dtype=np.intp)
    for along in (feet.x_mm, feet.y_mm):
        low, high = float(along[used].min()), float(along[used].max())
        pitch = max(high - low, np.finfo(float).tiny) / CELLS
        place = np.where(used, (along - low) / pitch, 0.0)
        cell = cell * CELLS + np.clip(place, 0, CELLS - 1).astype(np.intp)
    return cell


def excess(faces: Faces, distance_mm: Array) -> Array:
    """Return the excess of all faces, shape (2 n,), mm.

    Parameters
    ----------
    faces : Faces
    distance_mm : ndarray, shape (n,), mm
        Of a point that counts never NaN.
    """
    n = len(distance_mm)
    g = np.full(2 * n, -np.inf)
    np.subtract(distance_mm, faces.upper_mm, out=g[:n], where=faces.used)
    np.subtract(faces.lower_mm, distance_mm, out=g[n:], where=faces.used)
    return g


def look(faces: Faces, placement: Placement, evaluation: Evaluation) -> Look:
    """Return the faces under a placement; t is infinite where a point that counts has no distance.

    Parameters
    ----------
    faces : Faces
    placement : Placement
    evaluation : Evaluation
        At `placement`.
    """
    distance = evaluation.feet.distance_mm
    g = excess(faces, distance)
    if not np.isfinite(distance[faces.used]).all():
        return Look(placement, evaluation, g, np.inf, 0.0)
    return Look(placement, evaluation, g, *_largest(faces, g))


def _largest(faces: Faces, g: Array) -> tuple[float, float]:
    """Return the largest excess over the soft faces, and over the hard ones but not below 0."""
    n = len(g) // 2
    if not faces.lower_is_hard:
        return float(g.max()), 0.0
    return float(g[:n].max()), max(float(g[n:].max()), 0.0)


def worst_by_cell(faces: Faces, g: Array, among: Indices) -> Indices:
    """Return of the faces `among` the worst of every cell and kind.

    Parameters
    ----------
    faces : Faces
    g : ndarray, shape (2 n,), mm
        Excess of all faces.
    among : ndarray of int, shape (m,)
    """
    n = len(faces.cell)
    order = among[np.argsort(-g[among], kind="stable")]
    kind = faces.cell[order % n] * 2 + order // n
    _, first = np.unique(kind, return_index=True)
    result: Indices = order[first]
    return result


def is_hard(faces: Faces, picked: Indices) -> NDArray[np.bool_]:
    """Return which of the faces are hard, shape (m,)."""
    result: NDArray[np.bool_] = (picked >= len(faces.cell)) & faces.lower_is_hard
    return result


def face_rows(points_mm: Array, at: Look, picked: Indices, length_mm: float) -> Array:
    """Return how the faces change with a small motion, shape (m, 6), dimensionless.

    Parameters
    ----------
    points_mm : ndarray, shape (n, 3), mm
        About their centroid.
    at : Look
    picked : ndarray of int, shape (m,)
        Faces.
    length_mm : float
        Scale of the rotations, mm.
    """
    n = len(points_mm)
    index = picked % n
    feet = at.evaluation.feet.of(index)
    rows = rows_of(moved(points_mm[index], at.placement), at.placement, feet, length_mm)[:6].T
    result: Array = rows * np.where(picked < n, 1.0, -1.0)[:, None]
    return result


def linear_distance(points_mm: Array, at: Look, motion: Array, length_mm: float) -> Array:
    """Return ``d + J x`` of all points, shape (n,), mm.

    Parameters
    ----------
    points_mm, at, length_mm
        As for `face_rows`.
    motion : ndarray, shape (6,), mm
        Scaled.
    """
    result = np.empty(len(points_mm))
    x, y, z = motion[:3] / length_mm
    # (w x R q) + t, as one matrix for the points as they were measured
    turn = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]) @ at.placement.rotation
    feet = at.evaluation.feet

    def work(part: slice) -> None:
        shift = points_mm[part] @ turn.T + motion[3:]
        result[part] = feet.distance_mm[part] + np.einsum("ij,ij->i", feet.normal[part], shift)

    in_threads(work, len(points_mm))
    return result
