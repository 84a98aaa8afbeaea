"""The design: a surface, the ball that touches it, and what `offset` found out about both."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmm_align.pose import Pose
from cmm_align.surfaces.protocol import Array, Mask, Surface


@dataclass(frozen=True, slots=True)
class Equidistant:
    """The surface one tip radius out from the nominal: nodes, facets and a smooth surface.

    Attributes
    ----------
    nominal_points_mm : ndarray, shape (n, 3), mm, frame `part`
        Nodes on the nominal.
    normals : ndarray, shape (n, 3), frame `part`
        Unit normals towards the probe.
    slope, gaussian_curvature_per_mm2 : ndarray, shape (n,)
        Of the nominal over its projection plane.
    points_mm : ndarray, shape (n, 3), mm, frame `part`
        Centres of the ball: ``nominal + tip radius * normal`` where it reaches the node, else the point of
        the envelope over that, along the projection direction.
    triangles : ndarray of int32, shape (m, 3)
        Delaunay triangulation of the projection; counter-clockwise in frame `surface`.
    regular : ndarray of bool, shape (n,)
        Where ``tip radius * concave curvature < 1``.
    reach : ndarray of uint8, shape (n,), or None
        `surfaces.envelope.Reach`: 0 reached, 1 reached but an edge that stands proud is touched first,
        2 held off by another part of the surface, 3 curved more than the ball.
    least_curvature_per_mm, most_curvature_per_mm : ndarray, shape (n,), 1/mm, or None
        Principal curvatures of the nominal, positive where concave towards the probe.
    feature : ndarray of bool, shape (n,), or None
        Where the principal curvatures differ by more than the threshold of the settings.

    Notes
    -----
    What may be None is so in files of older versions.
    """

    nominal_points_mm: Array
    normals: Array
    slope: Array
    gaussian_curvature_per_mm2: Array
    points_mm: Array
    triangles: NDArray[np.int32]
    regular: Mask
    reach: NDArray[np.uint8] | None = None
    least_curvature_per_mm: Array | None = None
    most_curvature_per_mm: Array | None = None
    feature: Mask | None = None


@dataclass(frozen=True, slots=True)
class NominalQuality:
    """What `offset` found out about a nominal; lengths as their names say."""

    n_points: int
    max_slope_deg: float
    min_concave_radius_mm: float | None
    """Smallest radius of curvature towards the probe; None where the surface is nowhere concave."""
    min_concave_at_mm: tuple[float, float] | None
    regular: bool
    facet_error_pv_nm: float
    surface_error_pv_nm: float
    equidistant_error_pv_nm: float
    """Largest misfit of the smooth equidistant surface at its nodes."""
    spacing_mm: tuple[float, float]
    degree: int
    """Degree of the spline through the nominal points; 0 for a closed form."""
    n_not_reached: int | None = None
    """Nodes that the ball does not reach; None in files of older versions, like all that follows."""
    n_edge: int | None = None
    """Nodes so near the border that an edge standing proud is touched first."""
    n_feature: int | None = None
    """Nodes where the principal curvatures differ by more than the threshold."""
    max_held_off_mm: float | None = None
    """How far the ball stays above the analytic offset at worst."""
    max_held_off_at_mm: tuple[float, float] | None = None
    """Node where that is; None if the ball reaches everywhere."""


@dataclass(frozen=True, slots=True)
class Nominal:
    """A nominal surface with the ball that touches it.

    Attributes
    ----------
    surface : Surface
        Height field in frame `surface`.
    side : int
        +1 if the probe is on the +z side of frame `surface`, -1 if on the -z side.
    tip_radius_mm : float
        Effective tip radius, mm.
    surface_from_part : Pose
        Rotation that turns the projection direction to +z.
    digest : str
        SHA-256 of the definition of the surface and its side (hex).
    equidistant_surface : Surface or None
        Smooth surface fitted to the equidistant points, frame `surface`: the second path to a
        deviation. None in the copies that later stages carry.
    equidistant : Equidistant or None
        Nodes and facets; loaded only where they are needed.
    quality : NominalQuality or None
    """

    surface: Surface
    side: int
    tip_radius_mm: float
    surface_from_part: Pose
    digest: str
    equidistant_surface: Surface | None = None
    equidistant: Equidistant | None = None
    quality: NominalQuality | None = None

    @property
    def kind(self) -> str:
        """Kind of the surface: grid, scattered, mesh or prescription."""
        return self.surface.kind
