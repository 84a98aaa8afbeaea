"""Triangulated surfaces over a plane: topology, point location by walking, distance to the facet.

The paper's method: find the triangle of the projection that holds a point, and measure to the plane of
the three vertices. Location walks from triangle to neighbour towards the point, all points at once,
from a start that buckets (or the last iteration) give, so it needs no search tree.
Source: Devillers, Pion, Teillaud, "Walking in a triangulation", 2002, doi 10.1142/S0129054102001047.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int32]
Mask = NDArray[np.bool_]

_INSIDE: Final = -1e-12
"""Area coordinates above this (relative) count as inside: a vertex belongs to its triangles."""


class TriangleNet(NamedTuple):
    """A triangulation of a height field, ready for location."""

    points_mm: Array
    """Vertices, shape (n, 3), mm, frame `surface`."""
    triangles: Index
    """Vertices of each triangle, counter-clockwise in the projection, shape (m, 3)."""
    neighbours: Index
    """Triangle across the edge opposite each vertex, -1 at the border, shape (m, 3)."""
    bucket: Index
    """A triangle near the middle of each bucket, shape (ny, nx)."""
    x0_mm: float
    y0_mm: float
    pitch_mm: float


def grid_triangles(known: Mask) -> Index:
    """Return the triangulation of a grid from its topology, without any search.

    Parameters
    ----------
    known : ndarray of bool, shape (ny, nx)
        Which nodes exist.

    Returns
    -------
    ndarray of int32, shape (m, 3)
        Indices into the existing nodes in row order. A cell with four nodes gives two triangles, one
        with three gives one; counter-clockwise where x grows along the second axis and y along the first.
    """
    number = np.full(known.shape, -1, dtype=np.int32)
    number[known] = np.arange(np.count_nonzero(known), dtype=np.int32)
    a, b = number[:-1, :-1].ravel(), number[:-1, 1:].ravel()
    d, c = number[1:, :-1].ravel(), number[1:, 1:].ravel()
    has = np.stack([a, b, c, d]) >= 0
    count = has.sum(axis=0)
    full = count == 4
    parts = [np.stack([a, b, c], axis=1)[full], np.stack([a, c, d], axis=1)[full]]
    for missing, corners in enumerate(((b, c, d), (a, c, d), (a, b, d), (a, b, c))):
        lone = (count == 3) & ~has[missing]
        parts.append(np.stack(corners, axis=1)[lone])
    whole = np.stack(parts[:2], axis=1).reshape(-1, 3)  # the two halves of a cell side by side
    return np.ascontiguousarray(np.concatenate([whole, *parts[2:]]).astype(np.int32))


def triangle_net(points_mm: Array, triangles: Index) -> TriangleNet:
    """Return a net ready for location.

    Parameters
    ----------
    points_mm : ndarray, shape (n, 3), mm, frame `surface`
    triangles : ndarray of int32, shape (m, 3)
    """
    m = len(triangles)
    first, second = triangles[:, [1, 2, 0]].ravel(), triangles[:, [2, 0, 1]].ravel()
    key = np.minimum(first, second).astype(np.int64) * len(points_mm) + np.maximum(first, second)
    order = np.argsort(key, kind="stable")
    pairs = np.flatnonzero(key[order][1:] == key[order][:-1])
    one, other = order[pairs], order[pairs + 1]
    neighbours = np.full(3 * m, -1, dtype=np.int32)
    neighbours[one] = other // 3
    neighbours[other] = one // 3
    low, high = points_mm[:, :2].min(axis=0), points_mm[:, :2].max(axis=0)
    pitch = float(np.sqrt(max(np.prod(high - low), 1e-300) / max(m / 4, 1.0)))
    shape = tuple(int(n) + 1 for n in ((high - low) / pitch)[::-1])
    centre = points_mm[:, :2][triangles].mean(axis=1)
    cell = ((centre - low) / pitch).astype(np.intp)
    bucket = np.full(shape, -1, dtype=np.int32)
    bucket[cell[:, 1], cell[:, 0]] = np.arange(m, dtype=np.int32)
    return TriangleNet(
        points_mm,
        triangles,
        neighbours.reshape(m, 3),
        _filled(bucket),
        float(low[0]),
        float(low[1]),
        pitch,
    )


def _filled(bucket: Index) -> Index:
    """Give every empty bucket the triangle of a neighbouring one."""
    while (bucket < 0).any():
        for axis in (0, 1):
            for step in (1, -1):
                moved = np.roll(bucket, step, axis=axis)
                edge = 0 if step == 1 else -1
                np.moveaxis(moved, axis, 0)[edge] = -1
                bucket = np.where(bucket < 0, moved, bucket)
    return bucket


def locate(net: TriangleNet, x_mm: Array, y_mm: Array, start: Index | None = None) -> tuple[Index, Mask]:
    """Return the triangle of the projection that holds each place.

    Parameters
    ----------
    net : TriangleNet
    x_mm, y_mm : ndarray, shape (n,), mm
    start : ndarray of int32, shape (n,), optional
        Triangles to walk from, such as those of the last iteration.

    Returns
    -------
    triangle : ndarray of int32, shape (n,)
        Outside the net, a border triangle that faces the place: its plane continues the surface.
    inside : ndarray of bool, shape (n,)
    """
    if start is None:
        ny, nx = net.bucket.shape
        ix = np.clip((x_mm - net.x0_mm) / net.pitch_mm, 0, nx - 1).astype(np.intp)
        iy = np.clip((y_mm - net.y0_mm) / net.pitch_mm, 0, ny - 1).astype(np.intp)
        start = net.bucket[iy, ix]
    current = start.copy()
    inside = np.zeros(len(current), dtype=bool)
    walking = np.arange(len(current))
    flat_x, flat_y = net.points_mm[:, 0], net.points_mm[:, 1]
    for _ in range(net.bucket.shape[0] + net.bucket.shape[1] + 1000):
        if not len(walking):
            break
        tri = current[walking]
        corners = net.triangles[tri]
        dx = flat_x[corners] - x_mm[walking, None]
        dy = flat_y[corners] - y_mm[walking, None]
        # Twice the area of the triangle (place, next, after next): negative = beyond that edge.
        area = dx[:, [1, 2, 0]] * dy[:, [2, 0, 1]] - dx[:, [2, 0, 1]] * dy[:, [1, 2, 0]]
        beyond = area < _INSIDE * np.abs(area).max(axis=1, keepdims=True)
        there = ~beyond.any(axis=1)
        inside[walking[there]] = True
        next_triangle = net.neighbours[tri]
        open_edge = beyond & (next_triangle >= 0)
        pick = np.argmin(np.where(open_edge, area, np.inf), axis=1)
        moving = open_edge.any(axis=1)
        current[walking[moving]] = next_triangle[moving, pick[moving]]
        walking = walking[moving]
    return current, inside


def facet_distance(net: TriangleNet, points_mm: Array, triangle: Index) -> tuple[Array, Array]:
    """Return the signed distance to the plane of a facet, and its normal.

    Parameters
    ----------
    net : TriangleNet
    points_mm : ndarray, shape (n, 3), mm, frame `surface`
    triangle : ndarray of int32, shape (n,)

    Returns
    -------
    distance_mm : ndarray, shape (n,), mm
        ``n . (P - S2)``, positive on the +z side.
    normal : ndarray, shape (n, 3)
        ``(S2 - S1) x (S3 - S1)``, normalised, upwards.
    """
    s1, s2, s3 = (net.points_mm[net.triangles[triangle, k]] for k in range(3))
    normal = np.cross(s2 - s1, s3 - s1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    distance: Array = np.einsum("ij,ij->i", normal, points_mm - s2)
    return distance, normal
