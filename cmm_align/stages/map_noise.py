"""What a map tells about its own noise: the scatter of the points about it, and the floor of its spectrum.

A node is the constant of a quadratic through the points of a window of 3 x 3 steps with equal weights, so
it takes ``l = 3.5 / (9 m)`` of its value from a point at its place, m the points to a cell (the leverage of
the middle of a square: 1 + 5/4 + 5/4 over the number of points). The points then scatter about the map by
``s^2 (1 - l)``, and noise hands the nodes a flat spectrum ``C = s^2 dx dy / m`` down to the waves they
resolve. Form error finer than the map counts as noise, as it must for whoever cannot see it. What
neighbours have in common, as drift and lobing of a machine, does not.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from cmm_align.model import DeviationMap
from cmm_align.numerics.areal_filter import spacings
from cmm_align.numerics.grid_field import interpolated
from cmm_align.numerics.spectral_density import RadialPsd, radial_psd
from cmm_align.stages.map_grid import Places
from cmm_align.surfaces.protocol import Array

LEVERAGE: Final = 3.5 / 9.0
"""Share of a point in the node at its place, times the points to a cell."""


@dataclass(frozen=True, slots=True)
class MapNoise:
    """Noise of a map.

    Attributes
    ----------
    scatter_mm : float
        Standard deviation s of a single point about a smooth surface.
    points_per_node : float
        m.
    area_mm2 : float
        Of the map.
    psd : RadialPsd
        Spectrum of the map with the floor of this noise in it.
    """

    scatter_mm: float
    points_per_node: float
    area_mm2: float
    psd: RadialPsd


def map_noise(deviation_map: DeviationMap, points: Places) -> MapNoise:
    """Return the noise of a map, from the scatter of its points about it.

    Raises
    ------
    GeometryError
        If the map has too few nodes for a spectrum.
    """
    m = deviation_map
    steps = step_of(m.x_mm), step_of(m.y_mm)
    at_points = interpolated(m.x_mm, m.y_mm, m.deviation_mm, points.x_mm, points.y_mm)
    rest = points.deviation_mm - at_points
    known = np.isfinite(rest)
    nodes = int(np.isfinite(m.deviation_mm).sum())
    per_node = max(int(known.sum()) / max(nodes, 1), 1e-9)
    own = min(LEVERAGE / per_node, 0.9)
    scatter = float(np.sqrt(np.mean(rest[known] ** 2) / (1.0 - own))) if known.any() else float("nan")
    psd = radial_psd(m.deviation_mm, spacings(steps), scatter / per_node**0.5)
    return MapNoise(scatter, per_node, nodes * steps[0] * steps[1], psd)


def step_of(nodes_mm: Array) -> float:
    """Return the distance of evenly spaced nodes, shape (n,), mm."""
    return float(nodes_mm[1] - nodes_mm[0])
