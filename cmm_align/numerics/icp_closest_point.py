"""The classical iterative closest point on the vertices of a surface, point to point and point to plane.

Point to point pairs every point with its nearest vertex and moves the cloud as a whole onto its partners, in
closed form. Vertices hold the cloud back along the surface: it creeps, and may come to rest millimetres off.
What is left of a perfect fit is the distance to the next vertex, ``h / sqrt(6)`` RMS on a square net of
step h. Point to plane measures to the tangent plane of the nearest vertex instead: off by ``k rho^2 / 2`` at
a distance rho from it, k the curvature.

Sources: Besl and McKay 1992, doi 10.1109/34.121791; Chen and Medioni 1992, doi 10.1016/0262-8856(92)90066-C;
the rotation in closed form: Kabsch 1976, doi 10.1107/S0567739476001873.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmm_align.numerics.foot_point import Feet
from cmm_align.numerics.linearisation import Measure, Placement, moved
from cmm_align.numerics.rotations import orthonormalised

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


class IcpResult(NamedTuple):
    """How the iteration ended."""

    placement: Placement
    iterations: int
    stop_reason: str
    converged: bool
    costs_mm2: tuple[float, ...]
    """Mean squared distance to the partner before each step and after the last, mm^2."""


def point_to_point(
    points_mm: Array, vertices: cKDTree, start: Placement, max_iterations: int, used: Mask
) -> IcpResult:
    """Lay points on vertices, each on its nearest one, until no point changes its partner.

    Parameters
    ----------
    points_mm : ndarray, shape (n, 3), mm
        Measured points about their centroid.
    vertices : cKDTree
        Of the vertices of the surface, mm, in the frame of `start`.
    start : Placement
    max_iterations : int
    used : ndarray of bool, shape (n,)
        Points that count.

    Returns
    -------
    IcpResult
        Partners that stay the same are a fixed point: further steps would change nothing at all.
    """
    points = points_mm[used]
    target = np.asarray(vertices.data)
    placement, partner = start, np.full(len(points), -1)
    costs: list[float] = []
    while True:
        distance, nearest = vertices.query(moved(points, placement), workers=-1)
        costs.append(float(np.mean(np.asarray(distance) ** 2)))
        if np.array_equal(nearest, partner):
            return IcpResult(placement, len(costs) - 1, "partners unchanged", True, tuple(costs))
        if len(costs) > max_iterations:
            return IcpResult(placement, len(costs) - 1, "max iterations", False, tuple(costs))
        partner = np.asarray(nearest)
        placement = best_motion(points, target[partner])


def best_motion(points_mm: Array, partners_mm: Array) -> Placement:
    """Return the placement that brings points nearest to their partners, in the mean square.

    Parameters
    ----------
    points_mm, partners_mm : ndarray, shape (n, 3), mm

    Returns
    -------
    Placement
        Proper always: the mirror image that a flat or noisy cloud may suggest is turned down.
    """
    from_centre, to_centre = points_mm.mean(axis=0), partners_mm.mean(axis=0)
    rotation = orthonormalised((partners_mm - to_centre).T @ (points_mm - from_centre))
    return Placement(rotation, to_centre - rotation @ from_centre)


def tangent_plane_measure(vertices: cKDTree, normals: Array) -> Measure:
    """Return the distance to the tangent plane of the nearest vertex.

    Parameters
    ----------
    vertices : cKDTree
        Of the vertices of the surface, mm.
    normals : ndarray, shape (m, 3)
        Unit normals there, towards the probe.
    """
    target = np.asarray(vertices.data)

    def measure(points_mm: Array, previous: Feet | None) -> tuple[Feet, Mask]:
        del previous
        nearest = np.asarray(vertices.query(points_mm)[1])
        normal = normals[nearest]
        distance = np.einsum("ij,ij->i", normal, points_mm - target[nearest])
        x, y = target[nearest, 0], target[nearest, 1]
        return Feet(x, y, distance, normal), np.ones(len(points_mm), dtype=np.bool_)

    return Measure(measure)
