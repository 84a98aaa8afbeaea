"""Distances that geometry gives in closed form: the ball over spheres, a cylinder, a torus.

The ball's centre is put beside the surface without using any normal of the code under test: its distance
from a sphere is that from a point, from a cylinder that from a line, from a torus that from a circle.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from cmm_align.selftest.finding import Finding
from cmm_align.selftest.parts import TIP_RADIUS_MM, even_places, part
from cmm_align.surfaces.distance import smooth_measure
from cmm_align.surfaces.protocol import Array, Surface
from cmm_align.units import NM_PER_MM

_SPHERE_MM: Final = 60.0
_BOWL_MM: Final = 60.0
_AXLE_MM: Final = 80.0
_TUBE_MM: Final = 40.0
_HALF_MM: Final = 28.0
_POINTS: Final = 4000
_ROUND: Final = f'shape = "circle"\nradius = {1.2 * _HALF_MM}\n'


def closed_form_distances() -> list[Finding]:
    """Compare deviations with closed forms, between 1 mm inside and 1 mm outside of the true surface."""
    dome = part(_ROUND, f'kind = "conic"\nradius = {-_SPHERE_MM}\nconic = 0.0')
    bowl = part(_ROUND, f'kind = "conic"\nradius = {_BOWL_MM}\nconic = 0.0')
    roller = part(_ROUND, f'kind = "biconic"\nradius_x = {-_SPHERE_MM}\nconic_x = 0.0\ncurvature_y = 0.0')
    ring = part(
        _ROUND, f'kind = "toroid"\nradius = {-_TUBE_MM}\nconic = 0.0\nradius_of_rotation = {-_AXLE_MM}'
    )
    return [
        _compared("sphere", dome, lambda p: _to_point(p, -_SPHERE_MM) - _SPHERE_MM),
        _compared("spherical bowl", bowl, lambda p: _BOWL_MM - _to_point(p, _BOWL_MM)),
        _compared("cylinder", roller, lambda p: np.hypot(p[:, 0], p[:, 2] + _SPHERE_MM) - _SPHERE_MM),
        _compared("torus", ring, _to_ring),
    ]


def _compared(name: str, surface: Surface, distance: Callable[[Array], Array]) -> Finding:
    x, y = even_places(_POINTS, _HALF_MM / np.sqrt(2.0), _HALF_MM / np.sqrt(2.0))
    lift = TIP_RADIUS_MM + np.sin(np.arange(_POINTS))  # the centre lies up to 1 mm off its place
    points = np.stack([x, y, surface.jet(x, y).z + lift], axis=1)
    measure = smooth_measure(surface, 1, TIP_RADIUS_MM).distance
    feet, _ = measure(points, measure(points, None)[0])
    error = np.abs(feet.distance_mm - (distance(points) - TIP_RADIUS_MM)).max()
    return Finding(f"distance from a {name}", float(error) * NM_PER_MM, "nm", _POINTS)


def _to_point(points_mm: Array, z_mm: float) -> Array:
    return np.asarray(np.linalg.norm(points_mm - [0.0, 0.0, z_mm], axis=1), dtype=np.float64)


def _to_ring(points_mm: Array) -> Array:
    """Return the distance from the tube around a circle in the plane y = 0, about an axis along y."""
    out = np.hypot(points_mm[:, 0], points_mm[:, 2] + _AXLE_MM)
    return np.asarray(np.hypot(out - (_AXLE_MM - _TUBE_MM), points_mm[:, 1]) - _TUBE_MM, dtype=np.float64)
