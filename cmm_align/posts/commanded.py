"""What a machine is told, as points: made from a correction, or read back from a file."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cmm_align.model import Correction
from cmm_align.surfaces.protocol import Array


@dataclass(frozen=True, slots=True)
class CommandedPoints:
    """Points of a surface to grind.

    Attributes
    ----------
    points_mm : ndarray, shape (n, 3), mm, frame `frame`
        Contact points: as they stand in a file, or recovered from its tool centres.
    normals : ndarray, shape (n, 3), frame `frame`, or None
        Unit normals out of the material; None where the file holds none and none can be recovered.
    tool_centres_mm : ndarray, shape (n, 3), mm, frame `frame`, or None
        As they stand in a file that states them.
    frame : str
        ``part``, or ``surface`` for files that are grids over the plane of projection.
    accuracy_mm : float
        Standard limit of error of `points_mm` along the normal: rounding, and what recovering costs.
    """

    points_mm: Array
    normals: Array | None
    tool_centres_mm: Array | None
    frame: str
    accuracy_mm: float


def points_and_normals(correction: Correction) -> tuple[Array, Array]:
    """Return the commanded surface in frame `part`, row by row, nodes outside the aperture left out.

    Returns
    -------
    points_mm : ndarray, shape (n, 3), mm
    normals : ndarray, shape (n, 3)
        Unit normals of the commanded surface.
    """
    x, y = np.meshgrid(correction.x_mm, correction.y_mm)
    inside = np.isfinite(correction.commanded_z_mm)
    points = np.column_stack([x[inside], y[inside], correction.commanded_z_mm[inside]])
    part_from_surface = correction.nominal.surface_from_part.inverse()
    return part_from_surface.apply(points), part_from_surface.rotate(correction.commanded_normal[inside])
