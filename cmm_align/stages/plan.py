"""A measuring plan: where the CMM should touch the part, denser where the nominal bends one way.

1. A square lattice of base points, its spacing from a bound on the facets' error and from a sensible count.
2. In feature regions (|k1 - k2| above a threshold, the paper's adaptive sampling) and one spacing around them
   the lattice of five times as many points that contains the base lattice: that turned by atan(1/2) and
   shrunk by sqrt(5). The two are nested, so there are no double points and no gaps at the seam.
3. Points in the edge band, and where the ball does not reach, are left out.
4. Order: strips of one base spacing, to and fro, so that the probe never goes back inside a strip.
5. Check: triangulate the plan, and measure how far its facets lie from the equidistant surface.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cmm_align.config import OffsetConfig
from cmm_align.errors import GeometryError, UsageError
from cmm_align.model import Nominal, frozen_array
from cmm_align.surfaces.envelope import Reach, edge_band_mm, reach, tight_places
from cmm_align.surfaces.equidistant import Nodes, facet_error_pv_mm, grid_nodes, scattered_nodes
from cmm_align.surfaces.features import features_at
from cmm_align.surfaces.protocol import Array, Mask, Surface
from cmm_align.units import NM_PER_MM, UM_PER_MM

DENSITY: Final = 5
"""Points per area in feature regions over that outside; the index of the nested lattice."""
PRACTICAL: Final = 5.0
"""Points per wavelength that show its amplitude to some 10 %; two only tell that it is there."""

_NET: Final = 40_000
_LEAST_ACROSS: Final = 8
_LONGEST: Final = 1.415
"""Facets with an edge of so many spacings are not counted: inside, every empty circle of the points is at
most a base cell's, so no edge exceeds the root of two; longer ones lie along the border or span a gap."""


@dataclass(frozen=True, slots=True)
class MeasuringPlan:
    """Where to touch a part, in order, and what that can show.

    Attributes
    ----------
    points_mm : ndarray, shape (n, 3), mm, frame `part`
        Contact points on the nominal, in the order of travel.
    normals : ndarray, shape (n, 3), frame `part`
        Unit normals of the nominal towards the probe: the probe comes from there.
    places_mm : ndarray, shape (n, 2), mm, frame `surface`
        The same in the projection plane.
    dense : ndarray of bool, shape (n,)
        Points in or beside a feature region.
    spacing_mm, dense_spacing_mm : float
        Distance of neighbours in the projection plane, mm.
    chosen_by : str
        What decided the spacing, in words.
    facet_error_pv_nm : float
        Measured: PV of facets through the tip centres of the plan against the equidistant surface.
    facet_error_predicted_nm : float
        Upper bound of it outside of feature regions: ``h^2 k (1 + slope^2) (1 + r k) / 4``
        where that is largest (r k for domes only).
    shortest_wavelength_mm, shortest_dense_wavelength_mm : float
        Two spacings (Nyquist), outside and inside of feature regions.
    practical_wavelength_mm, practical_dense_wavelength_mm : float
        Five spacings.
    path_mm : float
        Length of the path from tip centre to tip centre.
    time_s : float
        Path over speed, and the time of the touches.
    n_not_reached, n_edge : int
        Places of the lattice left out because the ball does not reach, or because an edge is near.
    """

    points_mm: Array
    normals: Array
    places_mm: Array
    dense: Mask
    spacing_mm: float
    dense_spacing_mm: float
    chosen_by: str
    facet_error_pv_nm: float
    facet_error_predicted_nm: float
    shortest_wavelength_mm: float
    shortest_dense_wavelength_mm: float
    practical_wavelength_mm: float
    practical_dense_wavelength_mm: float
    path_mm: float
    time_s: float
    n_not_reached: int
    n_edge: int

    def __len__(self) -> int:
        return len(self.points_mm)


