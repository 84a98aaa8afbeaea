"""One linearised minimax problem: the linear programme over all faces of all points.

Of many faces few matter: a working set is solved with HiGHS, and faces that its solution breaks join it until
none is left, which makes the answer that of all points.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmm_align.errors import NumericsError
from cmm_align.numerics.zone_faces import (
    Faces,
    Look,
    excess,
    face_rows,
    is_hard,
    linear_distance,
    worst_by_cell,
)

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

_ROUNDS: Final = 100
_BROKEN: Final = 1e-11
"""A face outside the working set joins if it is broken by more than this share of the scale."""
_LP_TOLERANCE: Final = 1e-10
"""The smallest that HiGHS takes."""


class Step(NamedTuple):
    """The solution of one linear programme."""

    motion: Array
    """Scaled (rotation times length, translation), shape (6,), mm."""
    merit_mm: float
    """What the linearisation promises."""
    faces: Indices
    """Faces with a multiplier."""
    multipliers: Array
    """Positive; sum 1 over the soft faces."""
    working: Indices
    """The working set at the end: a good one to begin the next with."""
    programmes: int
    """Linear programmes solved."""


def linear_step(
    points_mm: Array,
    faces: Faces,
    at: Look,
    basis: Array,
    length_mm: float,
    *,
    working: Indices,
    radius_mm: float,
    scale_mm: float,
    penalty: float,
) -> Step:
    """Return the motion that is best for the linearised faces of all points.

    Parameters
    ----------
    points_mm : ndarray, shape (n, 3), mm
        About their centroid.
    faces : Faces
    at : Look
        Where to linearise.
    basis : ndarray, shape (6, k)
        Motions that may be used, scaled, orthonormal.
    length_mm : float
        Scale of the rotations, mm.
    working : ndarray of int
        Faces to begin with.
    radius_mm : float
        No component of the motion in `basis` may exceed this.
    scale_mm : float
        Lengths are divided by this, so that the tolerances of the solver mean the same for every part.
    penalty : float
        Price of one mm of broken hard limits in mm of t.

    Returns
    -------
    Step
    """
    solved = 0
    for _ in range(_ROUNDS):
        motion, promised, multipliers = _programme(
            face_rows(points_mm, at, working, length_mm) @ basis,
            (at.g_mm[working] - at.t_mm) / scale_mm,
            is_hard(faces, working),
            at.t_mm / scale_mm,
            radius_mm / scale_mm,
            penalty,
        )
        solved += 1
        step = basis @ motion * scale_mm
        t = at.t_mm + promised[0] * scale_mm
        broken = promised[1] * scale_mm
        g = excess(faces, linear_distance(points_mm, at, step, length_mm))
        limit = np.full(len(g), t)
        if faces.lower_is_hard:
            limit[len(g) // 2 :] = broken
        over = g - limit
        over[working] = -np.inf
        outside = np.flatnonzero(over > _BROKEN * scale_mm)
        if len(outside) == 0:
            break
        working = np.union1d(working, worst_by_cell(faces, over, outside))
    held = multipliers > 0.0
    return Step(step, t + penalty * broken, working[held], multipliers[held], working, solved)


def _programme(
    rows: Array, g: Array, hard: NDArray[np.bool_], origin: float, radius: float, penalty: float
) -> tuple[Array, tuple[float, float], Array]:
    """Minimise ``t + penalty v`` with ``rows u + g <= t`` (soft) and ``<= v`` (hard), ``v >= 0``.

    Returns u, (t, v) and the multipliers of the rows; t and g are counted from `origin`, the t before.
    """
    from scipy.optimize import linprog

    k = rows.shape[1]
    soft = (~hard).astype(float)
    right = np.where(hard, -origin - g, -g)  # a hard face is broken by its excess over 0
    matrix = np.column_stack([rows, -soft, soft - 1.0])
    found = linprog(
        np.concatenate([np.zeros(k), [1.0, penalty]]),
        A_ub=matrix,
        b_ub=right,
        bounds=[(-radius, radius)] * k + [(None, None), (0.0, None)],
        method="highs",
        options={
            "primal_feasibility_tolerance": _LP_TOLERANCE,
            "dual_feasibility_tolerance": _LP_TOLERANCE,
        },
    )
    if found.x is None or found.status != 0:
        raise NumericsError(f"the linear programme of the zone failed: {found.message}")
    multipliers = np.maximum(-np.asarray(found.ineqlin.marginals, dtype=float), 0.0)
    return np.asarray(found.x[:k], dtype=float), (float(found.x[k]), float(found.x[k + 1])), multipliers
