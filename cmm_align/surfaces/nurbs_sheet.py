"""From (x, y) to the parameters of a patch: Newton's method from the nearest of many samples.

Samples get finer towards the poles of a patch, which `nurbs_pole` takes over.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from cmm_align.errors import GeometryError
from cmm_align.numerics.knot_basis import PatchDerivatives
from cmm_align.numerics.polygons import inside_polygons
from cmm_align.surfaces.nurbs_pole import Cap, knot_range, pole_cap, poles_of
from cmm_align.surfaces.protocol import Array, Mask
from cmm_align.units import RAD_PER_DEG

if TYPE_CHECKING:
    from cmm_align.surfaces.nurbs import NurbsSurface

STEEPEST_DEG: Final = 88.0
"""Steeper than this a patch is a wall."""
CLOSE: Final = 1e-11
"""A place found within this share of the size is met; a Taylor step does the rest."""
CAP: Final = 2e-3
"""Radius of the polynomial around a pole, as a share of the diagonal of the patch."""

_STEPS: Final = 40
_SAMPLES: Final = 160
_MOST_SAMPLES: Final = 640
_BEYOND: Final = 0.25
"""Share of the range of a parameter that Newton's method may leave it by."""


class SheetParameters(NamedTuple):
    """A net of parameters over the trimmed part of a patch."""

    u: Array
    """Shape (nu, nv)."""
    v: Array
    inside: Mask
    """Inside the outline, shape (nu, nv)."""


class Sheet(NamedTuple):
    """What is tabulated of a patch that is a height field."""

    tree: Any
    """KD-tree of the samples over the plane."""
    u: Array
    v: Array
    low: Array
    """Where Newton's method is held, shape (2,)."""
    high: Array
    period: Array
    """Length of a closed direction, shape (2,); 0 where it is open."""
    size_mm: float
    caps: tuple[Cap, ...]

    def parameters(self, patch: NurbsSurface, x: Array, y: Array) -> tuple[Array, Array, Mask]:
        """Return u, v and whether they were found, each of shape (n,)."""
        finite = np.isfinite(x) & np.isfinite(y)
        seed = self.tree.query(np.stack([np.where(finite, x, 0.0), np.where(finite, y, 0.0)], axis=1))[1]
        u, v = self.u[seed], self.v[seed]
        found = np.zeros(len(x), dtype=bool)
        open_ = np.flatnonzero(finite)
        longest = 0.1 * (self.high - self.low)
        for _ in range(_STEPS):
            if not len(open_):
                break
            d = patch.derivatives(u[open_], v[open_], 1)
            rx, ry = x[open_] - d.s[:, 0], y[open_] - d.s[:, 1]
            met = np.maximum(np.abs(rx), np.abs(ry)) <= CLOSE * self.size_mm
            found[open_[met]] = True
            du, dv = _step(d, rx, ry)
            moving = ~met & np.isfinite(du) & np.isfinite(dv)
            open_ = open_[moving]
            u[open_] = self._held(0, u[open_] + np.clip(du[moving], -longest[0], longest[0]))
            v[open_] = self._held(1, v[open_] + np.clip(dv[moving], -longest[1], longest[1]))
        return u, v, found

    def _held(self, axis: int, t: Array) -> Array:
        if self.period[axis] > 0.0:
            result: Array = self.low[axis] + np.mod(t - self.low[axis], self.period[axis])
            return result
        return np.clip(t, self.low[axis], self.high[axis])


def _step(d: PatchDerivatives, rx: Array, ry: Array) -> tuple[Array, Array]:
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        (xu, yu, _), (xv, yv, _) = d.su.T, d.sv.T
        det = xu * yv - xv * yu
        return (rx * yv - ry * xv) / det, (ry * xu - rx * yu) / det


