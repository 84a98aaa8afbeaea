"""Stage 1, offset: from a nominal to the equidistant surface that the ball's centre runs on.

1. Choose the direction over which the nominal is a height field.
2. Put a smooth surface through it: a spline through a grid, a fitted spline for scattered points, or the
   formula itself.
3. Step one tip radius out along the normals; triangulate the projection. Where the ball cannot follow, its
   centre stays on the envelope instead.
4. Check: where does the ball reach, and how good are the facets and the smooth surface?
"""

from __future__ import annotations

import hashlib
from dataclasses import replace
from typing import Any, Final

import numpy as np

from cmm_align.config import OffsetConfig
from cmm_align.errors import GeometryError, UsageError, WrongStageError
from cmm_align.model import (
    Equidistant,
    Nominal,
    NominalQuality,
    PointKind,
    PointSet,
    frozen_array,
)
from cmm_align.pose import Pose
from cmm_align.surfaces.envelope import Reach, Reached, reach, tight_places, tightest
from cmm_align.surfaces.equidistant import Nodes, facet_error_pv_mm, grid_nodes, scattered_nodes
from cmm_align.surfaces.features import feature_mask
from cmm_align.surfaces.grid import grid_surface, recognised_grid
from cmm_align.surfaces.mesh import TriangleMesh, direction_of_mesh, mesh_surface
from cmm_align.surfaces.nurbs import NurbsSurface
from cmm_align.surfaces.prescription import PrescriptionSurface
from cmm_align.surfaces.projection import surface_from_normals, surface_from_part
from cmm_align.surfaces.protocol import Array, Surface
from cmm_align.surfaces.scattered import fitted_surface
from cmm_align.surfaces.spline_surface import SplineSurface
from cmm_align.units import DEG_PER_RAD, NM_PER_MM, UM_PER_MM

MIN_NOMINAL_POINTS: Final = 36
"""Fewer cannot carry a surface of degree 5."""
SIDES: Final = {"+z": 1, "-z": -1}

ENOUGH_MM: Final = 1e-9
"""Misfit that is good enough for the second path: 0.001 nm."""

_FIT_NODES: Final = 150_000
"""Nodes that the smooth equidistant surface is fitted to."""


def offset(source: NominalSource, tip_radius_mm: float, config: OffsetConfig = OffsetConfig()) -> Nominal:
    """Build the equidistant surface of a nominal.

    Parameters
    ----------
    source : PointSet, PrescriptionSurface, TriangleMesh or NurbsSurface
        Nominal points, mm, frame `part` (a regular grid is recognised), a formula, a mesh, or a CAD face.
    tip_radius_mm : float
        Effective radius of the probe ball, mm.
    config : OffsetConfig
        `side`: the probe's side along the projection direction.

    Returns
    -------
    Nominal
        With its equidistant net and quality. What the ball does at each node is in
        ``equidistant.reach``; the smallest concave radius, and so the largest ball that fits everywhere,
        is in ``quality``.

    Raises
    ------
    UsageError
        If the tip radius is not positive or the side is unknown.
    WrongStageError
        If the points are a measurement.
    GeometryError
        If the nominal is no height field, too small, or nowhere regular for this ball.

    Notes
    -----
    Paper, section 2: equidistant surface and projection of its triangulation. Accuracy tested: equidistant
    points of paraboloid, torus and conic to 1e-12 mm.
    """
    if not (np.isfinite(tip_radius_mm) and tip_radius_mm > 0.0):
        raise UsageError(f"tip radius {tip_radius_mm:g} mm", expected="a radius above zero")
    if config.side not in SIDES:
        raise UsageError(f"side {config.side!r}", expected="+z or -z")
    side = SIDES[config.side]
    if isinstance(source, PrescriptionSurface):
        turn, surface, nodes, error_mm = _from_formula(source, side, config)
    elif isinstance(source, TriangleMesh):
        turn, surface, nodes, error_mm = _from_mesh(source, side)
    elif isinstance(source, NurbsSurface):
        turn, surface, nodes, error_mm = _from_nurbs(source, side, config)
    else:
        turn, surface, nodes, error_mm = _from_points(source, side, config)

    regular = tip_radius_mm * nodes.concave_per_mm < 1.0
    reached = _reach(surface, side, tip_radius_mm, nodes, config)
    touching = reached.code <= Reach.EDGE
    if np.count_nonzero(touching) < MIN_NOMINAL_POINTS:
        radius = 1.0 / float(nodes.concave_per_mm.max())
        raise GeometryError(
            f"a ball of radius {tip_radius_mm:g} mm fits nowhere (smallest concave radius {radius:.4g} mm)",
            remedy="check the tip radius and the side of the probe",
        )
    followed = nodes
    if not touching.all():
        followed = nodes._replace(triangles=nodes.triangles[touching[nodes.triangles].all(axis=1)])
    smooth, misfit_mm = _smooth_equidistant(reached.centre_mm[touching])
    feature = feature_mask(nodes.least_per_mm, nodes.concave_per_mm, config.feature_curvature_per_mm)
    quality = replace(
        _quality(surface, side, tip_radius_mm, followed, error_mm, misfit_mm),
        n_feature=int(np.count_nonzero(feature)),
        **_reach_numbers(nodes, reached),
    )
    back = turn.inverse()
    equidistant = Equidistant(
        nominal_points_mm=frozen_array(back.apply(nodes.points_mm)),
        normals=frozen_array(back.rotate(nodes.normals)),
        slope=frozen_array(nodes.slope),
        gaussian_curvature_per_mm2=frozen_array(nodes.gaussian_curvature_per_mm2),
        points_mm=frozen_array(back.apply(reached.centre_mm)),
        triangles=frozen_array(nodes.triangles, np.int32),
        regular=frozen_array(regular, np.bool_),
        reach=frozen_array(reached.code, np.uint8),
        least_curvature_per_mm=frozen_array(nodes.least_per_mm),
        most_curvature_per_mm=frozen_array(nodes.concave_per_mm),
        feature=frozen_array(feature, np.bool_),
    )
    digest = surface_digest(surface, side, turn)
    return Nominal(surface, side, tip_radius_mm, turn, digest, smooth, equidistant, quality)


