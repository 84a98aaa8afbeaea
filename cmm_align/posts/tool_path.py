"""The order in which a tool goes over a surface: lines to and fro, or a spiral.

A raster takes every m-th line and node of the grid, m as large as the spacings allow: its points are those
of the correction, nothing is interpolated. A spiral (Archimedes, equal steps along the arc) needs points
between the nodes: there the height is that of the nominal plus a spline of degree five through what the
nodes are commanded more than it, and the normal is that of the sum. It runs in the cells whose four nodes are
all commanded; past them the field is carried on by parabolas, for the sake of the spline alone.

A stroke is a run of points that is cut without a pause; where the aperture ends or has a hole, the tool is
lifted. Frames: made in `surface`, given in `part`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cmm_align.config import RASTERS, SPIRALS, ExportConfig
from cmm_align.errors import UsageError
from cmm_align.model import Correction, IntArray
from cmm_align.numerics.grid_field import continued
from cmm_align.numerics.tensor_spline import interpolating_coefficients, spline_jet
from cmm_align.surfaces.geometry import unit_normal
from cmm_align.surfaces.protocol import Array

MOST_POINTS: Final = 20_000_000

_DEGREE: Final = 5
_RINGS: Final = 8
_ROUNDING: Final = 1e-9
_CHUNK: Final = 16_384
_TABLE: Final = 20_000


@dataclass(frozen=True, slots=True)
class ToolPath:
    """Contact points in the order of cutting, frame `part`.

    Attributes
    ----------
    points_mm : ndarray, shape (n, 3), mm
    normals : ndarray, shape (n, 3)
        Unit normals of the commanded surface.
    starts : ndarray of int64, shape (k,)
        First point of each stroke.
    lifted : ndarray of bool, shape (k,)
        Whether the tool is lifted before a stroke; else it moves to it while cutting.
    up : ndarray, shape (3,)
        Unit vector out of the material along the direction of projection.
    """

    points_mm: Array
    normals: Array
    starts: IntArray
    lifted: NDArray[np.bool_]
    up: Array


def raster(correction: Correction, config: ExportConfig) -> ToolPath:
    """Return lines to and fro over the nodes of the grid.

    Raises
    ------
    UsageError
        If the direction is none.
    """
    if config.raster_along not in RASTERS:
        raise UsageError(f"a raster along {config.raster_along!r}", expected=" or ".join(RASTERS))
    along_x = config.raster_along == "x"
    nodes = (correction.y_mm, correction.x_mm) if along_x else (correction.x_mm, correction.y_mm)
    across, along = _every(nodes[0], config.line_spacing_mm), _every(nodes[1], config.point_spacing_mm)
    inside = np.isfinite(correction.commanded_z_mm)
    taken = (inside if along_x else inside.T)[np.ix_(across, along)]
    lines, places, starts = [], [], []
    count, back = 0, False
    for k in range(len(across)):
        runs = _runs(taken[k])
        for first, last in reversed(runs) if back else runs:
            line = np.arange(last, first - 1, -1) if back else np.arange(first, last + 1)
            lines.append(np.full(len(line), across[k]))
            places.append(along[line])
            starts.append(count)
            count += len(line)
        back = not back if runs else back
    row, column = np.concatenate(lines), np.concatenate(places)
    iy, ix = (row, column) if along_x else (column, row)
    points = np.column_stack([correction.x_mm[ix], correction.y_mm[iy], correction.commanded_z_mm[iy, ix]])
    # The way to the next line is a chord: short, or the tool is lifted.
    way = np.linalg.norm(np.diff(points, axis=0), axis=1)[np.array(starts[1:], dtype=np.intp) - 1]
    widest = float(np.diff(nodes[0][across]).max(initial=0.0))
    normals = correction.commanded_normal[iy, ix]
    steep = 1.0 / np.abs(normals[starts[1:], 2])
    return _in_part(correction, points, normals, starts, [True, *(way > 1.5 * widest * steep)])


def spiral(correction: Correction, config: ExportConfig) -> ToolPath:
    """Return a spiral about the middle of the aperture, with the spacings of the settings.

    Raises
    ------
    UsageError
        If the direction is none, or the spiral has too many points.
    """
    if config.spiral_direction not in SPIRALS:
        raise UsageError(f"a spiral {config.spiral_direction!r}", expected=" or ".join(SPIRALS))
    step = min(float(nodes[1] - nodes[0]) for nodes in (correction.x_mm, correction.y_mm))
    u, v = _archimedean(correction, config.line_spacing_mm or step, config.point_spacing_mm or step)
    inside = _in_known_cells(correction, u, v)
    if config.spiral_direction == "inwards":
        u, v, inside = u[::-1].copy(), v[::-1].copy(), inside[::-1]
    runs = _runs(inside)
    if not runs:
        raise UsageError("no point of the spiral lies on the part", remedy="take a smaller line spacing")
    kept = np.concatenate([np.arange(first, last + 1) for first, last in runs])
    starts = np.concatenate([[0], np.cumsum([last - first + 1 for first, last in runs])[:-1]])
    points, normals = _between_nodes(correction, u[kept], v[kept])
    return _in_part(correction, points, normals, starts.tolist(), [True] * len(runs))


def _every(nodes_mm: Array, spacing_mm: float) -> NDArray[np.intp]:
    """Return the numbers of the nodes to take, never farther apart than asked for, both ends included."""
    step = float(nodes_mm[1] - nodes_mm[0])
    stride = max(1, int(np.floor(spacing_mm / step * (1.0 + 1e-9))))
    taken = np.arange(0, len(nodes_mm), stride)
    return taken if taken[-1] == len(nodes_mm) - 1 else np.append(taken, len(nodes_mm) - 1)


def _runs(inside: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return first and last of each run of True."""
    edge = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(np.int8)))
    return [(int(a), int(b) - 1) for a, b in zip(edge[::2], edge[1::2], strict=True)]