def sheet_parameters(patch: NurbsSurface) -> SheetParameters:
    """Return a net of parameters around the outline, finer towards poles; denser where knots are."""
    outline = np.concatenate(patch.loops_uv)
    ends = knot_range(patch)
    first, last = outline.min(axis=0), outline.max(axis=0)
    margin = 0.02 * (last - first)
    first, last = np.maximum(first - margin, ends[0]), np.minimum(last + margin, ends[1])
    axes = []
    for axis, knots in enumerate((patch.knots_u, patch.knots_v)):
        inner = np.unique(knots[(knots > first[axis]) & (knots < last[axis])])
        cuts = np.concatenate([[first[axis]], inner, [last[axis]]])
        each = int(np.clip(_SAMPLES // (len(cuts) - 1), 3, _MOST_SAMPLES))
        steps = np.arange(each) / each
        places = np.append((cuts[:-1, None] + np.diff(cuts)[:, None] * steps).ravel(), cuts[-1])
        graded = np.geomspace(1e-5, 0.02, 16) * (last[axis] - first[axis])
        for where, end in poles_of(patch):
            if where == axis:
                places = np.append(places, first[axis] + graded if end == 0 else last[axis] - graded)
        axes.append(np.unique(places))
    u, v = np.meshgrid(*axes, indexing="ij")
    scale = np.maximum(last - first, 1e-300)
    loops = [(loop - first) / scale for loop in patch.loops_uv]
    flat_u, flat_v = ((u - first[0]) / scale[0]).ravel(), ((v - first[1]) / scale[1]).ravel()
    inside = inside_polygons(loops, flat_u, flat_v, 1e-9).reshape(u.shape)
    return SheetParameters(u, v, inside)


def sheet_of(patch: NurbsSurface) -> Sheet:
    """Tabulate a patch that is a height field over (x, y).

    Raises
    ------
    GeometryError
        If it folds, stands upright, or lies over itself.
    """
    from scipy.spatial import cKDTree  # slow to import, and only patches need it

    net = sheet_parameters(patch)
    d = patch.derivatives(net.u.ravel(), net.v.ravel(), 1)
    normal = np.cross(d.su, d.sv)
    length = np.linalg.norm(normal, axis=1)
    cosine = np.where(length > 1e-12 * length.max(), normal[:, 2] / np.maximum(length, 1e-300), 0.0)
    regular = length > 1e-9 * length.max()
    inside = net.inside.ravel() & regular
    if np.count_nonzero(inside) < 9:
        raise GeometryError("the outline of the patch holds no area", where=patch.source)
    sign = 1.0 if float(np.median(cosine[inside])) > 0.0 else -1.0
    upright = np.cos(STEEPEST_DEG * RAD_PER_DEG)
    worst = int(np.argmin(np.where(inside, sign * cosine, np.inf)))
    if sign * cosine[worst] < upright:
        x, y, z = d.s[worst]
        what = "folds back" if sign * cosine[worst] < -upright else "stands upright"
        raise GeometryError(
            f"the patch {what} at x = {x:.6g}, y = {y:.6g}, z = {z:.6g} mm, seen along z",
            where=patch.source,
            expected="a height field",
        )
    usable = _grown(_grown(net.inside)).ravel() & regular & (sign * cosine > upright)
    ends = knot_range(patch)
    held_low, held_high = ends[0] - _BEYOND * (ends[1] - ends[0]), ends[1] + _BEYOND * (ends[1] - ends[0])
    period = np.zeros(2)
    poles = poles_of(patch)
    for axis in (0, 1):
        if _closed(patch, axis):
            held_low[axis], held_high[axis] = ends[0][axis], ends[1][axis]
            period[axis] = ends[1][axis] - ends[0][axis]
    for axis, end in poles:
        (held_low, held_high)[end][axis] = ends[end][axis]
    size = float(np.ptp(d.s[inside], axis=0).max())
    sheet = Sheet(
        cKDTree(d.s[usable][:, :2]),
        net.u.ravel()[usable],
        net.v.ravel()[usable],
        held_low,
        held_high,
        period,
        size,
        tuple(pole_cap(patch, axis, end, CAP * size) for axis, end in poles),
    )
    _refuse_double(patch, sheet, d.s[inside][:: max(1, np.count_nonzero(inside) // 4000)])
    return sheet


def _closed(patch: NurbsSurface, axis: int) -> bool:
    """Return whether the patch meets itself at the ends of a parameter."""
    control, weights = np.moveaxis(patch.control_mm, axis, 0), np.moveaxis(patch.weights, axis, 0)
    size = float(np.ptp(patch.control_mm.reshape(-1, 3), axis=0).max())
    same = float(np.abs(control[0] - control[-1]).max()) <= 1e-9 * size
    return same and bool(np.allclose(weights[0], weights[-1], rtol=1e-12))


def _grown(mask: Mask) -> Mask:
    """Add the neighbours of every sample."""
    padded = np.pad(mask, 1)
    result: Mask = mask | padded[2:, 1:-1] | padded[:-2, 1:-1] | padded[1:-1, 2:] | padded[1:-1, :-2]
    return result


def _refuse_double(patch: NurbsSurface, sheet: Sheet, points_mm: Array) -> None:
    """Refuse a patch with two heights at one place."""
    u, v, found = sheet.parameters(patch, points_mm[:, 0], points_mm[:, 1])
    away = np.abs(patch.derivatives(u, v, 1).s[:, 2] - points_mm[:, 2])
    double = found & (away > 1e-6 * sheet.size_mm)
    if double.any():
        x, y, z = points_mm[int(np.argmax(np.where(double, away, 0.0)))]
        raise GeometryError(
            f"the patch lies over itself at x = {x:.6g}, y = {y:.6g} mm (one height is {z:.6g} mm)",
            where=patch.source,
            expected="one height at every place",
        )