NominalSource = PointSet | PrescriptionSurface | TriangleMesh | NurbsSurface

Built = tuple[Pose, Surface, Nodes, float]
"""Rotation, surface, nodes and the estimated error of the surface, mm PV."""


def _from_formula(source: PrescriptionSurface | NurbsSurface, side: int, config: OffsetConfig) -> Built:
    """Sample a formula on a net over its aperture."""
    b = source.bounds
    pitch = float(np.sqrt((b.x_max - b.x_min) * (b.y_max - b.y_min) / config.nodes))
    x = np.linspace(b.x_min, b.x_max, max(8, round((b.x_max - b.x_min) / pitch) + 1))
    y = np.linspace(b.y_min, b.y_max, max(8, round((b.y_max - b.y_min) / pitch) + 1))
    px, py = (a.ravel() for a in np.meshgrid(x, y))
    known = source.contains(px, py)
    undefined = known & ~np.isfinite(source.jet(px, py).z)
    if undefined.any():
        k = int(np.argmax(undefined))
        raise GeometryError(
            f"the prescription is not defined at x = {px[k]:.6g}, y = {py[k]:.6g} mm, inside its aperture",
            expected="a real square root everywhere",
            remedy="make the aperture smaller or correct the radius and the conic constant",
        )
    if np.count_nonzero(known) < MIN_NOMINAL_POINTS:
        raise GeometryError("the aperture holds too few nodes", remedy="raise offset.nodes")
    nodes = grid_nodes(source, side, x, y, known.reshape(len(y), len(x)))
    return Pose.identity("surface", "part"), source, nodes, 0.0


def _from_mesh(source: TriangleMesh, side: int) -> Built:
    """Fit a smooth surface to the vertices; the facets stay the triangulation."""
    if len(source.points_mm) < MIN_NOMINAL_POINTS:
        raise GeometryError(
            f"a mesh of {len(source.points_mm)} vertices",
            where=source.source,
            expected=f"at least {MIN_NOMINAL_POINTS}",
        )
    turn = direction_of_mesh(source)
    points = turn.apply(source.points_mm)
    surface, triangles, error = mesh_surface(points, source.triangles, source.source)
    return turn, surface, scattered_nodes(surface, side, points[:, 0], points[:, 1], triangles), error


def _from_nurbs(source: NurbsSurface, side: int, config: OffsetConfig) -> Built:
    """Turn a patch until it is a height field and sample it over its outline."""
    try:
        turn = surface_from_normals(*source.sampled())
    except GeometryError as problem:
        raise GeometryError(
            problem.what, where=source.source, expected=problem.expected, remedy=problem.remedy
        ) from None
    surface = source.turned(turn.rotation)
    nodes = _from_formula(surface, side, config)[2]
    return turn, surface, nodes, source.conversion_error_mm


def _from_points(source: PointSet, side: int, config: OffsetConfig) -> Built:
    """Recognise a grid or fit scattered points."""
    if source.kind in (PointKind.TIP_CENTRE, PointKind.CONTACT):
        raise WrongStageError(
            f"these points are measured ({source.kind})", where=source.source, expected="nominal points"
        )
    if len(source) < MIN_NOMINAL_POINTS:
        raise GeometryError(
            f"{len(source)} nominal points", where=source.source, expected=f"at least {MIN_NOMINAL_POINTS}"
        )
    flat = Pose.identity("surface", "part")
    try:
        grid = recognised_grid(source.points_mm, config.grid_tolerance)
        turn = flat if grid is not None else surface_from_part(source.points_mm)
        points = turn.apply(source.points_mm)
        if grid is None and turn is not flat:
            grid = recognised_grid(points, config.grid_tolerance)
        if grid is not None:
            surface, error = grid_surface(grid, config.degree)
            ny, nx = grid.z_mm.shape
            x = grid.x0_mm + grid.dx_mm * np.arange(nx, dtype=np.float64)
            y = grid.y0_mm + grid.dy_mm * np.arange(ny, dtype=np.float64)
            return turn, surface, grid_nodes(surface, side, x, y, np.isfinite(grid.z_mm)), error
        _refuse_duplicates(points)
        surface, error = fitted_surface(points, "scattered")
    except GeometryError as problem:
        raise GeometryError(
            problem.what, where=source.source, expected=problem.expected, remedy=problem.remedy
        ) from None
    return turn, surface, scattered_nodes(surface, side, points[:, 0], points[:, 1]), error


