"""Signed deviation of tip centres from the equidistant surface, in two ways.

*Smooth*: the orthogonal foot point on the nominal, minus the tip radius; where the equidistant surface is
regular this is exactly the distance to it. *Facet*: the plane of the triangle whose projection holds the
point (the paper's method). Both give the same kind of `Measure` to `numerics.rigid_fit`.
"""

from __future__ import annotations

import numpy as np

from cmm_align.numerics.foot_point import (
    Feet,
    distance_hessian,
    foot_points,
    shifted_feet,
)
from cmm_align.numerics.linearisation import Measure
from cmm_align.numerics.seed_table import seed_table, seeds
from cmm_align.numerics.triangle_net import (
    TriangleNet,
    facet_distance,
    grid_triangles,
    locate,
    triangle_net,
)
from cmm_align.surfaces.equidistant import limits_of
from cmm_align.surfaces.geometry import unit_normal
from cmm_align.surfaces.protocol import Array, Mask, Surface


def smooth_measure(surface: Surface, side: int, radius_mm: float) -> Measure:
    """Return the deviation by orthogonal foot points on a smooth nominal.

    Parameters
    ----------
    surface : Surface
    side : int
        +1 or -1, the probe's side.
    radius_mm : float
        Tip radius, mm; 0 for contact points.
    """
    limits = limits_of(surface)
    table = seed_table(surface.jet, side, radius_mm, limits)

    def measure(points_mm: Array, previous: Feet | None) -> tuple[Feet, Mask]:
        x, y = seeds(table, points_mm) if previous is None else (previous.x_mm, previous.y_mm)
        feet = foot_points(surface.jet, side, points_mm, x, y, limits)
        return feet._replace(distance_mm=feet.distance_mm - radius_mm), on_surface(feet)

    def shifted(feet: Feet, shift_mm: Array) -> tuple[Feet, Mask]:
        found = shifted_feet(side, radius_mm, feet, shift_mm)
        return found, on_surface(found)

    def on_surface(feet: Feet) -> Mask:
        inside: Mask = surface.contains(feet.x_mm, feet.y_mm) & np.isfinite(feet.distance_mm)
        return inside

    def hessian(points_mm: Array, feet: Feet) -> Array:
        return distance_hessian(surface.jet, side, points_mm, feet)

    return Measure(measure, hessian, shifted)


def facet_measure(net: TriangleNet, side: int) -> Measure:
    """Return the deviation from the facets of a net, continued past its border by the border facets.

    Parameters
    ----------
    net : TriangleNet
        On the equidistant surface, frame `surface`.
    side : int
        +1 or -1, the probe's side.

    Notes
    -----
    `Feet.x_mm` and `y_mm` are the place of the point itself: location needs no better start than that.
    """

    def measure(points_mm: Array, previous: Feet | None) -> tuple[Feet, Mask]:
        del previous
        triangle, inside = locate(net, points_mm[:, 0], points_mm[:, 1])
        distance, normal = facet_distance(net, points_mm, triangle)
        return Feet(points_mm[:, 0], points_mm[:, 1], side * distance, side * normal), inside

    return Measure(measure)


def light_net(surface: Surface, side: int, radius_mm: float, nodes: int = 96) -> TriangleNet:
    """Return a coarse net of the equidistant surface: enough to find the way from far off.

    Parameters
    ----------
    surface, side, radius_mm
        As for `smooth_measure`.
    nodes : int
        Nodes along the longer side.
    """
    b = surface.bounds
    pitch = max(b.x_max - b.x_min, b.y_max - b.y_min) / (nodes - 1)
    x = np.linspace(b.x_min, b.x_max, max(8, round((b.x_max - b.x_min) / pitch) + 1))
    y = np.linspace(b.y_min, b.y_max, max(8, round((b.y_max - b.y_min) / pitch) + 1))
    px, py = np.meshgrid(x, y)
    jet = surface.jet(px.ravel(), py.ravel())
    known = (surface.contains(px.ravel(), py.ravel()) & np.isfinite(jet.z)).reshape(px.shape)
    points = np.stack([px.ravel(), py.ravel(), jet.z], axis=1) + radius_mm * unit_normal(jet, side)
    return triangle_net(points[known.ravel()], grid_triangles(known))