def _archimedean(correction: Correction, pitch_mm: float, step_mm: float) -> tuple[Array, Array]:
    """Return points of ``r = pitch angle / 2 pi`` at equal steps along the arc, out to the last corner."""
    b = correction.nominal.surface.bounds
    x0, y0 = 0.5 * (b.x_min + b.x_max), 0.5 * (b.y_min + b.y_max)
    a = pitch_mm / (2.0 * np.pi)
    most = 0.5 * b.diagonal_mm / a
    length = 0.5 * a * (most * np.hypot(1.0, most) + np.arcsinh(most))
    if length / step_mm > MOST_POINTS:
        raise UsageError(f"a spiral of {length / step_mm:.3g} points", expected=f"at most {MOST_POINTS}")
    arc = np.arange(0.0, length, step_mm)
    angle = np.sqrt(2.0 * arc / a)  # right far out; two steps of Newton mend the middle
    for _ in range(6):
        root = np.hypot(1.0, angle)
        angle = np.maximum(angle - (0.5 * a * (angle * root + np.arcsinh(angle)) - arc) / (a * root), 0.0)
    return x0 + a * angle * np.cos(angle), y0 + a * angle * np.sin(angle)


def _in_known_cells(correction: Correction, x: Array, y: Array) -> NDArray[np.bool_]:
    """Return whether places lie between four nodes that are all commanded."""
    known = np.isfinite(correction.commanded_z_mm)
    cell = known[1:, 1:] & known[1:, :-1] & known[:-1, 1:] & known[:-1, :-1]
    inside = np.ones(len(x), np.bool_)
    numbers = []
    for nodes, places in ((correction.y_mm, y), (correction.x_mm, x)):
        t = (places - nodes[0]) / (nodes[1] - nodes[0])
        inside &= (t >= -_ROUNDING) & (t <= len(nodes) - 1 + _ROUNDING)
        numbers.append(np.clip(t, 0.0, len(nodes) - 2).astype(np.intp))
    inside &= cell[numbers[0], numbers[1]]
    return inside


def _carried_on(field: Array) -> Array:
    """Return a field with some rings of unknown nodes carried on by parabolas from the known ones."""
    out = np.pad(field, 3, constant_values=np.nan)
    for _ in range(_RINGS):
        known = np.isfinite(out)
        beside = np.zeros_like(known)
        beside[1:-1, 1:-1] = known[2:, 1:-1] | known[:-2, 1:-1] | known[1:-1, 2:] | known[1:-1, :-2]
        beside[:3], beside[-3:], beside[:, :3], beside[:, -3:] = False, False, False, False
        iy, ix = np.nonzero(beside & ~known)
        found = [
            3.0 * out[iy + dy, ix + dx] - 3.0 * out[iy + 2 * dy, ix + 2 * dx] + out[iy + 3 * dy, ix + 3 * dx]
            for dy, dx in ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1))
        ]
        some = np.isfinite(found)
        count = some.sum(axis=0)
        out[iy, ix] = np.where(
            count > 0, np.where(some, found, 0.0).sum(axis=0) / np.maximum(count, 1), np.nan
        )
    return out[3:-3, 3:-3]


def _between_nodes(correction: Correction, x: Array, y: Array) -> tuple[Array, Array]:
    """Return points and normals of the commanded surface anywhere on the grid, frame `surface`."""
    x_mm, y_mm, nominal = correction.x_mm, correction.y_mm, correction.nominal
    xg, yg = np.meshgrid(x_mm, y_mm)
    more = correction.commanded_z_mm - nominal.surface.jet(xg.ravel(), yg.ravel()).z.reshape(xg.shape)
    degree = _DEGREE if min(more.shape) >= _DEGREE + 2 else 3
    coefficients = interpolating_coefficients(continued(_carried_on(more)), degree)
    dx, dy = float(x_mm[1] - x_mm[0]), float(y_mm[1] - y_mm[0])
    points, normals = np.empty((len(x), 3)), np.empty((len(x), 3))
    for first in range(0, len(x), _CHUNK):
        part = slice(first, first + _CHUNK)
        jet = nominal.surface.jet(x[part], y[part])
        on = spline_jet(coefficients, degree, (x[part] - x_mm[0]) / dx, (y[part] - y_mm[0]) / dy)
        points[part] = np.column_stack([x[part], y[part], jet.z + on.z])
        normals[part] = unit_normal(
            jet._replace(zx=jet.zx + on.zu / dx, zy=jet.zy + on.zv / dy), nominal.side
        )
    return points, normals


def _in_part(
    correction: Correction, points: Array, normals: Array, starts: list[int], lifted: list[bool]
) -> ToolPath:
    """Return a path turned to frame `part`."""
    back = correction.nominal.surface_from_part.inverse()
    return ToolPath(
        points_mm=back.apply(points),
        normals=back.rotate(normals),
        starts=np.array(starts, dtype=np.int64),
        lifted=np.array(lifted, dtype=np.bool_),
        up=back.rotate(np.array([[0.0, 0.0, float(correction.nominal.side)]]))[0],
    )