def plan(nominal: Nominal, config: OffsetConfig = OffsetConfig()) -> MeasuringPlan:
    """Return where to touch a part to measure it against its nominal.

    Parameters
    ----------
    nominal : Nominal
        What `offset` made.
    config : OffsetConfig
        The keys ``plan_...``, `feature_curvature_per_mm` and `edge_proud_um`.

    Raises
    ------
    UsageError
        If the spacing is negative or leaves fewer than eight points across the part.
    GeometryError
        If no place is left that the ball reaches.
    """
    surface, side, radius = nominal.surface, nominal.side, nominal.tip_radius_mm
    net = _net(surface, side)
    most = np.maximum(np.abs(net.least_per_mm), np.abs(net.concave_per_mm))
    # A spacing in the projection is longer on a slope, and longer still one radius out from a dome.
    bends = float(np.max(most * (1.0 + net.slope**2) * (1.0 + radius * np.maximum(-net.least_per_mm, 0.0))))
    edge_proud = config.edge_proud_um / UM_PER_MM
    inset = float(np.median(edge_band_mm(radius, net.concave_per_mm, edge_proud)))
    spacing, chosen_by = _spacing(surface, net, bends, config)
    places, strip, along, dense = _lattice(
        surface, net, spacing, 1.01 * inset, config.feature_curvature_per_mm
    )
    nodes = scattered_nodes(surface, side, places[:, 0], places[:, 1])
    tight = tight_places(net.points_mm, net.concave_per_mm, net.slope, radius)
    found = reach(
        surface,
        side,
        radius,
        nodes.points_mm,
        nodes.normals,
        nodes.concave_per_mm,
        tight,
        edge_proud,
        _pitch(net),
    )
    keep = found.code == Reach.REACHED
    if np.count_nonzero(keep) < 3:
        raise GeometryError("no place for the plan that the ball reaches", remedy="take a smaller ball")
    gaps = places[found.code > Reach.EDGE]
    order = _order(strip[keep], along[keep])
    centre = found.centre_mm[keep][order]
    path = float(np.sum(np.linalg.norm(np.diff(centre, axis=0), axis=1)))
    back = nominal.surface_from_part.inverse()
    fine = spacing / math.sqrt(DENSITY)
    return MeasuringPlan(
        points_mm=frozen_array(back.apply(nodes.points_mm[keep][order])),
        normals=frozen_array(back.rotate(nodes.normals[keep][order])),
        places_mm=frozen_array(places[keep][order]),
        dense=frozen_array(dense[keep][order], np.bool_),
        spacing_mm=spacing,
        dense_spacing_mm=fine,
        chosen_by=chosen_by,
        facet_error_pv_nm=_facet_error_mm(surface, side, radius, places[keep], dense[keep], spacing, gaps)
        * NM_PER_MM,
        facet_error_predicted_nm=0.25 * spacing**2 * bends * NM_PER_MM,
        shortest_wavelength_mm=2.0 * spacing,
        shortest_dense_wavelength_mm=2.0 * fine,
        practical_wavelength_mm=PRACTICAL * spacing,
        practical_dense_wavelength_mm=PRACTICAL * fine,
        path_mm=path,
        time_s=path / config.plan_speed_mm_s + len(centre) * config.plan_point_s,
        n_not_reached=int(np.count_nonzero(found.code > Reach.EDGE)),
        n_edge=int(np.count_nonzero(found.code == Reach.EDGE)),
    )


def _net(surface: Surface, side: int) -> Nodes:
    """Return nodes over the whole surface to learn its curvatures from."""
    b = surface.bounds
    pitch = float(np.sqrt((b.x_max - b.x_min) * (b.y_max - b.y_min) / _NET))
    x = np.linspace(b.x_min, b.x_max, max(8, round((b.x_max - b.x_min) / pitch) + 1))
    y = np.linspace(b.y_min, b.y_max, max(8, round((b.y_max - b.y_min) / pitch) + 1))
    px, py = np.meshgrid(x, y)
    known = surface.contains(px.ravel(), py.ravel()).reshape(px.shape)
    return grid_nodes(surface, side, x, y, known)


def _pitch(net: Nodes) -> float:
    """Return the mean distance of neighbours of a net, mm."""
    low, high = net.points_mm[:, :2].min(axis=0), net.points_mm[:, :2].max(axis=0)
    return float(np.sqrt(np.prod(high - low) / len(net.points_mm)))


