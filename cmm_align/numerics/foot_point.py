"""Orthogonal foot points on a height field.

The foot point of P is the place (x, y) where the vector from the surface to P is normal to the
surface: two equations, solved by Newton's method with safeguards. Its distance equals the distance to
an offset surface plus the offset, wherever that offset surface is regular.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

STEP_TOLERANCE: Final = 1e-5
"""A Newton step below this share of the local radius of curvature ends the iteration: the foot is then off by
its square, of which the distance feels the square, and the height by its cube."""

MAX_STEPS: Final = 30


class HeightDerivatives(Protocol):
    """Height and derivatives at n places; `surfaces.protocol.Jet` is one."""

    @property
    def z(self) -> Array:
        """Height, shape (n,), mm."""
        ...

    @property
    def zx(self) -> Array:
        """Slope along x, shape (n,)."""
        ...

    @property
    def zy(self) -> Array:
        """Slope along y, shape (n,)."""
        ...

    @property
    def zxx(self) -> Array:
        """Second derivative, shape (n,), 1/mm."""
        ...

    @property
    def zxy(self) -> Array:
        """Second derivative, shape (n,), 1/mm."""
        ...

    @property
    def zyy(self) -> Array:
        """Second derivative, shape (n,), 1/mm."""
        ...


JetFunction = Callable[[Array, Array], HeightDerivatives]
Limits = tuple[float, float, float, float]
"""x_min, x_max, y_min, y_max: a foot point never leaves this rectangle, mm."""


class Feet(NamedTuple):
    """Foot points of n points, frame `surface`."""

    x_mm: Array
    """Place of the foot, shape (n,), mm."""
    y_mm: Array
    distance_mm: Array
    """Signed distance along the normal, positive on the probe's side, shape (n,), mm."""
    normal: Array
    """Unit normal at the foot towards the probe, shape (n, 3)."""
    bend: Array | None = None
    """Second derivatives zxx, zxy, zyy of the surface there, shape (n, 3), 1/mm; None for facets."""

    def of(self, pick: slice | NDArray[np.intp] | Mask) -> Feet:
        """Return the feet of some of the points: a slice, indices of shape (k,) or a mask of shape (n,)."""
        x, y, distance, normal = (whole[pick] for whole in self[:4])
        return Feet(x, y, distance, normal, None if self.bend is None else self.bend[pick])


def foot_points(
    jet: JetFunction,
    side: int,
    points_mm: Array,
    x_mm: Array,
    y_mm: Array,
    limits: Limits,
    tolerance: float = STEP_TOLERANCE,
) -> Feet:
    """Return the foot points of a chunk of points.

    Parameters
    ----------
    jet : callable
        Height and derivatives of the surface at places (x, y), mm.
    side : int
        +1 or -1: which side of the surface the normal points to, along z.
    points_mm : ndarray, shape (n, 3), mm, frame `surface`
    x_mm, y_mm : ndarray, shape (n,), mm
        Where to start: the nearer, the fewer evaluations.
    limits : tuple of float
        Feet are held inside; those that end on the limits are no foot points.
    tolerance : float
        See `STEP_TOLERANCE`.

    Returns
    -------
    Feet
        Distance NaN where the surface is not defined, and at or past its centre of curvature. Tested
        against closed forms to 1e-12 mm.

    Notes
    -----
    Newton's matrix is ``I + g g^T + (s - Z) H``; where it is not positive definite (beyond the centre of
    curvature) the curvature term is dropped, which gives the Gauss-Newton step. The last step is applied by
    Taylor's formula, so that a good start costs one evaluation.
    """
    x_min, x_max, y_min, y_max = limits
    longest = 0.25 * float(np.hypot(x_max - x_min, y_max - y_min))
    x = np.clip(x_mm, x_min, x_max)
    y = np.clip(y_mm, y_min, y_max)
    feet, reach = _newton_step(jet, side, points_mm, x, y, limits, longest)
    open_ = np.flatnonzero(reach > tolerance)
    for _ in range(MAX_STEPS - 1):  # only the points whose step was not short yet
        if not len(open_):
            break
        again, reach = _newton_step(
            jet, side, points_mm[open_], feet.x_mm[open_], feet.y_mm[open_], limits, longest
        )
        put(feet, open_, again)
        open_ = open_[reach > tolerance]
    return feet


