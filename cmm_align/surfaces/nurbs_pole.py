"""The poles of patches: edges that have shrunk to a point, as on a sphere or any surface of revolution.

The parameters are singular there though the surface is smooth; a small polynomial takes over.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cmm_align.errors import GeometryError
from cmm_align.surfaces.protocol import Array, Jet

if TYPE_CHECKING:
    from cmm_align.surfaces.nurbs import NurbsSurface

TIP_MM: Final = 1e-5
"""A pole that differs from a smooth surface by more is a tip."""
_CAP_DEGREE: Final = 6


class Cap(NamedTuple):
    """Polynomial around a pole, over ``(x - x_mm) / radius_mm`` and the same along y."""

    x_mm: float
    y_mm: float
    radius_mm: float
    coefficients_mm: Array
    """Shape (terms,), mm."""


def knot_range(patch: NurbsSurface) -> tuple[Array, Array]:
    """Return the lower and the upper ends of the knots (u, v), each of shape (2,)."""
    p, q = patch.degree_u, patch.degree_v
    return (
        np.array([patch.knots_u[p], patch.knots_v[q]]),
        np.array([patch.knots_u[-p - 1], patch.knots_v[-q - 1]]),
    )


def poles_of(patch: NurbsSurface) -> list[tuple[int, int]]:
    """Return (axis, end) of the edges of the patch that are points."""
    size = float(np.ptp(patch.control_mm.reshape(-1, 3), axis=0).max())
    edges = {
        (0, 0): patch.control_mm[0],
        (0, 1): patch.control_mm[-1],
        (1, 0): patch.control_mm[:, 0],
        (1, 1): patch.control_mm[:, -1],
    }
    return [where for where, edge in edges.items() if float(np.ptp(edge, axis=0).max()) <= 1e-9 * size]


def pole_cap(patch: NurbsSurface, axis: int, end: int, radius_mm: float) -> Cap:
    """Fit a polynomial to the surface around a pole.

    Parameters
    ----------
    patch : NurbsSurface
    axis, end : int
        Which edge it is, as `poles_of` gives it.
    radius_mm : float
        Up to where the polynomial answers.

    Raises
    ------
    GeometryError
        If the surface is not smooth there.
    """
    ends = knot_range(patch)
    outline = np.concatenate(patch.loops_uv)[:, 1 - axis]
    around = np.linspace(float(outline.min()), float(outline.max()), 49)
    start, whole = ends[end][axis], (ends[1 - end][axis] - ends[end][axis])

    def ring(share: ArrayLike) -> Array:
        steps = np.asarray(share, dtype=np.float64)
        along = np.repeat(start + whole * steps, len(around))
        across = np.tile(around, len(steps))
        u, v = (along, across) if axis == 0 else (across, along)
        return patch.derivatives(u, v, 1).s

    x, y, _ = ring([0.0])[0]
    near, far = 0.0, 1.0
    for _ in range(60):
        middle = 0.5 * (near + far)
        points = ring([middle])
        if float(np.hypot(points[:, 0] - x, points[:, 1] - y).max()) > 1.25 * radius_mm:
            far = middle
        else:
            near = middle
    points = ring(far * np.arange(1, 11) / 10.0)
    rows = _powers((points[:, 0] - x) / radius_mm, (points[:, 1] - y) / radius_mm)[0]
    coefficients: Array = np.asarray(np.linalg.lstsq(rows, points[:, 2], rcond=None)[0], dtype=np.float64)
    rest = float(np.abs(rows @ coefficients - points[:, 2]).max())
    if rest > TIP_MM:
        raise GeometryError(
            f"the patch comes to a tip at x = {x:.6g}, y = {y:.6g} mm",
            where=patch.source,
            expected="a smooth surface",
        )
    return Cap(float(x), float(y), radius_mm, coefficients)


def _powers(x: Array, y: Array) -> list[Array]:
    """Return x^i y^j with its derivatives (value, x, y, xx, xy, yy), each of shape (n, terms)."""
    pairs = [(i, n - i) for n in range(_CAP_DEGREE + 1) for i in range(n + 1)]

    def term(t: Array, k: int, d: int) -> Array:
        if k < d:
            return np.zeros_like(t)
        factor = (1.0, float(k), float(k * (k - 1)))[d]
        result: Array = factor * t ** (k - d)
        return result

    orders = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
    return [np.stack([term(x, i, a) * term(y, j, b) for i, j in pairs], axis=1) for a, b in orders]


def smooth_at_pole(caps: Sequence[Cap], jet: Jet, x: Array, y: Array) -> Jet:
    """Return a jet at places of shape (n,), mm, with those near poles answered by their polynomials."""
    for cap in caps:
        r = cap.radius_mm
        near = np.flatnonzero(np.hypot(x - cap.x_mm, y - cap.y_mm) < r)
        if len(near):
            parts = _powers((x[near] - cap.x_mm) / r, (y[near] - cap.y_mm) / r)
            for out, part, power in zip(jet, parts, (0, 1, 1, 2, 2, 2), strict=True):
                out[near] = part @ cap.coefficients_mm / r**power
    return jet
