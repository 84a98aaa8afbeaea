"""The equidistant surface: one tip radius out from the nominal, where the centre of the ball runs.

``S_r = { s + r n(s) }``. It is regular where ``1 - r k > 0`` for the curvature towards the probe; past that
the ball does not fit (Farouki and Neff 1990, doi 10.1016/0167-8396(90)90021-E).
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmm_align.numerics.foot_point import Limits, foot_points
from cmm_align.numerics.triangle_net import grid_triangles
from cmm_align.surfaces.geometry import (
    gaussian_curvature_per_mm2,
    principal_curvatures,
    slope,
    unit_normal,
)
from cmm_align.surfaces.protocol import Array, Jet, Mask, Surface
from cmm_align.surfaces.triangulation import delaunay_triangles

MARGIN: Final = 0.005
"""Feet may leave the rectangle of a surface by this share of its diagonal, to be told apart there."""

_CHUNK: Final = 16384
_SAMPLE: Final = 12_000
_SLIVER: Final = 4.0


class Nodes(NamedTuple):
    """Nodes of a nominal with what is derived there, frame `surface`."""

    points_mm: Array
    """Shape (n, 3), mm."""
    normals: Array
    """Unit normals towards the probe, shape (n, 3)."""
    slope: Array
    gaussian_curvature_per_mm2: Array
    concave_per_mm: Array
    """Largest curvature towards the probe, shape (n,), 1/mm; negative where convex everywhere."""
    least_per_mm: Array
    """The other principal curvature, shape (n,), 1/mm."""
    triangles: NDArray[np.int32]


def limits_of(surface: Surface) -> Limits:
    """Return the rectangle that feet may move in, mm."""
    b = surface.bounds
    m = MARGIN * b.diagonal_mm
    return b.x_min - m, b.x_max + m, b.y_min - m, b.y_max + m


def grid_nodes(surface: Surface, side: int, x_mm: Array, y_mm: Array, known: Mask) -> Nodes:
    """Return nodes on a grid; the triangulation is known from its topology.

    Parameters
    ----------
    surface : Surface
    side : int
    x_mm, y_mm : ndarray, shape (nx,), (ny,), mm
    known : ndarray of bool, shape (ny, nx)
        Which nodes of the grid exist.
    """
    px, py = np.meshgrid(x_mm, y_mm)
    return _nodes(surface, side, px[known], py[known], grid_triangles(known))


def scattered_nodes(
    surface: Surface, side: int, x_mm: Array, y_mm: Array, triangles: NDArray[np.int32] | None = None
) -> Nodes:
    """Return nodes at scattered places of shape (n,), with their triangles or, without, Delaunay's."""
    net = delaunay_triangles(x_mm, y_mm) if triangles is None else triangles
    return _nodes(surface, side, x_mm, y_mm, net)


def _nodes(surface: Surface, side: int, x: Array, y: Array, triangles: NDArray[np.int32]) -> Nodes:
    """Evaluate the surface at the nodes, chunk by chunk."""
    n = len(x)
    points, normals = np.empty((n, 3)), np.empty((n, 3))
    slopes, gauss, concave, least = (np.empty(n) for _ in range(4))
    for start in range(0, n, _CHUNK):
        part = slice(start, start + _CHUNK)
        jet: Jet = surface.jet(x[part], y[part])
        points[part] = np.stack([x[part], y[part], jet.z], axis=1)
        normals[part] = unit_normal(jet, side)
        slopes[part] = slope(jet)
        gauss[part] = gaussian_curvature_per_mm2(jet)
        least[part], concave[part] = principal_curvatures(jet, side)
    return Nodes(points, normals, slopes, gauss, concave, least, triangles)


def facet_error_pv_mm(surface: Surface, side: int, radius_mm: float, nodes: Nodes) -> float:
    """Measure how far the facets of the equidistant surface lie from it, PV, mm.

    At the centroids and the middles of the edges of a sample of facets; the vertices count as zero. For a
    facet of a grid of step h on curvature k the largest is ``h^2 k / 4`` (middle of the diagonal of a
    square cell on a sphere), which the tests check. Slivers along the hull of scattered points span gaps
    instead of surface and are left out.
    """
    pick = _without_slivers(nodes, nodes.triangles[:: max(1, len(nodes.triangles) // _SAMPLE)])
    offset = nodes.points_mm + radius_mm * nodes.normals
    a, b, c = (offset[pick[:, k]] for k in range(3))
    places = np.concatenate([(a + b + c) / 3.0, (a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0])
    base = places - radius_mm * _mean_normals(nodes, pick)
    feet = foot_points(surface.jet, side, places, base[:, 0], base[:, 1], limits_of(surface))
    error = feet.distance_mm - radius_mm
    error = error[np.isfinite(error)]
    return float(max(error.max(initial=0.0), 0.0) - min(error.min(initial=0.0), 0.0))


def _without_slivers(nodes: Nodes, triangles: NDArray[np.int32]) -> NDArray[np.int32]:
    """Leave out facets with an edge far longer than most facets have."""
    x, y = nodes.points_mm[:, 0][triangles], nodes.points_mm[:, 1][triangles]
    longest = np.hypot(x - np.roll(x, 1, axis=1), y - np.roll(y, 1, axis=1)).max(axis=1)
    kept: NDArray[np.int32] = triangles[longest <= _SLIVER * float(np.median(longest))]
    return kept


def _mean_normals(nodes: Nodes, triangles: NDArray[np.int32]) -> Array:
    """Return a normal for each sampled place of `facet_error_pv_mm`."""
    a, b, c = (nodes.normals[triangles[:, k]] for k in range(3))
    return np.concatenate([(a + b + c) / 3.0, (a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0])
