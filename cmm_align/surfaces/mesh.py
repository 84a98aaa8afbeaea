"""A nominal as a triangle mesh: checked to be one sheet, and a smooth surface through its vertices.

The facets are kept as the triangulation; between them and a smooth part lies their chord error, so the
deviations are taken from a spline fitted to the vertices, whose misfit is stated.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cmm_align.errors import GeometryError, MalformedInputError
from cmm_align.numerics.facet_cover import cover_of_cells
from cmm_align.pose import Pose
from cmm_align.surfaces.projection import surface_from_normals
from cmm_align.surfaces.protocol import Array, Mask
from cmm_align.surfaces.scattered import fitted_surface
from cmm_align.surfaces.spline_surface import SplineSurface

CELLS_PER_FACET: Final = 4.0
"""Cells of the mask over an average facet."""
MOST_CELLS: Final = 1024
"""Cells of the mask along the longer side: the border is followed to half of one."""
NEEDLE: Final = 1e-6
"""A facet flatter than this share of the mesh has no normal of its own: single precision made it."""
_MIX: Final = 0x9E3779B97F4A7C15

Triangles = NDArray[np.int32]


@dataclass(frozen=True, slots=True)
class TriangleMesh:
    """A triangle mesh as read.

    Attributes
    ----------
    points_mm : ndarray, shape (n, 3), mm, frame `part`
        Vertices; equal ones are one.
    triangles : ndarray of int32, shape (m, 3)
        Row numbers of `points_mm`; the way round as in the file.
    source : str
        Where it came from, for messages.
    n_degenerate : int
        Facets without area that were left out.
    """

    points_mm: Array
    triangles: Triangles
    source: str
    n_degenerate: int = 0

    @classmethod
    def of(cls, points_mm: ArrayLike, triangles: ArrayLike, source: str = "mesh") -> TriangleMesh:
        """Return a checked mesh with its vertices merged and facets without area left out.

        Parameters
        ----------
        points_mm : array_like, shape (n, 3), mm, frame `part`
        triangles : array_like of int, shape (m, 3)
        source : str

        Raises
        ------
        MalformedInputError
            If a number is not finite, a facet names a vertex that is not there, or no facet is left.
        """
        points = np.asarray(points_mm, dtype=np.float64)
        corners = np.asarray(triangles, dtype=np.int64)
        if points.ndim != 2 or points.shape[1] != 3 or corners.ndim != 2 or corners.shape[1] != 3:
            raise MalformedInputError("not a triangle mesh", where=source, expected="x, y, z and triangles")
        if len(corners) and not (corners.min() >= 0 and corners.max() < len(points)):
            raise MalformedInputError(
                f"a facet names vertex {int(corners.max())}", where=source, expected=f"0 to {len(points) - 1}"
            )
        bad = ~np.isfinite(points[corners]).all(axis=(1, 2))
        if bad.any():
            raise MalformedInputError(
                f"facet {int(np.argmax(bad)) + 1} has a vertex that is not finite",
                where=source,
                expected="finite numbers",
            )
        named = _rows_named(corners, len(points))
        merged, number = _merged(points[named] + 0.0)
        renumbered = np.zeros(len(points), dtype=np.int64)
        renumbered[named] = number
        corners = renumbered[corners]
        a, b, c = (merged[corners[:, k]] for k in range(3))
        flat = np.linalg.norm(np.cross(b - a, c - a), axis=1) == 0.0
        kept = corners[~flat]
        if not len(kept):
            raise MalformedInputError(
                f"no facet with an area ({len(corners)} in the file)", where=source, expected="triangles"
            )
        used = _rows_named(kept, len(merged))
        final = np.zeros(len(merged), dtype=np.int32)
        final[used] = np.arange(len(used), dtype=np.int32)
        vertices, facets = np.ascontiguousarray(merged[used]), np.ascontiguousarray(final[kept])
        vertices.flags.writeable = facets.flags.writeable = False
        return cls(vertices, facets, source, int(np.count_nonzero(flat)))


def _rows_named(corners: NDArray[np.int64], count: int) -> NDArray[np.intp]:
    """Return the rows, in order, that some facet names."""
    named = np.zeros(count, dtype=bool)
    named[corners] = True
    return np.flatnonzero(named)


def _merged(points_mm: Array) -> tuple[Array, NDArray[np.int64]]:
    """Return the different points in the order they come, and for every point its row among them."""
    bits = np.ascontiguousarray(points_mm).view(np.uint64)
    key = np.zeros(len(bits), dtype=np.uint64)
    for column in bits.T:  # one number for three, so that one sort is enough
        key = (key ^ (column >> np.uint64(32)) ^ column) * np.uint64(_MIX)
        key ^= key >> np.uint64(29)
    order = np.argsort(key, kind="stable")
    new = _first_of_equal(points_mm[order])
    if (new[1:] & (np.diff(key[order]) == 0)).any():  # different points under one number
        order = np.lexsort(points_mm.T)
        new = _first_of_equal(points_mm[order])
    first = order[new]
    rank = np.empty(len(first), dtype=np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    number = np.empty(len(points_mm), dtype=np.int64)
    number[order] = rank[np.cumsum(new) - 1]
    return points_mm[np.sort(first)], number


def _first_of_equal(ordered: Array) -> Mask:
    """Return which rows differ from the one before."""
    new = np.ones(len(ordered), dtype=bool)
    new[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    return new


def direction_of_mesh(mesh: TriangleMesh) -> Pose:
    """Return the rotation that turns the projection direction of a mesh to +z.

    Raises
    ------
    GeometryError
        If the mesh is in several pieces, folds, or has vertical walls under every direction tried.
    """
    _refuse_pieces(mesh)
    a, b, c = (mesh.points_mm[mesh.triangles[:, k]] for k in range(3))
    cross = np.cross(b - a, c - a)
    twice = np.linalg.norm(cross, axis=1)
    longest = np.max([np.linalg.norm(e, axis=1) for e in (b - a, c - b, a - c)], axis=0)
    size = float(np.ptp(mesh.points_mm, axis=0).max())
    firm = twice / longest > NEEDLE * size
    try:
        return surface_from_normals(((a + b + c) / 3.0)[firm], cross[firm] / twice[firm, None], "facets")
    except GeometryError as problem:
        raise GeometryError(
            problem.what, where=mesh.source, expected=problem.expected, remedy=problem.remedy
        ) from None


def mesh_surface(
    points_mm: Array, triangles: Triangles, source: str
) -> tuple[SplineSurface, Triangles, float]:
    """Return the smooth surface of a mesh that is a height field.

    Parameters
    ----------
    points_mm : ndarray, shape (n, 3), mm, frame `surface`
    triangles : ndarray of int32, shape (m, 3)
    source : str
        Name of the mesh, for messages.

    Returns
    -------
    surface : SplineSurface
        Kind ``mesh``; known where facets are, so holes stay holes.
    triangles : ndarray of int32, shape (m, 3)
        The same facets, each counter-clockwise in frame `surface`.
    misfit_pv_mm : float
        PV of the misfit at the vertices, mm.

    Raises
    ------
    GeometryError
        If two facets lie above the same place.
    """
    a, b, c = (points_mm[triangles[:, k], :2] for k in range(3))
    twice = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    turned = np.where((twice < 0.0)[:, None], triangles[:, [0, 2, 1]], triangles)
    turned = np.ascontiguousarray(turned[twice != 0.0].astype(np.int32))

    low, high = points_mm[:, :2].min(axis=0), points_mm[:, :2].max(axis=0)
    size = high - low
    area = 0.5 * float(np.abs(twice).sum())
    pitch = max(float(np.sqrt(area / (len(turned) * CELLS_PER_FACET))), float(size.max()) / MOST_CELLS)
    nx, ny = (max(8, int(np.ceil(float(s) / pitch))) for s in size)
    cell = size / (nx, ny)
    strictly, touching = cover_of_cells(points_mm[:, :2], turned, low, cell, (ny, nx))
    double = strictly > 1
    if double.any():
        iy, ix = np.argwhere(double)[0]
        x, y = low + (np.array([ix, iy]) + 0.5) * cell
        raise GeometryError(
            f"{int(strictly.max())} facets lie above one another at x = {x:.6g}, y = {y:.6g} mm (at "
            f"{100.0 * np.count_nonzero(double) / np.count_nonzero(touching):.2g} % of the places)",
            where=source,
            expected="one sheet",
            remedy="cut the mesh into sheets and align them one by one",
        )
    surface, misfit = fitted_surface(points_mm, "mesh")
    return replace(surface, cells=touching > 0), turned, misfit


def _refuse_pieces(mesh: TriangleMesh) -> None:
    """Refuse a mesh whose facets do not hang together."""
    from scipy.sparse import coo_array  # slow to import, and only meshes need it
    from scipy.sparse.csgraph import connected_components

    first, second = mesh.triangles[:, [0, 1]].T, mesh.triangles[:, [1, 2]].T
    rows, columns = np.concatenate([first[0], second[0]]), np.concatenate([first[1], second[1]])
    n = len(mesh.points_mm)
    count, piece = connected_components(
        coo_array((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(n, n)), directed=False
    )
    if count == 1:
        return
    sizes = np.bincount(piece[mesh.triangles[:, 0]], minlength=count)
    order = np.argsort(-sizes)
    second_at = mesh.points_mm[int(np.argmax(piece == order[1]))]
    named = ", ".join(str(int(s)) for s in sizes[order][:4]) + (", ..." if count > 4 else "")
    raise GeometryError(
        f"the mesh is in {count} pieces ({named} facets; one holds x = {second_at[0]:.6g}, "
        f"y = {second_at[1]:.6g}, z = {second_at[2]:.6g} mm)",
        where=mesh.source,
        expected="one sheet that hangs together",
        remedy="keep one piece, or join its vertices where the mesh was made",
    )