def _spacing(surface: Surface, net: Nodes, bends: float, config: OffsetConfig) -> tuple[float, str]:
    """Return the base spacing, mm, and what decided it."""
    b = surface.bounds
    width, height = b.x_max - b.x_min, b.y_max - b.y_min
    widest = min(width, height) / _LEAST_ACROSS
    asked = config.plan_spacing_mm
    if asked < 0.0 or asked > widest:
        raise UsageError(
            f"spacing {asked:g} mm of the plan", expected=f"above zero, at most {widest:.4g} mm on this part"
        )
    if asked > 0.0:
        return asked, "as asked"
    corner = _pitch(net)
    area = float(len(net.points_mm)) * corner**2
    by_count = float(np.sqrt(area / config.plan_points))
    error_mm = config.plan_facet_error_um / UM_PER_MM
    by_error = float(np.sqrt(4.0 * error_mm / bends)) if bends > 0.0 else np.inf
    if by_error >= widest:
        return min(widest, 4.0 * by_count), "a part this flat needs no more"
    if by_error >= by_count:
        return by_error, f"facets within {config.plan_facet_error_um:g} um of the surface"
    return by_count, f"about {config.plan_points} base points"


def _lattice(
    surface: Surface, net: Nodes, spacing: float, inset: float, threshold_per_mm: float
) -> tuple[Array, Array, Array, Mask]:
    """Return places, the number of their strip, their place along it, and which are dense.

    On integers (k, m) in units of a fifth of the spacing the base lattice is ``k = m = 0 (mod 5)`` and the
    nested one ``m = 3 k (mod 5)``: spanned by (2, 1) and (-1, 2), of which five make a base cell.
    """
    b = surface.bounds
    size = np.array([b.x_max - b.x_min, b.y_max - b.y_min])
    longer = int(size[1] > size[0])  # strips run along the longer side
    count = np.floor((size - 2.0 * inset) / spacing).astype(int)  # outermost points on the edge band
    low = np.array([b.x_min, b.y_min]) + 0.5 * (size - count * spacing)
    n_along, n_across = 5 * count[longer], 5 * count[1 - longer]
    m, k = (a.ravel() for a in np.meshgrid(np.arange(-2, n_across + 3), np.arange(-2, n_along + 3)))
    nested = (m - 3 * k) % 5 == 0
    m, k = m[nested], k[nested]
    places = np.empty((len(k), 2))
    places[:, longer] = low[longer] + 0.2 * spacing * k
    places[:, 1 - longer] = low[1 - longer] + 0.2 * spacing * m
    inside = surface.contains(places[:, 0], places[:, 1])
    places, k, m = places[inside], k[inside], m[inside]
    base = (k % 5 == 0) & (m % 5 == 0)
    here = features_at(surface, places[:, 0], places[:, 1], threshold_per_mm)
    on_net = net.concave_per_mm - net.least_per_mm > threshold_per_mm
    features = np.concatenate([places[here], net.points_mm[on_net, :2]])
    dense = np.zeros(len(places), dtype=bool)
    if len(features):
        from scipy.spatial import cKDTree  # slow to import

        gap, _ = cKDTree(features).query(places, distance_upper_bound=spacing)
        dense = np.asarray(gap <= spacing)
    keep = base | dense
    strip = np.floor_divide(m + 2, 5)
    return places[keep], strip[keep], k[keep], dense[keep]


def _order(strip: Array, along: Array) -> NDArray[np.intp]:
    """Return the order of travel: strip by strip, every other one backwards."""
    number = np.unique(strip, return_inverse=True)[1]
    order: NDArray[np.intp] = np.lexsort((np.where(number % 2 == 0, along, -along), number))
    return order


def _facet_error_mm(
    surface: Surface, side: int, radius: float, places: Array, dense: Mask, spacing: float, gaps: Array
) -> float:
    """Measure the facets between the points, those that span a gap of the part or of the reach left out."""
    nodes = scattered_nodes(surface, side, places[:, 0], places[:, 1])
    corners = nodes.points_mm[nodes.triangles][:, :, :2]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    fine = spacing / math.sqrt(DENSITY)
    keep = longest <= _LONGEST * np.where(dense[nodes.triangles].all(axis=1), fine, spacing)
    if len(gaps):
        from scipy.spatial import cKDTree  # slow to import

        keep &= cKDTree(gaps).query(corners.mean(axis=1))[0] > 0.75 * fine
    whole = nodes.triangles[keep]
    return facet_error_pv_mm(surface, side, radius, nodes._replace(triangles=whole)) if len(whole) else 0.0