def _newton_step(
    jet: JetFunction, side: int, points_mm: Array, x: Array, y: Array, limits: Limits, longest: float
) -> tuple[Feet, Array]:
    """Take one safeguarded step; return the feet after it and the steps in radii of curvature."""
    px, py, pz = points_mm[:, 0], points_mm[:, 1], points_mm[:, 2]
    x_min, x_max, y_min, y_max = limits
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        j = jet(x, y)
        down = j.z - pz
        hxx = 1.0 + j.zx * j.zx + down * j.zxx
        hxy = j.zx * j.zy + down * j.zxy
        hyy = 1.0 + j.zy * j.zy + down * j.zyy
        det = hxx * hyy - hxy * hxy
        bad = ~((det > 1e-3) & (hxx + hyy > 0.0))
        if bad.any():
            hxx = np.where(bad, 1.0 + j.zx * j.zx, hxx)
            hxy = np.where(bad, j.zx * j.zy, hxy)
            hyy = np.where(bad, 1.0 + j.zy * j.zy, hyy)
            det = hxx * hyy - hxy * hxy
        gx = x - px + down * j.zx
        gy = y - py + down * j.zy
        dx = _held((hxy * gy - hyy * gx) / det, x, x_min, x_max, longest)
        dy = _held((hxy * gx - hxx * gy) / det, y, y_min, y_max, longest)
        curvature = np.abs(j.zxx) + np.abs(j.zxy) + np.abs(j.zyy)
        reach = np.maximum(np.abs(dx), np.abs(dy)) * np.maximum(curvature, 1.0 / longest)
        feet = _feet_by_taylor(j, side, points_mm, x, y, dx, dy)
        if bad.any():  # at or past the centre of curvature: a ball of this size does not touch there
            feet.distance_mm[bad] = np.nan
        return feet, reach


def _held(step: Array, x: Array, x_min: float, x_max: float, longest: float) -> Array:
    """Keep a step inside the limits; most need no holding, and asking is cheaper than doing."""
    after = x + step
    if not (after.min() >= x_min and after.max() <= x_max):
        step = np.clip(x + np.clip(step, -longest, longest), x_min, x_max) - x
    return step


def _feet_by_taylor(
    j: HeightDerivatives, side: int, points_mm: Array, x: Array, y: Array, dx: Array, dy: Array
) -> Feet:
    """Take the last, short step without evaluating the surface again."""
    tx = j.zxx * dx + j.zxy * dy
    ty = j.zxy * dx + j.zyy * dy
    z = j.z + (j.zx + 0.5 * tx) * dx + (j.zy + 0.5 * ty) * dy
    zx, zy = j.zx + tx, j.zy + ty
    scale = side / np.sqrt(1.0 + zx * zx + zy * zy)
    normal = np.empty((len(x), 3))
    np.multiply(zx, -scale, out=normal[:, 0])
    np.multiply(zy, -scale, out=normal[:, 1])
    normal[:, 2] = scale
    x = x + dx
    y = y + dy
    distance = (
        (points_mm[:, 0] - x) * normal[:, 0]
        + (points_mm[:, 1] - y) * normal[:, 1]
        + (points_mm[:, 2] - z) * scale
    )
    return Feet(x, y, distance, normal, np.stack([j.zxx, j.zxy, j.zyy], axis=1))


def put(feet: Feet, pick: slice | NDArray[np.intp], part: Feet) -> None:
    """Write the feet of some of the points, shape (k,), over those of all, in place."""
    for whole, piece in zip(feet, part, strict=True):
        if whole is not None:
            whole[pick] = piece


