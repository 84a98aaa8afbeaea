"""A smooth field continued into its holes and past its border: a thin plate under tension.

Unknown nodes take the values that minimise

    sum (f_xx^2 + 2 f_xy^2 + f_yy^2) + (f_x^2 + f_y^2) / L^2

over the grid with the known nodes held, f_xx and the like being differences of neighbouring nodes; nothing is
asked at the border of the grid (free edges). The plate meets the known nodes with their slope (C1), so a
continued surface has no kink; the tension bends it flat within about L, so that no slope is carried on far:
unlike a polynomial it stays near the range of what is known. Large sets of unknown nodes start from the same
on a grid twice as coarse, and are finished by conjugate gradients.

Source: W. H. F. Smith, P. Wessel, "Gridding with continuous curvature splines in tension", Geophysics 55,
1990, doi 10.1190/1.1442837.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from cmm_align.errors import GeometryError
from cmm_align.numerics.grid_field import coarsened, refined

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MOST_DIRECT: Final = 6000
"""Unknown nodes that are solved for at once; more start from a coarser grid."""
_MOST_STEPS: Final = 60
_SETTLED: Final = 1e-5
"""Conjugate gradients stop at this share of the first residual."""


def extended(field: Array, tension_steps: float) -> Array:
    """Return a field with every unknown node continued smoothly from the known ones.

    Parameters
    ----------
    field : ndarray, shape (ny, nx)
        Any unit; NaN where unknown. Steps of x and y are taken as equal.
    tension_steps : float
        Length L over which the slope dies out, in grid steps.

    Returns
    -------
    ndarray, shape (ny, nx)
        Known nodes unchanged.

    Raises
    ------
    GeometryError
        If no node is known.
    """
    unknown = np.isnan(field)
    if unknown.all():
        raise GeometryError(
            "a map without a single value cannot be continued", remedy="check mask and region"
        )
    if not unknown.any():
        return field.copy()
    count = int(np.count_nonzero(unknown))
    start = None
    if count > MOST_DIRECT and min(field.shape) > 4:
        coarse = extended(coarsened(field), 0.5 * tension_steps)
        start = refined(coarse, field.shape)
    return _plate(field, unknown, tension_steps, start)


def _plate(field: Array, unknown: Mask, tension_steps: float, start: Array | None) -> Array:
    """Return the field with the unknown nodes at the least energy."""
    from scipy.sparse import csr_array, diags_array
    from scipy.sparse.linalg import cg, spsolve

    number = np.full(field.shape, -1, dtype=np.int64)
    number[unknown] = np.arange(np.count_nonzero(unknown))
    known = np.where(unknown, 0.0, field)
    rows, columns, values, right = [], [], [], []
    first = 0
    tension = 1.0 / max(tension_steps, 1e-6)
    for pattern, weight in (
        (((0, -1, 1.0), (0, 0, -2.0), (0, 1, 1.0)), 1.0),
        (((-1, 0, 1.0), (0, 0, -2.0), (1, 0, 1.0)), 1.0),
        (((0, 0, 1.0), (0, 1, -1.0), (1, 0, -1.0), (1, 1, 1.0)), 2.0**0.5),
        (((0, 0, -1.0), (0, 1, 1.0)), tension),
        (((0, 0, -1.0), (1, 0, 1.0)), tension),
    ):
        at = _placed(unknown, pattern)
        constant = np.zeros(len(at[0]))
        for dy, dx, factor in pattern:
            place = at[0] + dy, at[1] + dx
            free = number[place] >= 0
            rows.append(first + np.flatnonzero(free))
            columns.append(number[place][free])
            values.append(np.full(int(free.sum()), weight * factor))
            constant -= weight * factor * known[place]
        right.append(constant)
        first += len(constant)
    matrix = csr_array(
        (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))),
        shape=(first, int(number.max()) + 1),
    )
    normal, target = (matrix.T @ matrix).tocsc(), matrix.T @ np.concatenate(right)
    if start is None:
        answer = spsolve(normal, target)
    else:
        guess = start[unknown]
        goal = _SETTLED * float(np.linalg.norm(target - normal @ guess))
        scale = diags_array(1.0 / normal.diagonal())
        answer, _ = cg(normal, target, x0=guess, rtol=0.0, atol=goal, maxiter=_MOST_STEPS, M=scale)
    result = field.copy()
    result[unknown] = answer
    return result


def _placed(unknown: Mask, pattern: tuple[tuple[int, int, float], ...]) -> tuple[NDArray[np.intp], ...]:
    """Return where a pattern lies inside the grid and on an unknown node."""
    ny, nx = unknown.shape
    low_y, high_y = min(p[0] for p in pattern), max(p[0] for p in pattern)
    low_x, high_x = min(p[1] for p in pattern), max(p[1] for p in pattern)
    touched = np.zeros((max(ny - high_y + low_y, 0), max(nx - high_x + low_x, 0)), dtype=np.bool_)
    for dy, dx, _ in pattern:
        y, x = dy - low_y, dx - low_x
        touched |= unknown[y : y + touched.shape[0], x : x + touched.shape[1]]
    iy, ix = np.nonzero(touched)
    return iy - low_y, ix - low_x