def _refuse_duplicates(points_mm: Array) -> None:
    """Refuse two points at one place with different heights."""
    order = np.lexsort((points_mm[:, 1], points_mm[:, 0]))
    ordered = points_mm[order]
    same = (np.diff(ordered[:, 0]) == 0.0) & (np.diff(ordered[:, 1]) == 0.0)
    clash = same & (np.diff(ordered[:, 2]) != 0.0)
    if clash.any():
        x, y, z = ordered[int(np.argmax(clash))]
        raise GeometryError(
            f"two points at x = {x:.6g}, y = {y:.6g} differ in z (one is {z:.6g} mm)",
            expected="one height at every place",
        )


def _smooth_equidistant(points_mm: Array) -> tuple[SplineSurface, float]:
    """Fit a smooth height field to the equidistant points: a path of its own to every deviation."""
    return fitted_surface(points_mm[:: max(1, len(points_mm) // _FIT_NODES)], "equidistant", ENOUGH_MM)


def _reach(surface: Surface, side: int, tip_radius_mm: float, nodes: Nodes, config: OffsetConfig) -> Reached:
    """Find out where the ball touches, and where its centre is if it does not."""
    tight = tight_places(nodes.points_mm, nodes.concave_per_mm, nodes.slope, tip_radius_mm)
    return reach(
        surface,
        side,
        tip_radius_mm,
        nodes.points_mm,
        nodes.normals,
        nodes.concave_per_mm,
        tight,
        config.edge_proud_um / UM_PER_MM,
        max(_spacing(surface, nodes)),
    )


def _reach_numbers(nodes: Nodes, reached: Reached) -> dict[str, Any]:
    """Return what the quality says of the reach of the ball."""
    worst = int(np.argmax(reached.held_off_mm))
    held_off = float(reached.held_off_mm[worst])
    at = (float(nodes.points_mm[worst, 0]), float(nodes.points_mm[worst, 1]))
    return {
        "n_not_reached": int(np.count_nonzero(reached.code > Reach.EDGE)),
        "n_edge": int(np.count_nonzero(reached.code == Reach.EDGE)),
        "max_held_off_mm": held_off,
        "max_held_off_at_mm": at if held_off > 0.0 else None,
    }


def _spacing(surface: Surface, nodes: Nodes) -> tuple[float, float]:
    """Return the distance of the nodes along x and y, mm."""
    if isinstance(surface, SplineSurface) and surface.kind == "grid":
        return surface.dx_mm, surface.dy_mm
    low, high = nodes.points_mm[:, :2].min(axis=0), nodes.points_mm[:, :2].max(axis=0)
    mean = float(np.sqrt(np.prod(high - low) / len(nodes.points_mm)))
    return mean, mean


def _quality(
    surface: Surface, side: int, tip_radius_mm: float, nodes: Nodes, error_mm: float, misfit_mm: float
) -> NominalQuality:
    """Gather what the operator must know of this nominal."""
    spacing = _spacing(surface, nodes)
    most, *at = tightest(surface, side, nodes.points_mm, nodes.concave_per_mm, max(spacing))
    concave = most > 1e-9 / surface.bounds.diagonal_mm
    return NominalQuality(
        n_points=len(nodes.points_mm),
        max_slope_deg=float(np.arctan(nodes.slope.max())) * DEG_PER_RAD,
        min_concave_radius_mm=1.0 / most if concave else None,
        min_concave_at_mm=(at[0], at[1]) if concave else None,
        regular=bool(tip_radius_mm * most < 1.0),
        facet_error_pv_nm=facet_error_pv_mm(surface, side, tip_radius_mm, nodes) * NM_PER_MM,
        surface_error_pv_nm=error_mm * NM_PER_MM,
        equidistant_error_pv_nm=misfit_mm * NM_PER_MM,
        spacing_mm=spacing,
        degree=surface.degree if isinstance(surface, SplineSurface) else 0,
    )


def surface_digest(surface: Surface, side: int, turn: Pose) -> str:
    """Return the SHA-256 (hex) of what defines a nominal: surface, side and projection."""
    digest = hashlib.sha256(f"{surface.kind} {side}".encode())
    digest.update(np.ascontiguousarray(turn.rotation).tobytes())
    if isinstance(surface, SplineSurface):
        net = (surface.x0_mm, surface.y0_mm, surface.dx_mm, surface.dy_mm, float(surface.degree))
        digest.update(np.array(net).tobytes())
        digest.update(surface.coefficients_mm.tobytes())
        digest.update(np.packbits(surface.cells).tobytes())
    elif isinstance(surface, PrescriptionSurface):
        digest.update(surface.toml_text.encode())
    elif isinstance(surface, NurbsSurface):
        digest.update(surface.digest())
    return digest.hexdigest()
