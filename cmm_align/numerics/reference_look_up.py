"""Distance to a surface after a vertical look-up, minus the tip radius: simple, and wrong on slopes.

The surface straight below the centre of a ball is not where the ball touches: on a slope theta it lies
``r tan(theta)`` along the surface from there. The tangent plane there misses the ball by
``k r^2 tan(theta)^2 / 2``, k the curvature along the slope: nothing on a plane, 13 um for r = 1.5 mm on a
radius of 86 mm at 45 degrees. Source: method of Xiong et al. as told in Photonics 2025, 12(5), 469,
doi 10.3390/photonics12050469, section 1.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cmm_align.numerics.foot_point import Feet, JetFunction, Limits
from cmm_align.numerics.linearisation import Measure

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def look_up_measure(jet: JetFunction, side: int, radius_mm: float, limits: Limits) -> Measure:
    """Return the distance along the normal at the place straight below a point, minus the radius.

    Parameters
    ----------
    jet : callable
        Height and derivatives of the nominal at places (x, y), mm.
    side : int
        +1 or -1, the probe's side.
    radius_mm : float
        Tip radius, mm; 0 for contact points.
    limits : tuple of float
        Past these the surface is continued by its tangent planes, mm.

    Notes
    -----
    With ``h = Z - s(X, Y)`` the distance is ``h n_z - r``. `Feet.normal` carries its exact gradient, which
    turns with the place of look-up and is not quite the normal, so that a fit finds the true least squares.
    """
    x_min, x_max, y_min, y_max = limits

    def measure(points_mm: Array, previous: Feet | None) -> tuple[Feet, Mask]:
        del previous
        px, py = points_mm[:, 0], points_mm[:, 1]
        x, y = np.clip(px, x_min, x_max), np.clip(py, y_min, y_max)
        j = jet(x, y)
        nz = side / np.sqrt(1.0 + j.zx**2 + j.zy**2)
        gap = points_mm[:, 2] - j.z - j.zx * (px - x) - j.zy * (py - y)
        turn = -(nz**3)  # d n_z = -n_z^3 (z_x dz_x + z_y dz_y), as side^2 = 1
        below = (px == x) & (py == y)
        gx = -j.zx * nz + np.where(below, gap * turn * (j.zx * j.zxx + j.zy * j.zxy), 0.0)
        gy = -j.zy * nz + np.where(below, gap * turn * (j.zx * j.zxy + j.zy * j.zyy), 0.0)
        distance = gap * nz - radius_mm
        return Feet(x, y, distance, np.stack([gx, gy, nz], axis=1)), below & np.isfinite(distance)

    return Measure(measure)
