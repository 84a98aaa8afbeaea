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
STEEP_SHARE: Final = 0.003
"""Share of the facets that may be steep: slivers at the border of scattered points are."""
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


def _candidates(points_mm: Array) -> list[tuple[str, Array]]:
    """Return the rotations to try, each a proper one, with the name of the direction."""
    along_x = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    along_y = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    axes = np.linalg.svd(points_mm - points_mm.mean(axis=0), full_matrices=False)[2]
    normal = axes[2] * np.sign(axes[2][np.argmax(np.abs(axes[2]))])
    across = np.cross(np.eye(3)[np.argmin(np.abs(normal))], normal)
    across /= np.linalg.norm(across)
    least = np.stack([across, np.cross(normal, across), normal])
    return [("z", np.eye(3)), ("x", along_x), ("y", along_y), ("the least spread", least)]


def _steep_share(points_mm: Array) -> float:
    """Return the share of the facets over the xy plane that are steep."""
    spread = np.linalg.svd(points_mm[:, :2] - points_mm[:, :2].mean(axis=0), compute_uv=False)
    if float(spread[1]) <= 1e-9 * float(spread[0]):
        return 1.0  # a line has no facets
    triangles = delaunay_triangles(points_mm[:, 0], points_mm[:, 1])
    a, b, c = (points_mm[triangles[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    slope = np.hypot(normal[:, 0], normal[:, 1]) / np.maximum(normal[:, 2], 1e-300)
    return float(np.mean(slope > np.tan(STEEPEST_DEG * RAD_PER_DEG)))
