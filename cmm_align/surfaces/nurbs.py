"""A nominal as a trimmed rational B-spline patch (NURBS), evaluated by ourselves to the last digits.

Height and derivatives over (x, y) come from those over (u, v) by implicit differentiation; the way from
(x, y) to (u, v) is in `nurbs_sheet`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from cmm_align.errors import GeometryError
from cmm_align.numerics.knot_basis import PatchDerivatives, patch_derivatives
from cmm_align.numerics.polygons import inside_polygons
from cmm_align.surfaces.nurbs_pole import smooth_at_pole
from cmm_align.surfaces.nurbs_sheet import Sheet, sheet_of, sheet_parameters
from cmm_align.surfaces.protocol import Array, Bounds, Jet, Mask

BORDER_SLACK: Final = 1e-5
"""A foot point this share of the diagonal past the border still lies on the surface: noise moves it there,
and outlines are polygons."""
MAX_DEGREE: Final = 25
_CHUNK: Final = 8192
_NEGATIVE: Final = "weights and knots of a patch: positive weights, ascending knots, count + degree + 1 knots"


@dataclass(frozen=True, eq=False)
class NurbsSurface:
    """A rational tensor-product B-spline patch, cut out by its outline and holes.

    Read from CAD it lies in frame `part`; `turned` moves it to frame `surface`, where it must be a height
    field over (x, y) before `bounds`, `jet` and `contains` may be asked.

    Attributes
    ----------
    degree_u, degree_v : int
    knots_u, knots_v : ndarray, shape (nu + degree_u + 1,), (nv + degree_v + 1,)
    control_mm : ndarray, shape (nu, nv, 3), mm
    weights : ndarray, shape (nu, nv)
        All above zero; all ones for a patch that is not rational.
    loops_uv : tuple of ndarray, each of shape (k, 2)
        Outline and holes as closed polygons of parameters.
    source : str
        Where it came from, for messages.
    conversion_error_mm : float
        Largest distance from the surface that the file holds, where that one is of another kind, mm.
    kind : str
    """

    degree_u: int
    degree_v: int
    knots_u: Array
    knots_v: Array
    control_mm: Array
    weights: Array
    loops_uv: tuple[Array, ...]
    source: str = "patch"
    conversion_error_mm: float = 0.0
    kind: str = "nurbs"

    @classmethod
    def of(
        cls,
        degrees: tuple[int, int],
        knots_u: ArrayLike,
        knots_v: ArrayLike,
        control_mm: ArrayLike,
        weights: ArrayLike | None = None,
        loops_uv: Sequence[ArrayLike] = (),
        source: str = "patch",
        conversion_error_mm: float = 0.0,
    ) -> NurbsSurface:
        """Return a checked patch.

        Parameters
        ----------
        degrees : tuple of int
            Along u and v.
        knots_u, knots_v, control_mm, weights, loops_uv, source, conversion_error_mm
            As the attributes, of the same shapes; ones without `weights`, the whole patch without `loops_uv`.

        Raises
        ------
        GeometryError
            If the numbers cannot be those of a patch.
        """
        u, v, control = (_frozen(a) for a in (knots_u, knots_v, control_mm))
        flat = np.ones(control.shape[:2]) if weights is None else weights
        patch = cls(*degrees, u, v, control, _frozen(flat), (), str(source), float(conversion_error_mm))
        _check(patch)
        loops = tuple(_frozen(loop) for loop in loops_uv) or (_frozen(_whole(patch)),)
        if any(loop.ndim != 2 or loop.shape[1] != 2 or len(loop) < 3 for loop in loops):
            raise GeometryError("an outline without area", where=source, expected="at least 3 (u, v) pairs")
        return replace(patch, loops_uv=loops)

    def turned(self, rotation: Array) -> NurbsSurface:
        """Return the patch turned about the origin.

        Parameters
        ----------
        rotation : ndarray, shape (3, 3)
            Target from source.
        """
        return replace(self, control_mm=_frozen(self.control_mm @ np.asarray(rotation).T))

    def derivatives(self, u: Array, v: Array, order: int = 2) -> PatchDerivatives:
        """Return points and derivatives along u and v (orders 1 or 2) at parameters of shape (n,), mm."""
        return patch_derivatives(
            self._homogeneous, (self.knots_u, self.knots_v), (self.degree_u, self.degree_v), u, v, order
        )

    def sampled(self) -> tuple[Array, Array]:
        """Return points (mm) and unit normals of the trimmed patch, each of shape (n, 3)."""
        net = sheet_parameters(self)
        d = self.derivatives(net.u[net.inside], net.v[net.inside], 1)
        normal = np.cross(d.su, d.sv)
        length = np.linalg.norm(normal, axis=1)
        regular = length > 1e-9 * float(length.max(initial=0.0))
        return d.s[regular], normal[regular] / length[regular, None]

    @property
    def bounds(self) -> Bounds:
        """Rectangle around the outline, mm."""
        places = np.concatenate(self.loops_mm)
        (x0, y0), (x1, y1) = places.min(axis=0), places.max(axis=0)
        return Bounds(float(x0), float(x1), float(y0), float(y1))

    @cached_property
    def loops_mm(self) -> tuple[Array, ...]:
        """Outline and holes over the plane, each of shape (k, 2), mm."""
        return tuple(self.derivatives(loop[:, 0], loop[:, 1], 1).s[:, :2] for loop in self.loops_uv)

    def jet(self, x_mm: Array, y_mm: Array) -> Jet:
        """Return height and derivatives; NaN where the patch does not reach.

        Tested against closed forms (sphere, torus, biquintic graph): height to 1e-12 mm, second derivatives
        to 1e-11 of the curvature. Past the border the last polynomials continue.
        """
        x, y = np.asarray(x_mm, dtype=np.float64), np.asarray(y_mm, dtype=np.float64)
        jet = Jet(*(np.empty(len(x)) for _ in Jet._fields))
        for start in range(0, len(x), _CHUNK):
            part = slice(start, start + _CHUNK)
            u, v, found = self._sheet.parameters(self, x[part], y[part])
            values = _implicit_jet(self.derivatives(u, v, 2), x[part], y[part])
            for out, value in zip(jet, values, strict=True):
                out[part] = np.where(found, value, np.nan)
        return smooth_at_pole(self._sheet.caps, jet, x, y)

    def contains(self, x_mm: Array, y_mm: Array) -> Mask:
        """Return whether places lie inside the outline and outside the holes."""
        x, y = np.asarray(x_mm, dtype=np.float64), np.asarray(y_mm, dtype=np.float64)
        return inside_polygons(self.loops_mm, x, y, BORDER_SLACK * self.bounds.diagonal_mm)

    def digest(self) -> bytes:
        """Return the SHA-256 of all numbers that define the patch."""
        found = hashlib.sha256(f"{self.degree_u} {self.degree_v}".encode())
        for array in (self.knots_u, self.knots_v, self.control_mm, self.weights, *self.loops_uv):
            found.update(np.ascontiguousarray(array).tobytes())
        return found.digest()

    @cached_property
    def _homogeneous(self) -> Array:
        w = self.weights[..., None]
        return np.concatenate([self.control_mm * w, w], axis=2)

    @cached_property
    def _sheet(self) -> Sheet:
        return sheet_of(self)


def _frozen(values: ArrayLike) -> Array:
    array = np.array(values, dtype=np.float64)
    array.flags.writeable = False
    return array


def _check(patch: NurbsSurface) -> None:
    """Refuse numbers that cannot be those of a patch."""
    control = patch.control_mm
    good = control.ndim == 3 and control.shape[2] == 3 and patch.weights.shape == control.shape[:2]
    if good:
        good = bool(np.isfinite(control).all() and (patch.weights > 0.0).all())
        good = good and bool(np.isfinite(patch.weights).all())
    for axis, (degree, knots) in enumerate(
        ((patch.degree_u, patch.knots_u), (patch.degree_v, patch.knots_v))
    ):
        good = good and 1 <= degree <= MAX_DEGREE and knots.ndim == 1
        good = good and control.shape[axis] > degree and len(knots) == control.shape[axis] + degree + 1
        good = good and bool(np.isfinite(knots).all() and (np.diff(knots) >= 0.0).all())
        good = good and bool(knots[degree] < knots[-degree - 1])
    if not good:
        raise GeometryError("not a patch", where=patch.source, expected=_NEGATIVE)


def _whole(patch: NurbsSurface, steps: int = 512) -> Array:
    """Return the border of the knots as one polygon, shape (4 steps, 2)."""
    u0, u1 = patch.knots_u[patch.degree_u], patch.knots_u[-patch.degree_u - 1]
    v0, v1 = patch.knots_v[patch.degree_v], patch.knots_v[-patch.degree_v - 1]
    t = np.arange(steps) / steps
    one, none = np.ones(steps), np.zeros(steps)
    u = u0 + (u1 - u0) * np.concatenate([t, one, 1.0 - t, none])
    v = v0 + (v1 - v0) * np.concatenate([none, t, one, 1.0 - t])
    return np.stack([u, v], axis=1)


def _implicit_jet(d: PatchDerivatives, x: Array, y: Array) -> Jet:
    """Turn derivatives along (u, v) into those along (x, y), and step from the point found to (x, y).

    With J the Jacobian of (x, y) over (u, v): the gradient g solves ``J^T g = (z_u, z_v)``, the Hessian is
    ``J^-T (z_ab - g . (x, y)_ab) J^-1``.
    """
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        (xu, yu, zu), (xv, yv, zv) = d.su.T, d.sv.T
        det = xu * yv - xv * yu
        zx, zy = (zu * yv - zv * yu) / det, (zv * xu - zu * xv) / det
        muu, muv, mvv = (part[:, 2] - zx * part[:, 0] - zy * part[:, 1] for part in (d.suu, d.suv, d.svv))
        ux, uy, vx, vy = yv / det, -xv / det, -yu / det, xu / det
        zxx = muu * ux * ux + 2.0 * muv * ux * vx + mvv * vx * vx
        zxy = muu * ux * uy + muv * (ux * vy + uy * vx) + mvv * vx * vy
        zyy = muu * uy * uy + 2.0 * muv * uy * vy + mvv * vy * vy
        dx, dy = x - d.s[:, 0], y - d.s[:, 1]
        gx, gy = zxx * dx + zxy * dy, zxy * dx + zyy * dy
        z = d.s[:, 2] + (zx + 0.5 * gx) * dx + (zy + 0.5 * gy) * dy
        return Jet(z, zx + gx, zy + gy, zxx, zxy, zyy)
