"""The order in which a tool goes over a surface: lines to and fro, or a spiral.

Moves are straight, so points lie near enough that their chords leave the path by 0.1 um at most (`chord_um`):
ground freeforms show the facets of programs that are coarser. A raster takes every m-th line and node of the
grid, m as large as spacings and chords allow; where the nodes themselves are too far apart, and on a spiral
(Archimedes, equal steps along the arc), the height between them is that of the nominal plus a spline of
degree five through what the nodes are commanded more than it, and the normal is that of the sum (`between`).

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
from cmm_align.numerics.wheel import Wheel, centre_from_contact
from cmm_align.posts.between import commanded_between, inside_known
from cmm_align.surfaces.protocol import Array
from cmm_align.units import UM_PER_MM

MOST_POINTS: Final = 20_000_000


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


def raster(correction: Correction, config: ExportConfig, wheel: Wheel | None = None) -> ToolPath:
    """Return lines to and fro over the lines of the grid.

    Parameters
    ----------
    correction : Correction
    config : ExportConfig
    wheel : Wheel, optional
        Whose centre moves straight from point to point; without it the contact does.

    Raises
    ------
    UsageError
        If the direction is none.
    """
    if config.raster_along not in RASTERS:
        raise UsageError(f"a raster along {config.raster_along!r}", expected=" or ".join(RASTERS))
    along_x = config.raster_along == "x"
    nodes = (correction.y_mm, correction.x_mm) if along_x else (correction.x_mm, correction.y_mm)
    step = float(nodes[1][1] - nodes[1][0])
    widest = min(config.point_spacing_mm or step, finest_mm(correction, config, wheel)[0 if along_x else 1])
    parts = max(1, int(np.ceil(step / widest * (1.0 - 1e-9))))
    across, along = _every(nodes[0], config.line_spacing_mm), _every(nodes[1], widest)
    if parts > 1:
        taken, places_mm = _divided(correction, along_x, across, parts)
    else:
        inside = np.isfinite(correction.commanded_z_mm)
        taken, places_mm = (inside if along_x else inside.T)[np.ix_(across, along)], nodes[1][along]
    lines, places, starts = [], [], []
    count, back = 0, False
    for k in range(len(across)):
        runs = _runs(taken[k])
        for first, last in reversed(runs) if back else runs:
            line = np.arange(last, first - 1, -1) if back else np.arange(first, last + 1)
            lines.append(np.full(len(line), across[k]))
            places.append(line)
            starts.append(count)
            count += len(line)
        back = not back if runs else back
    row, column = np.concatenate(lines), np.concatenate(places)
    if parts > 1:
        x, y = (places_mm[column], nodes[0][row]) if along_x else (nodes[0][row], places_mm[column])
        points, normals = commanded_between(correction, x, y)
    else:
        iy, ix = (row, along[column]) if along_x else (along[column], row)
        z = correction.commanded_z_mm[iy, ix]
        points = np.column_stack([correction.x_mm[ix], correction.y_mm[iy], z])
        normals = correction.commanded_normal[iy, ix]
    # The way to the next line is a chord: short, or the tool is lifted.
    way = np.linalg.norm(np.diff(points, axis=0), axis=1)[np.array(starts[1:], dtype=np.intp) - 1]
    apart = float(np.diff(nodes[0][across]).max(initial=0.0))
    steep = 1.0 / np.abs(normals[starts[1:], 2])
    return _in_part(correction, points, normals, starts, [True, *(way > 1.5 * apart * steep)])


def spiral(correction: Correction, config: ExportConfig, wheel: Wheel | None = None) -> ToolPath:
    """Return a spiral about the middle of the aperture, with the spacings of the settings.

    Parameters
    ----------
    correction : Correction
    config : ExportConfig
    wheel : Wheel, optional
        As for `raster`.

    Raises
    ------
    UsageError
        If the direction is none, or the spiral has too many points.
    """
    if config.spiral_direction not in SPIRALS:
        raise UsageError(f"a spiral {config.spiral_direction!r}", expected=" or ".join(SPIRALS))
    step = min(float(nodes[1] - nodes[0]) for nodes in (correction.x_mm, correction.y_mm))
    widest = min(config.point_spacing_mm or step, *finest_mm(correction, config, wheel))
    u, v = _archimedean(correction, config.line_spacing_mm or step, widest)
    known = np.isfinite(correction.commanded_z_mm)
    inside = inside_known(correction.x_mm, correction.y_mm, known, u, v)
    if config.spiral_direction == "inwards":
        u, v, inside = u[::-1].copy(), v[::-1].copy(), inside[::-1]
    runs = _runs(inside)
    if not runs:
        raise UsageError("no point of the spiral lies on the part", remedy="take a smaller line spacing")
    kept = np.concatenate([np.arange(first, last + 1) for first, last in runs])
    starts = np.concatenate([[0], np.cumsum([last - first + 1 for first, last in runs])[:-1]])
    points, normals = commanded_between(correction, u[kept], v[kept])
    return _in_part(correction, points, normals, starts.tolist(), [True] * len(runs))


def _divided(
    correction: Correction, along_x: bool, across: NDArray[np.intp], parts: int
) -> tuple[NDArray[np.bool_], Array]:
    """Return which places of the lines lie between known nodes, and the places along them, mm."""
    nodes = correction.x_mm if along_x else correction.y_mm
    places = np.interp(np.arange((len(nodes) - 1) * parts + 1) / parts, np.arange(len(nodes)), nodes)
    inside = np.isfinite(correction.commanded_z_mm)
    lines = (inside if along_x else inside.T)[across]
    number = np.arange(len(places))
    return lines[:, number // parts] & lines[:, -(-number // parts)], places


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


def finest_mm(correction: Correction, config: ExportConfig, wheel: Wheel | None) -> tuple[float, float]:
    """Return the widest steps along x and y whose chords stay within the tolerance of the settings.

    The path of the tool's centre (of the contact where there is no wheel) is curved; straight moves over a
    step h leave it by h^2 times its second difference over 8.
    """
    z, n = correction.commanded_z_mm, correction.commanded_normal
    shape = z.shape
    x, y = np.meshgrid(correction.x_mm, correction.y_mm)
    centres = np.stack([x, y, z], axis=-1)
    if wheel is not None:
        turn = correction.nominal.surface_from_part
        axis = turn.rotate(np.array([wheel.axis]))[0].tolist()
        off = centre_from_contact(Wheel(wheel.radius_mm, wheel.tip_radius_mm, tuple(axis)), n.reshape(-1, 3))
        centres = centres + off.reshape(*shape, 3)
    found = []
    for axis_number, nodes in ((1, correction.x_mm), (0, correction.y_mm)):
        second = np.diff(centres, 2, axis=axis_number)
        middle = n[:, 1:-1] if axis_number == 1 else n[1:-1]
        bow = np.abs(np.einsum("ijk,ijk->ij", second, middle)) / 8.0
        largest = float(np.nanmax(bow, initial=0.0)) * UM_PER_MM
        step = float(nodes[1] - nodes[0])
        found.append(step * np.sqrt(config.chord_um / largest) if largest > 0.0 else np.inf)
    return float(found[0]), float(found[1])


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
