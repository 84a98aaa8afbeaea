"""Differential geometry of a height field, derived once for every kind of surface.

Conventions: `side` is +1 if the probe is on the +z side of the surface, -1 if on the -z side. The unit
normal n points out of the material to that side. A curvature is positive where the surface is
*concave towards the probe* (a bowl that the ball sits in), so the equidistant surface is regular
where ``r k < 1``. Formulas: do Carmo, "Differential Geometry of Curves and Surfaces", section 3-3.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cmm_align.surfaces.protocol import Array, Jet


class PrincipalCurvatures(NamedTuple):
    """Principal curvatures towards the probe, 1/mm, each of shape (n,); `most` >= `least`."""

    least: Array
    most: Array


def unit_normal(jet: Jet, side: int) -> Array:
    """Return the unit normal on the probe's side.

    Returns
    -------
    ndarray, shape (n, 3), frame `surface`
        ``side (-z_x, -z_y, 1) / sqrt(1 + z_x^2 + z_y^2)``.
    """
    scale = side / np.sqrt(1.0 + jet.zx**2 + jet.zy**2)
    return np.stack([-jet.zx * scale, -jet.zy * scale, scale], axis=-1)


def slope(jet: Jet) -> Array:
    """Return the slope ``sqrt(z_x^2 + z_y^2)``, shape (n,), dimensionless."""
    result: Array = np.hypot(jet.zx, jet.zy)
    return result


def gaussian_curvature_per_mm2(jet: Jet) -> Array:
    """Return the Gaussian curvature, shape (n,), 1/mm^2; the same seen from either side."""
    result: Array = (jet.zxx * jet.zyy - jet.zxy**2) / (1.0 + jet.zx**2 + jet.zy**2) ** 2
    return result


def principal_curvatures(jet: Jet, side: int) -> PrincipalCurvatures:
    """Return both principal curvatures, positive where concave towards the probe.

    Parameters
    ----------
    jet : Jet
        Derivatives at n places.
    side : int
        +1 or -1, the probe's side.
    """
    # In the frame along and across the gradient the shape operator is symmetric, so that equal
    # curvatures (a sphere) come out equal instead of differing by the root of rounding.
    steep = np.hypot(jet.zx, jet.zy)
    flat = steep == 0.0
    gx = np.where(flat, 1.0, jet.zx / np.where(flat, 1.0, steep))
    gy = np.where(flat, 0.0, jet.zy / np.where(flat, 1.0, steep))
    w = np.sqrt(1.0 + steep**2)
    along = (gx * gx * jet.zxx + 2.0 * gx * gy * jet.zxy + gy * gy * jet.zyy) / w**3
    across = (gy * gy * jet.zxx - 2.0 * gx * gy * jet.zxy + gx * gx * jet.zyy) / w
    mixed = (gx * gy * (jet.zyy - jet.zxx) + (gx * gx - gy * gy) * jet.zxy) / w**2
    mean = 0.5 * side * (along + across)
    half = np.hypot(0.5 * (along - across), mixed)
    return PrincipalCurvatures(mean - half, mean + half)
