"""A face of Open CASCADE as a NURBS patch of ours: control net, weights, knots and outline.

Planes, quadrics, tori, swept and revolved surfaces become rational B-splines exactly; offset surfaces only
nearly. Either way the distance from the surface of the file is measured and kept with the patch.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np

from cmm_align.errors import MalformedInputError
from cmm_align.surfaces.nurbs import NurbsSurface
from cmm_align.surfaces.protocol import Array

_EDGE_STEPS: Final = 512
"""Places along an edge of the outline: a full circle is followed to 2e-5 of its radius."""
_CHECKS: Final = 12
"""Places along each parameter at which a converted surface is compared with its original."""
_NEAR_MM: Final = 1e-7
"""Aim for surfaces that no B-spline is exactly; what is reached is measured."""
_EXACT: Final = (
    "plane",
    "cylinder",
    "cone",
    "sphere",
    "torus",
    "bezier surface",
    "B-spline surface",
    "surface of revolution",
    "surface of extrusion",
)


class Face(NamedTuple):
    """A face of a CAD file."""

    shape: Any
    kind: str
    """Type of its surface, as ``sphere``."""
    area_mm2: float


def patch_of(face: Face, where: str) -> NurbsSurface:
    """Convert a face and take its numbers out.

    Parameters
    ----------
    face : Face
    where : str
        File and number of the face, for messages.

    Raises
    ------
    MalformedInputError
        If the face cannot be converted.
    """
    from OCP.BRep import BRep_Tool

    original = BRep_Tool.Surface_s(face.shape)
    try:
        surface, outlined = _exactly(face) if face.kind in _EXACT else _nearly(face, original)
    except Exception as problem:  # the library raises classes of its own without a common root
        raise MalformedInputError(
            f"this {face.kind} cannot be converted to a patch ({problem})",
            where=where,
            remedy="export the face as a B-spline surface",
        ) from None
    for periodic, open_ in (
        (surface.IsUPeriodic(), surface.SetUNotPeriodic),
        (surface.IsVPeriodic(), surface.SetVNotPeriodic),
    ):
        if periodic:
            open_()
    nu, nv = surface.NbUPoles(), surface.NbVPoles()
    poles = [surface.Pole(i, j) for i in range(1, nu + 1) for j in range(1, nv + 1)]
    weights = [surface.Weight(i, j) for i in range(1, nu + 1) for j in range(1, nv + 1)]
    knots = [
        np.repeat([value(k) for k in range(1, count + 1)], [multiplicity(k) for k in range(1, count + 1)])
        for value, multiplicity, count in (
            (surface.UKnot, surface.UMultiplicity, surface.NbUKnots()),
            (surface.VKnot, surface.VMultiplicity, surface.NbVKnots()),
        )
    ]
    patch = NurbsSurface.of(
        (surface.UDegree(), surface.VDegree()),
        knots[0],
        knots[1],
        np.array([(p.X(), p.Y(), p.Z()) for p in poles]).reshape(nu, nv, 3),
        np.array(weights).reshape(nu, nv),
        _loops(outlined),
        where,
    )
    error = 0.0 if face.kind.endswith("B-spline surface") else _distance(patch, original)
    return replace(patch, conversion_error_mm=error)


def _exactly(face: Face) -> tuple[Any, Any]:
    """Return the rational B-spline surface that a face is, and the face over its parameters."""
    from OCP.BRep import BRep_Tool
    from OCP.BRepBuilderAPI import BRepBuilderAPI_NurbsConvert
    from OCP.TopoDS import TopoDS

    converted = TopoDS.Face(BRepBuilderAPI_NurbsConvert(face.shape, True).Shape())
    return BRep_Tool.Surface_s(converted), converted


def _nearly(face: Face, original: Any) -> tuple[Any, Any]:
    """Return a B-spline surface close to a face, over the same parameters, and the face."""
    from OCP.BRepTools import BRepTools
    from OCP.Geom import Geom_RectangularTrimmedSurface
    from OCP.GeomAbs import GeomAbs_Shape
    from OCP.GeomConvert import GeomConvert_ApproxSurface

    smooth = GeomAbs_Shape.GeomAbs_C2
    piece = Geom_RectangularTrimmedSurface(original, *BRepTools.UVBounds_s(face.shape))
    close = GeomConvert_ApproxSurface(piece, _NEAR_MM, smooth, smooth, 9, 9, 64, 1)
    return close.Surface(), face.shape


def _loops(face: Any) -> list[Array]:
    """Return the wires of a face as closed polygons of its parameters."""
    from OCP.BRepAdaptor import BRepAdaptor_Curve2d
    from OCP.BRepTools import BRepTools_WireExplorer
    from OCP.TopAbs import TopAbs_Orientation, TopAbs_ShapeEnum
    from OCP.TopExp import TopExp_Explorer
    from OCP.TopoDS import TopoDS

    loops, wires = [], TopExp_Explorer(face, TopAbs_ShapeEnum.TopAbs_WIRE)
    while wires.More():
        parts, walk = [], BRepTools_WireExplorer(TopoDS.Wire(wires.Current()), face)
        while walk.More():
            edge = TopoDS.Edge(walk.Current())
            curve = BRepAdaptor_Curve2d(edge, face)
            places = np.linspace(curve.FirstParameter(), curve.LastParameter(), _EDGE_STEPS + 1)
            points = [curve.Value(float(t)) for t in places]
            part = np.array([(p.X(), p.Y()) for p in points])
            backward = edge.Orientation() == TopAbs_Orientation.TopAbs_REVERSED
            parts.append(part[::-1][:-1] if backward else part[:-1])
            walk.Next()
        if parts:
            loops.append(np.concatenate(parts))
        wires.Next()
    return loops


def _distance(patch: NurbsSurface, original: Any) -> float:
    """Return the largest distance of a patch from the surface it was converted from, mm."""
    from OCP.GeomAPI import GeomAPI_ProjectPointOnSurf
    from OCP.gp import gp_Pnt

    outline = np.concatenate(patch.loops_uv)
    low, high = outline.min(axis=0), outline.max(axis=0)
    share = (np.arange(_CHECKS) + 0.5) / _CHECKS
    u, v = np.meshgrid(*(low[k] + (high[k] - low[k]) * share for k in (0, 1)))
    found = 0.0
    for x, y, z in patch.derivatives(u.ravel(), v.ravel(), 1).s.tolist():
        foot = GeomAPI_ProjectPointOnSurf(gp_Pnt(x, y, z), original)
        if foot.NbPoints() > 0:
            found = max(found, float(foot.LowerDistance()))
    return found
