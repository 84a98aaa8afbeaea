"""Contact points without a nominal: the ball taken off along estimated normals.

A reference for comparison and for parts that have no design. Where there is a nominal, `align` is both
simpler and exact: an error of 1 degree in a normal moves the contact by 26 um under a 1.5 mm ball, along the
surface, and by 0.2 um along the normal.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from cmm_align.errors import UsageError, WrongStageError
from cmm_align.model import PointKind, PointSet
from cmm_align.numerics.local_normals import local_quadratic_normals, moving_least_squares_normals
from cmm_align.stages.offset import SIDES
from cmm_align.surfaces.geometry import unit_normal
from cmm_align.surfaces.projection import surface_from_part
from cmm_align.surfaces.protocol import Array
from cmm_align.surfaces.scattered import fitted_surface

METHODS: Final = ("local-quadratic", "bspline", "mls")


def estimated_normals(points_mm: Array, method: str, side: str = "+z") -> Array:
    """Return estimated unit normals of a cloud, all to one side.

    Parameters
    ----------
    points_mm : ndarray, shape (n, 3), mm
    method : str
        local-quadratic, bspline (one tensor spline through all points) or mls.
    side : str
        +z or -z, along the direction over which the cloud is a height field.

    Returns
    -------
    ndarray, shape (n, 3)

    Raises
    ------
    UsageError
        If the method or the side is not known.
    GeometryError
        If the cloud is no height field, or too small.
    """
    if method not in METHODS or side not in SIDES:
        raise UsageError(f"normals {method!r}, side {side!r}", expected=f"{', '.join(METHODS)}; +z or -z")
    turn = surface_from_part(points_mm)
    local = turn.apply(points_mm)
    if method == "bspline":
        surface, _ = fitted_surface(local, "scattered")
        normals = unit_normal(surface.jet(local[:, 0], local[:, 1]), SIDES[side])
    else:
        estimate = local_quadratic_normals if method == "local-quadratic" else moving_least_squares_normals
        normals = estimate(local)
        normals = normals * np.where(normals[:, 2:] * SIDES[side] < 0.0, -1.0, 1.0)
    return turn.inverse().rotate(normals)


def estimated_contacts(
    measured: PointSet, tip_radius_mm: float, method: str, side: str = "+z"
) -> tuple[PointSet, Array]:
    """Take the ball off tip centres along estimated normals.

    Parameters
    ----------
    measured : PointSet
        Tip centres, mm.
    tip_radius_mm : float
        Tip radius, mm.
    method, side : str
        As for `estimated_normals`.

    Returns
    -------
    contacts : PointSet
        Contact points, in the frame of `measured`.
    normals : ndarray, shape (n, 3)
        The normals used.

    Raises
    ------
    WrongStageError
        If the points are contact points already, or not measured.
    UsageError
        If the tip radius is not positive, or the method is not known.
    """
    if measured.kind not in (PointKind.TIP_CENTRE, PointKind.UNSTATED):
        raise WrongStageError(
            f"these points are {measured.kind}", where=measured.source, expected="tip centres"
        )
    if not (np.isfinite(tip_radius_mm) and tip_radius_mm > 0.0):
        raise UsageError(f"tip radius {tip_radius_mm:g} mm", expected="a radius above zero")
    normals = estimated_normals(measured.points_mm, method, side)
    contacts = PointSet.of(
        measured.points_mm - tip_radius_mm * normals,
        kind=PointKind.CONTACT,
        frame=measured.frame,
        ids=measured.ids,
        source=measured.source,
    )
    return contacts, normals
