"""Where to begin looking for feet: a table of where a ball touches, and how high its centre then stands."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmm_align.numerics.foot_point import JetFunction, Limits

Array = NDArray[np.float64]

_ROUNDS: Final = 6
_SETTLED: Final = 1e-7
"""The rounds end when no foot moves by more than this share of the part: seeds are not known better."""


class SeedTable(NamedTuple):
    """Feet below the nodes of a coarse net on an offset surface, to start from; all of shape (ny, nx)."""

    x0_mm: float
    y0_mm: float
    pitch_x_mm: float
    pitch_y_mm: float
    foot_x_mm: Array
    foot_y_mm: Array
    centre_z_mm: Array
    """Height of the offset surface."""
    bend_x_mm: Array
    """Half its second differences along x: what a straight line between two nodes misses."""
    bend_y_mm: Array
    lean_x: Array
    """How far the foot moves back along x when the point rises by one: ``n_z n_x``."""
    lean_y: Array


def seed_table(jet: JetFunction, side: int, radius_mm: float, limits: Limits, nodes: int = 128) -> SeedTable:
    """Tabulate where the ball touches when its centre stands above (X, Y), and how high it then stands.

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
    regular. `seeds` are then good to some 1e-4 mm on a steep part of 100 mm, which saves an evaluation a
    point.
    """
    x_min, x_max, y_min, y_max = limits
    xs = np.linspace(x_min - radius_mm, x_max + radius_mm, nodes)
    ys = np.linspace(y_min - radius_mm, y_max + radius_mm, nodes)
    px, py = (a.ravel() for a in np.meshgrid(xs, ys))
    x, y = np.clip(px, x_min, x_max), np.clip(py, y_min, y_max)
    longest = max(x_max - x_min, y_max - y_min)
    with np.errstate(invalid="ignore"):
        for _ in range(_ROUNDS):
            j, before = jet(x, y), (x, y)
            scale = side * radius_mm / np.sqrt(1.0 + j.zx**2 + j.zy**2)
            x = np.clip(np.where(np.isfinite(scale), px + j.zx * scale, px), x_min, x_max)
            y = np.clip(np.where(np.isfinite(scale), py + j.zy * scale, py), y_min, y_max)
            if max(np.abs(x - before[0]).max(), np.abs(y - before[1]).max()) <= _SETTLED * longest:
                break
        n_z = side / np.sqrt(1.0 + j.zx**2 + j.zy**2)  # of the last round but one: near enough
        centre = (j.z + radius_mm * n_z).reshape(nodes, nodes)
        lean_x, lean_y = (np.nan_to_num(-z * n_z * n_z).reshape(nodes, nodes) for z in (j.zx, j.zy))
    bend_x, bend_y = np.zeros((2, nodes, nodes))
    bend_x[:, 1:-1] = 0.5 * (centre[:, 2:] - 2.0 * centre[:, 1:-1] + centre[:, :-2])
    bend_y[1:-1] = 0.5 * (centre[2:] - 2.0 * centre[1:-1] + centre[:-2])
    shape = (nodes, nodes)
    return SeedTable(
        float(xs[0]),
        float(ys[0]),
        float(xs[1] - xs[0]),
        float(ys[1] - ys[0]),
        x.reshape(shape),
        y.reshape(shape),
        centre,
        bend_x,
        bend_y,
        lean_x,
        lean_y,
    )


def seeds(table: SeedTable, points_mm: Array) -> tuple[Array, Array]:
    """Return places x and y, each of shape (n,), mm, near the feet of points.

    Parameters
    ----------
    table : SeedTable
    points_mm : ndarray, shape (n, 3), mm, frame `surface`
        Clamped to the table's border; what a point lies off the offset surface moves its foot along the lean.
    """
    ny, nx = table.foot_x_mm.shape
    u = np.clip((points_mm[:, 0] - table.x0_mm) / table.pitch_x_mm, 0.0, nx - 1.000001)
    v = np.clip((points_mm[:, 1] - table.y0_mm) / table.pitch_y_mm, 0.0, ny - 1.000001)
    iu, iv = u.astype(np.intp), v.astype(np.intp)
    fu, fv = u - iu, v - iv
    gu, gv = 1.0 - fu, 1.0 - fv
    k = iv * nx + iu
    w00, w10, w01, w11 = gu * gv, fu * gv, gu * fv, fu * fv
    nearest = k + (fu > 0.5) + nx * (fv > 0.5)

    def read(values: Array) -> Array:
        flat = values.ravel()
        result: Array = (
            flat.take(k) * w00
            + flat.take(k + 1) * w10
            + flat.take(k + nx) * w01
            + flat.take(k + nx + 1) * w11
        )
        return result

    off = points_mm[:, 2] - read(table.centre_z_mm)
    off += table.bend_x_mm.ravel().take(nearest) * (fu * gu)
    off += table.bend_y_mm.ravel().take(nearest) * (fv * gv)
    x = read(table.foot_x_mm) - off * table.lean_x.ravel().take(nearest)
    y = read(table.foot_y_mm) - off * table.lean_y.ravel().take(nearest)
    return x, y
