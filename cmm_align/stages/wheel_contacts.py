"""Where a wheel at a given centre touches the surface that is told.

With the contact at u = (x, y), the centre is ``C = P(u) + c(n(u))``, c as in `numerics.wheel`. Given C the
contact is the root of ``F(u) = [C - c(n(u))]_xy - u``: one step of Newton from where it was recovered to, its
derivative by differences. What is left of F moves the contact along the surface, and its depth by
``F^2 / 2 R`` only.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from cmm_align.numerics.wheel import Wheel, centre_from_contact
from cmm_align.pose import Pose
from cmm_align.stages.told_surface import ToldSurface
from cmm_align.surfaces.protocol import Array

DEPTH_MM: Final = 2e-8
"""What may be left along the normal."""
_STEP_MM: Final = 1e-3
_ROUNDS: Final = 3
_FLATTEST: Final = 1e-3
"""Least determinant of the derivative: below it the wheel fills the surface."""


def touching(
    told: ToldSurface, near_mm: Array, centres_mm: Array, wheel: Wheel, surface_from_file: Pose
) -> Array:
    """Return where the wheel would touch, below each centre along the normal of the told surface.

    Parameters
    ----------
    told : ToldSurface
    near_mm : ndarray, shape (n, 3), mm, frame of the file
        Contacts as they were recovered; those that are not over the grid stay as they are.
    centres_mm : ndarray, shape (n, 3), mm, frame of the file
    wheel : Wheel
        Axis in the frame of the file.
    surface_from_file : Pose

    Returns
    -------
    ndarray, shape (n, 3), mm, frame `surface`
        ``C - c(n)``: on the told surface if the centre is right, deeper or higher by what it is wrong.
    """
    centres, points = surface_from_file.apply(centres_mm), surface_from_file.apply(near_mm).copy()
    file_from_surface = surface_from_file.inverse()

    def below(which: NDArray[np.intp], u: Array) -> Array:
        normals = file_from_surface.rotate(told.normals_at(u[:, 0], u[:, 1]))
        return np.asarray(centres[which] - surface_from_file.rotate(centre_from_contact(wheel, normals)))

    left = np.flatnonzero(told.reaches(points[:, 0], points[:, 1]))
    u = points[left, :2].copy()
    for _ in range(_ROUNDS):
        found = below(left, u)
        points[left] = found
        miss = found[:, :2] - u
        far = np.einsum("ni,ni->n", miss, miss) > 2.0 * wheel.radius_mm * DEPTH_MM
        if not far.any():
            break
        left, u, miss, found = left[far], u[far], miss[far], found[far]
        along_x, along_y = (
            (below(left, u + _STEP_MM * axis)[:, :2] - found[:, :2]) / _STEP_MM for axis in np.eye(2)
        )
        a, b, c, d = along_x[:, 0] - 1.0, along_y[:, 0], along_x[:, 1], along_y[:, 1] - 1.0
        determinant = a * d - b * c
        determinant = np.where(np.abs(determinant) < _FLATTEST, np.inf, determinant)
        u = (
            u
            - np.column_stack([d * miss[:, 0] - b * miss[:, 1], a * miss[:, 1] - c * miss[:, 0]])
            / (determinant[:, None])
        )
        on = told.reaches(u[:, 0], u[:, 1])
        left, u = left[on], u[on]
    return points
