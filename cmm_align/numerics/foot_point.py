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
"""A Newton step below this share of the local radius of curvature ends the iteration: what is left is
its square, and the distance feels only the fourth power."""

ROUGH_TOLERANCE: Final = 3e-4
"""The same for distances that will be measured again from the feet found: good to some 1e-9 mm."""

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
        `STEP_TOLERANCE` or `ROUGH_TOLERANCE`.

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
        for whole, part in zip(feet, again, strict=True):
            whole[open_] = part
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
    return Feet(x, y, distance, normal)


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


class SeedTable(NamedTuple):
    """Feet below the nodes of a coarse net on an offset surface, to start from."""

    x0_mm: float
    y0_mm: float
    pitch_x_mm: float
    pitch_y_mm: float
    foot_x_mm: Array
    """Shape (ny, nx), mm."""
    foot_y_mm: Array


def seed_table(jet: JetFunction, side: int, radius_mm: float, limits: Limits, nodes: int = 128) -> SeedTable:
    """Tabulate where the ball touches when its centre stands above (X, Y).

    Parameters
    ----------
    jet, side, limits
        As for `foot_points`.
    radius_mm : float
        Offset of the surface that the centres lie on, mm.
    nodes : int
        Nodes along each axis.

    Notes
    -----
    Solves ``u + r n_xy(u) = (X, Y)`` by fixed-point iteration, a contraction where the offset surface is
    regular. Read bilinearly, the table is good to some 1e-5 mm, which saves one evaluation a point.
    """
    x_min, x_max, y_min, y_max = limits
    xs = np.linspace(x_min - radius_mm, x_max + radius_mm, nodes)
    ys = np.linspace(y_min - radius_mm, y_max + radius_mm, nodes)
    px, py = (a.ravel() for a in np.meshgrid(xs, ys))
    x, y = np.clip(px, x_min, x_max), np.clip(py, y_min, y_max)
    with np.errstate(invalid="ignore"):
        for _ in range(6):
            j = jet(x, y)
            scale = side * radius_mm / np.sqrt(1.0 + j.zx**2 + j.zy**2)
            x = np.clip(np.where(np.isfinite(scale), px + j.zx * scale, px), x_min, x_max)
            y = np.clip(np.where(np.isfinite(scale), py + j.zy * scale, py), y_min, y_max)
    shape = (nodes, nodes)
    return SeedTable(
        float(xs[0]),
        float(ys[0]),
        float(xs[1] - xs[0]),
        float(ys[1] - ys[0]),
        x.reshape(shape),
        y.reshape(shape),
    )


def seeds(table: SeedTable, x_mm: Array, y_mm: Array) -> tuple[Array, Array]:
    """Read the table bilinearly at places of shape (n,), mm; clamped at its border."""
    ny, nx = table.foot_x_mm.shape
    u = np.clip((x_mm - table.x0_mm) / table.pitch_x_mm, 0.0, nx - 1.000001)
    v = np.clip((y_mm - table.y0_mm) / table.pitch_y_mm, 0.0, ny - 1.000001)
    iu, iv = u.astype(np.intp), v.astype(np.intp)
    fu, fv = u - iu, v - iv
    k = iv * nx + iu
    w00, w10, w01, w11 = (1 - fu) * (1 - fv), fu * (1 - fv), (1 - fu) * fv, fu * fv

    def read(values: Array) -> Array:
        flat = values.ravel()
        result: Array = (
            flat.take(k) * w00
            + flat.take(k + 1) * w10
            + flat.take(k + nx) * w01
            + flat.take(k + nx + 1) * w11
        )
        return result

    return read(table.foot_x_mm), read(table.foot_y_mm)
