"""B-splines on any knots, and rational tensor products of them: values and derivatives at many places.

Recurrences: Piegl and Tiller, "The NURBS Book", 2nd ed. 1997, eq. 2.5 (values), 2.9 (derivatives) and 4.20
(rational surfaces). Past the ends of the knots the polynomials of the first and last span continue.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class PatchDerivatives(NamedTuple):
    """Point and partial derivatives of a patch at n parameters, each of shape (n, 3), in its unit."""

    s: Array
    su: Array
    sv: Array
    suu: Array
    """Second derivatives; empty where only the first were asked for."""
    suv: Array
    svv: Array


def knot_basis(knots: Array, degree: int, t: Array, order: int) -> tuple[NDArray[np.intp], Array]:
    """Return the B-splines that are not zero at each parameter, with their derivatives.

    Parameters
    ----------
    knots : ndarray, shape (m,)
        Ascending, ``m = count + degree + 1``.
    degree : int
    t : ndarray, shape (n,)
    order : int
        Highest derivative, 0 to 2.

    Returns
    -------
    first : ndarray of intp, shape (n,)
        Number of the first of the ``degree + 1`` B-splines.
    values : ndarray, shape (n, order + 1, degree + 1)
        Derivative by derivative; those above the degree are zero.
    """
    count = len(knots) - degree - 1
    span = np.clip(np.searchsorted(knots, t, side="right") - 1, degree, count - 1)
    while (empty := knots[span + 1] <= knots[span]).any():  # at the last knot of a multiple end
        span = np.where(empty, span - 1, span)
    values = np.zeros((order + 1, degree + 1, len(t)))
    levels = [np.ones((1, len(t)))]
    for q in range(1, degree + 1):
        levels.append(_risen(knots, span, levels[-1], q, t))
    for d in range(min(order, degree) + 1):
        rows = levels[degree - d]
        for q in range(degree - d + 1, degree + 1):
            rows = _differentiated(knots, span, rows, q)
        values[d] = rows
    return span - degree, np.ascontiguousarray(values.transpose(2, 0, 1))


def _risen(knots: Array, span: NDArray[np.intp], lower: Array, q: int, t: Array) -> Array:
    """Return the B-splines of degree q from those of degree q - 1, shape (q + 1, n)."""
    out = np.zeros((q + 1, len(t)))
    for j in range(1, q + 1):
        left, right = knots[span - q + j], knots[span + j]
        share = lower[j - 1] / (right - left)
        out[j - 1] += (right - t) * share
        out[j] += (t - left) * share
    return out


def _differentiated(knots: Array, span: NDArray[np.intp], lower: Array, q: int) -> Array:
    """Return derivatives at degree q from one derivative less at degree q - 1, shape (q + 1, n)."""
    out = np.zeros((q + 1, lower.shape[1]))
    for j in range(1, q + 1):
        share = q * lower[j - 1] / (knots[span + j] - knots[span - q + j])
        out[j - 1] -= share
        out[j] += share
    return out


def patch_derivatives(
    homogeneous: Array,
    knots: tuple[Array, Array],
    degrees: tuple[int, int],
    u: Array,
    v: Array,
    order: int,
) -> PatchDerivatives:
    """Evaluate a rational tensor-product patch.

    Parameters
    ----------
    homogeneous : ndarray, shape (nu, nv, 4)
        Control points times weight, and the weight.
    knots : tuple of ndarray
        Along u and v.
    degrees : tuple of int
        Along u and v.
    u, v : ndarray, shape (n,)
    order : int
        1 or 2.

    Notes
    -----
    Exact to rounding; tested on circles, spheres and tori as rational patches to 1e-13 of their size.
    """
    (p, q), n = degrees, len(u)
    first_u, in_u = knot_basis(knots[0], p, u, order)
    first_v, in_v = knot_basis(knots[1], q, v, order)
    net = homogeneous[
        (first_u[:, None] + np.arange(p + 1))[:, :, None], (first_v[:, None] + np.arange(q + 1))[:, None, :]
    ]
    rows = (in_u @ net.reshape(n, p + 1, (q + 1) * 4)).reshape(n, order + 1, q + 1, 4)
    a = in_v[:, None] @ rows  # derivative along u, then along v, of (w x, w y, w z, w)
    w = a[..., 3:]
    s = a[:, 0, 0, :3] / w[:, 0, 0]
    su = (a[:, 1, 0, :3] - w[:, 1, 0] * s) / w[:, 0, 0]
    sv = (a[:, 0, 1, :3] - w[:, 0, 1] * s) / w[:, 0, 0]
    if order < 2:
        none = np.empty((0, 3))
        return PatchDerivatives(s, su, sv, none, none, none)
    suu = (a[:, 2, 0, :3] - 2.0 * w[:, 1, 0] * su - w[:, 2, 0] * s) / w[:, 0, 0]
    svv = (a[:, 0, 2, :3] - 2.0 * w[:, 0, 1] * sv - w[:, 0, 2] * s) / w[:, 0, 0]
    suv = (a[:, 1, 1, :3] - w[:, 1, 0] * sv - w[:, 0, 1] * su - w[:, 1, 1] * s) / w[:, 0, 0]
    return PatchDerivatives(s, su, sv, suu, suv, svv)