def shifted_feet(side: int, radius_mm: float, feet: Feet, shift_mm: Array) -> Feet:
    """Return where feet go when their points move a little, without looking at the surface again.

    Parameters
    ----------
    side : int
        As for `foot_points`.
    radius_mm : float
        What was taken off the distances of `feet`, mm.
    feet : Feet
        With their `bend`, shape (n,).
    shift_mm : ndarray, shape (n, 3), mm
        How each point moves.

    Returns
    -------
    Feet
        The foot moves by Newton's formula, the normal turns with the slopes there, and as the gradient of the
        distance is the normal, ``d' = d + (n + n') . s / 2``: exact to second order, off by ``s^3`` over the
        square of the radius of curvature (tested).
    """
    bend = feet.bend
    if bend is None:
        raise ValueError("facets do not bend")
    nz = feet.normal[:, 2]
    zx, zy = -feet.normal[:, 0] / nz, -feet.normal[:, 1] / nz
    down = -(feet.distance_mm + radius_mm) * nz
    hxx = 1.0 + zx * zx + down * bend[:, 0]
    hxy = zx * zy + down * bend[:, 1]
    hyy = 1.0 + zy * zy + down * bend[:, 2]
    sx, sy, sz = shift_mm[:, 0], shift_mm[:, 1], shift_mm[:, 2]
    gx, gy = sx + zx * sz, sy + zy * sz
    det = hxx * hyy - hxy * hxy
    dx, dy = (hyy * gx - hxy * gy) / det, (hxx * gy - hxy * gx) / det
    zx = zx + bend[:, 0] * dx + bend[:, 1] * dy
    zy = zy + bend[:, 1] * dx + bend[:, 2] * dy
    scale = side / np.sqrt(1.0 + zx * zx + zy * zy)
    normal = np.stack([-zx * scale, -zy * scale, scale], axis=1)
    between = np.einsum("ij,ij->i", feet.normal + normal, shift_mm)
    return Feet(feet.x_mm + dx, feet.y_mm + dy, feet.distance_mm + 0.5 * between, normal, bend)


def distance_hessian(jet: JetFunction, side: int, points_mm: Array, feet: Feet) -> Array:
    """Return the second derivatives of the distance with respect to the point, shape (n, 3, 3), 1/mm.

    The gradient of the distance is the normal at the foot, so the Hessian is ``dn/du . du/dp``: how the
    normal turns when the foot moves, and how the foot moves when the point does.

    Parameters
    ----------
    jet, side
        As for `foot_points`.
    points_mm : ndarray, shape (n, 3), mm, frame `surface`
    feet : Feet
        Foot points of `points_mm`.
    """
    j = jet(feet.x_mm, feet.y_mm)
    down = j.z - points_mm[:, 2]
    gradient = np.stack([j.zx, j.zy], axis=1)
    hessian = np.stack([np.stack([j.zxx, j.zxy], axis=1), np.stack([j.zxy, j.zyy], axis=1)], axis=1)
    newton = np.eye(2) + gradient[:, :, None] * gradient[:, None, :] + down[:, None, None] * hessian
    foot_from_point = np.linalg.solve(
        newton, np.concatenate([np.broadcast_to(np.eye(2), newton.shape), gradient[:, :, None]], axis=2)
    )
    squared = 1.0 + np.sum(gradient**2, axis=1)
    turn = np.einsum("nab,nb->na", hessian, gradient) / squared[:, None]  # d log w / du
    upward = np.concatenate([-gradient, np.ones((len(down), 1))], axis=1)
    normal_from_foot = -upward[:, :, None] * turn[:, None, :]
    normal_from_foot[:, :2, :] -= hessian
    normal_from_foot *= (side / np.sqrt(squared))[:, None, None]
    result: Array = normal_from_foot @ foot_from_point
    return result
