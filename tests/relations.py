"""Changes of the input after which the answer is known from the answer before."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cmm_align.pose import Pose, rotation_from_vector

Array = NDArray[np.float64]


def motion(
    rng: np.random.Generator,
    *,
    angle_rad: float,
    shift_mm: float,
    target: str = "machine",
    source: str = "machine",
) -> Pose:
    """Return a motion of the given size in a random direction."""
    axis, way = rng.normal(size=(2, 3))
    return Pose(
        rotation_from_vector(axis / np.linalg.norm(axis) * angle_rad),
        way / np.linalg.norm(way) * shift_mm,
        target,
        source,
    )


def permuted(points: Array, rng: np.random.Generator) -> tuple[Array, NDArray[np.intp]]:
    """Return the points in random order, and that order."""
    order = rng.permutation(len(points))
    return points[order], order
