"""Newton's step on the faces that hold a zone, and the proof that they do.

The linear programme says which faces are active; here they are equations, with the curvature of the
distances in them. The proof asks the faces anew, without the programme.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmm_align.numerics.linearisation import Measure, curvature_term
from cmm_align.numerics.zone_faces import Faces, Look, face_rows, is_hard, worst_by_cell

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

_MOST_TOUCHING: Final = 600


class Proof(NamedTuple):
    """Why no small motion does better."""

    faces: Indices
    """Shape (m,)."""
    multipliers: Array
    """Positive, sum 1, shape (m,)."""
    residual: float
    """``||sum l_i s_i J_i||`` over the motions that are free to move, dimensionless: 0 at an optimum."""


def weighted_curvature(
    measure: Measure,
    points_mm: Array,
    at: Look,
    picked: Indices,
    multipliers: Array,
    length_mm: float,
) -> Array:
    """Return ``W = sum l_i d2 g_i / dx2``, shape (6, 6), scaled, 1/mm; zero for facets.

    Parameters
    ----------
    measure : Measure
    points_mm, at, picked, length_mm
        As for `zone_faces.face_rows`.
    multipliers : ndarray, shape (m,)
        ``l_i``, of the faces picked.
    """
    if measure.hessian is None or len(picked) == 0:
        return np.zeros((6, 6))
    n = len(points_mm)
    index = picked % n
    # `curvature_term` is the mean of distance times second derivative: here the weights stand for distances.
    weight = multipliers * np.where(picked < n, 1.0, -1.0) * len(picked)
    feet = at.evaluation.feet.of(index)._replace(distance_mm=weight)
    everyone = np.ones(len(picked), dtype=bool)
    few = at.evaluation._replace(feet=feet, inside=everyone, used=everyone)
    return curvature_term(measure.hessian, points_mm[index], at.placement, few, length_mm)


def newton_step(
    measure: Measure,
    points_mm: Array,
    faces: Faces,
    at: Look,
    basis: Array,
    length_mm: float,
    active: tuple[Indices, Array],
) -> Array:
    """Return Newton's step for the active faces taken as equations, shape (6,), scaled, mm.

    Parameters
    ----------
    measure : Measure
    points_mm, faces, at, basis, length_mm
        As for `zone_programme.linear_step`.
    active : tuple of ndarray, shapes (m,)
        Faces with multipliers, and these in any unit.

    Notes
    -----
    Solves ``W x + G^T l = 0, sum l = 1 (soft), G x + g = t (soft) or 0 (hard)`` (the equality phase of Byrd,
    Gould, Nocedal and Waltz, Math. Program. 100, 27, 2004, doi 10.1007/s10107-003-0485-4). With as many
    active faces as unknowns it is the corner of the programme, without the tolerance of its solver; with
    fewer, the curvature W places the optimum, where linear steps would only creep.
    """
    picked, multipliers = active
    k, m = basis.shape[1], len(picked)
    rows = face_rows(points_mm, at, picked, length_mm) @ basis
    soft = (~is_hard(faces, picked)).astype(float)
    share = multipliers / max(float(multipliers @ soft), np.finfo(float).tiny)
    bend = weighted_curvature(measure, points_mm, at, picked, share, length_mm)
    system = np.zeros((k + 1 + m, k + 1 + m))
    system[:k, :k] = basis.T @ bend @ basis
    system[:k, k + 1 :] = rows.T
    system[k, k + 1 :] = soft
    system[k + 1 :, :k] = rows
    system[k + 1 :, k] = -soft
    right = np.concatenate([np.zeros(k), [1.0], -at.g_mm[picked]])
    result: Array = basis @ np.linalg.lstsq(system, right, rcond=None)[0][:k]
    return result


def levelled(
    points_mm: Array, faces: Faces, at: Look, basis: Array, length_mm: float, picked: Indices
) -> Array:
    """Return the shortest motion that makes the faces picked level again, shape (6,), scaled, mm.

    The second-order correction: after a long step, faces that should be equal differ by their curvature.

    Parameters
    ----------
    points_mm, faces, at, basis, length_mm
        As for `zone_programme.linear_step`.
    picked : ndarray of int, shape (m,)
    """
    rows = face_rows(points_mm, at, picked, length_mm) @ basis
    soft = (~is_hard(faces, picked)).astype(float)
    # t is left free by taking its share out of the equations.
    off = np.eye(len(soft)) - np.outer(soft, soft) / max(float(soft.sum()), 1.0)
    motion = np.linalg.lstsq(off @ rows, -off @ at.g_mm[picked], rcond=1e-9)[0]
    result: Array = basis @ motion
    return result


def proof(
    points_mm: Array,
    faces: Faces,
    at: Look,
    basis: Array,
    length_mm: float,
    *,
    hint: Indices,
    slack_mm: float,
) -> Proof:
    """Find multipliers anew from the faces that touch, without asking the linear programme.

    Parameters
    ----------
    points_mm, faces, at, basis, length_mm
        As for `zone_programme.linear_step`.
    hint : ndarray of int, shape (k,)
        Faces to ask, if they touch, even where too many do to ask all.
    slack_mm : float
        A face touches if it is within this of its limit, mm.

    Returns
    -------
    Proof

    Notes
    -----
    Non-negative least squares of ``sum l_i s_i J_i = 0, sum l_i = 1`` (Lawson and Hanson 1974, ch. 23,
    doi 10.1137/1.9781611971217).
    """
    from scipy.optimize import nnls

    n = len(faces.cell)
    touching = at.g_mm >= at.t_mm - slack_mm
    if faces.lower_is_hard:
        touching[n:] = at.g_mm[n:] >= -slack_mm
    asked = np.flatnonzero(touching)
    if len(asked) > _MOST_TOUCHING:
        asked = np.union1d(worst_by_cell(faces, at.g_mm, asked), hint[touching[hint]])
    rows = face_rows(points_mm, at, asked, length_mm) @ basis
    soft = (~is_hard(faces, asked)).astype(float)
    found, _ = nnls(np.vstack([rows.T, soft]), np.concatenate([np.zeros(basis.shape[1]), [1.0]]))
    held = found > 0.0
    multipliers = found[held] / found.sum()
    residual = float(np.linalg.norm(multipliers @ rows[held]))
    return Proof(asked[held], multipliers, residual)
