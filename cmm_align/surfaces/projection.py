"""The direction over which a nominal is a height field, found from its points.

Tried in turn: z, x, y (which keep grids), the direction of least spread. A surface that folds back under
all of them, such as more than half a sphere, cannot be handled and is refused.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from cmm_align.errors import GeometryError
from cmm_align.pose import Pose
from cmm_align.surfaces.protocol import Array
from cmm_align.surfaces.triangulation import delaunay_triangles
from cmm_align.units import RAD_PER_DEG

STEEPEST_DEG: Final = 85.0
"""Facets steeper than this are walls or folds."""
STEEP_DEG: Final = 60.0
"""A direction that leaves slopes over this is taken only if no other one is better."""
STEEP_SHARE: Final = 0.003
"""Share of the projected area that may be steep: noise makes a few facets so."""
_SAMPLE: Final = 20_000


def surface_from_part(points_mm: Array) -> Pose:
    """Return the rotation that turns the projection direction to +z.

    Parameters
    ----------
    points_mm : ndarray, shape (n, 3), mm, frame `part`

    Raises
    ------
    GeometryError
        If the points are a height field over none of the planes tried.
    """
    sample = points_mm[:: max(1, len(points_mm) // _SAMPLE)]
    tried = []
    for name, rotation in _candidates(sample):
        share = _steep_share(sample @ rotation.T)
        if share <= STEEP_SHARE:
            return Pose(rotation, np.zeros(3), "surface", "part")
        tried.append(f"{name}: {100.0 * share:.2g} %")
    raise GeometryError(
        f"the nominal is no height field (facets over {STEEPEST_DEG:g} degrees, along {', '.join(tried)})",
        expected="a surface that some direction meets once only",
        remedy="cut the surface into sheets and align them one by one",
    )


def surface_from_normals(points_mm: Array, normals: Array, words: str = "places") -> Pose:
    """Return the rotation that turns the projection direction to +z, from unit normals of the surface.

    Tried as for points, and the mean of the normals. The first direction that leaves no slope over
    `STEEP_DEG` is taken, else the one with the least. All normals must come to lie on one side.

    Parameters
    ----------
    points_mm : ndarray, shape (n, 3), mm, frame `part`
        Where the normals are.
    normals : ndarray, shape (n, 3), frame `part`
    words : str
        What the places are called in a message.

    Raises
    ------
    GeometryError
        If some normals turn away from all directions tried; with the number and the first of them.
    """
    mean = normals.mean(axis=0)
    tries = _candidates(points_mm[:: max(1, len(points_mm) // _SAMPLE)])
    length = float(np.linalg.norm(mean))
    if length > 1e-3:
        tries.append(("the mean normal", _turned_to_z(mean / length)))
    upright, steep = (float(np.cos(angle * RAD_PER_DEG)) for angle in (STEEPEST_DEG, STEEP_DEG))
    cosines = [normals @ rotation[2] for _, rotation in tries]
    cosines = [c if float(np.median(c)) >= 0.0 else -c for c in cosines]
    least = [float(c.min()) for c in cosines]
    good = [k for k, c in enumerate(least) if c >= steep] or [int(np.argmax(least))]
    if least[good[0]] >= upright:
        return Pose(tries[good[0]][1], np.zeros(3), "surface", "part")
    counts = [int(np.count_nonzero(c < upright)) for c in cosines]
    best = int(np.argmin(counts))
    count, name, first = counts[best], tries[best][0], int(np.argmin(cosines[best]))
    back = least[best] < -upright
    x, y, z = points_mm[first]
    raise GeometryError(
        f"the nominal is no height field: seen along {name}, {count} of {len(normals)} {words} stand upright "
        f"or face the other way; one {'folds back' if back else 'is a vertical wall'} at x = {x:.6g}, "
        f"y = {y:.6g}, z = {z:.6g} mm",
        expected="a surface that some direction meets once only",
        remedy="cut the surface into sheets and align them one by one",
    )


def _turned_to_z(direction: Array) -> Array:
    """Return a rotation that turns a unit vector to z."""
    across = np.cross(np.eye(3)[np.argmin(np.abs(direction))], direction)
    across /= np.linalg.norm(across)
    return np.stack([across, np.cross(direction, across), direction])


def _candidates(points_mm: Array) -> list[tuple[str, Array]]:
    """Return the rotations to try, each a proper one, with the name of the direction."""
    along_x = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    along_y = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    axes = np.linalg.svd(points_mm - points_mm.mean(axis=0), full_matrices=False)[2]
    normal = axes[2] * np.sign(axes[2][np.argmax(np.abs(axes[2]))])
    return [("z", np.eye(3)), ("x", along_x), ("y", along_y), ("the least spread", _turned_to_z(normal))]


def _steep_share(points_mm: Array) -> float:
    """Return the share of the area over the xy plane that steep facets cover."""
    spread = np.linalg.svd(points_mm[:, :2] - points_mm[:, :2].mean(axis=0), compute_uv=False)
    if float(spread[1]) <= 1e-9 * float(spread[0]):
        return 1.0  # a line has no facets
    triangles = delaunay_triangles(points_mm[:, 0], points_mm[:, 1])
    a, b, c = (points_mm[triangles[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    slope = np.hypot(normal[:, 0], normal[:, 1]) / np.maximum(normal[:, 2], 1e-300)
    steep = slope > np.tan(STEEPEST_DEG * RAD_PER_DEG)
    area = normal[:, 2]  # slivers at the border are steep too, but hardly cover anything
    return float(area[steep].sum() / area.sum())
