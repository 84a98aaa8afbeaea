"""The file of a nominal, written by `offset`."""

from __future__ import annotations

from typing import Final

from cmm_align.errors import MalformedInputError
from cmm_align.io.hdf5_library import h5py
from cmm_align.io.safe_hdf5 import find, read_array, where_of
from cmm_align.io.surface_group import read_nominal_group, read_surface, write_nominal_group, write_surface
from cmm_align.io.writing import write_array
from cmm_align.model import Equidistant, Nominal

_OPTIONAL: Final = {"least_curvature_per_mm": "f", "most_curvature_per_mm": "f", "feature": "b"}
"""Datasets of `/nominal` that files of older versions lack, and their types."""


def write_body(file: h5py.File, nominal: Nominal) -> None:
    """Fill a file with a nominal."""
    write_nominal_group(file.create_group("surface"), nominal)
    net = nominal.equidistant
    if nominal.equidistant_surface is not None:
        write_surface(file.create_group("equidistant/surface"), nominal.equidistant_surface)
    if net is None:
        return
    group = file.require_group("equidistant")
    write_array(group, "points_mm", net.points_mm)
    write_array(group, "triangles", net.triangles)
    write_array(group, "regular", net.regular)
    if net.reach is not None:
        write_array(group, "reach", net.reach)
    group = file.create_group("nominal")
    write_array(group, "points_mm", net.nominal_points_mm)
    write_array(group, "normals", net.normals)
    write_array(group, "slope", net.slope)
    write_array(group, "gaussian_curvature_per_mm2", net.gaussian_curvature_per_mm2)
    for name in _OPTIONAL:
        values = getattr(net, name)
        if values is not None:
            write_array(group, name, values)


def read_body(file: h5py.File, with_equidistant: bool) -> Nominal:
    """Return the nominal of a file; the net of nodes only on request, for it is large.

    Where the ball does not reach everywhere it is read all the same: it tells where.

    Raises
    ------
    MalformedInputError
        If something is missing or not as expected.
    """
    core = read_nominal_group(file, "/surface")
    has_surface = find(file, "/equidistant/surface") is not None
    has_net = find(file, "/equidistant/points_mm") is not None
    held_off = core.quality is not None and bool(core.quality.n_not_reached)
    return Nominal(
        core.surface,
        core.side,
        core.tip_radius_mm,
        core.surface_from_part,
        core.digest,
        equidistant=_read_net(file) if has_net and (with_equidistant or held_off) else None,
        equidistant_surface=read_surface(file, "/equidistant/surface") if has_surface else None,
        quality=core.quality,
    )


def _read_net(file: h5py.File) -> Equidistant:
    points = read_array(file, "/equidistant/points_mm", (None, 3))
    n = len(points)
    triangles = read_array(file, "/equidistant/triangles", (None, 3), "i")
    if len(triangles) and not (triangles.min() >= 0 and triangles.max() < n):
        raise MalformedInputError(
            f"rows {triangles.min()} to {triangles.max()}",
            where=where_of(file, "/equidistant/triangles"),
            expected=f"rows 0 to {n - 1} of points_mm",
        )
    indices = triangles.astype("int32")
    indices.flags.writeable = False
    has_reach = find(file, "/equidistant/reach") is not None
    reach = read_array(file, "/equidistant/reach", (n,), "i").astype("uint8") if has_reach else None
    if reach is not None:
        reach.flags.writeable = False
    later = {
        name: read_array(file, f"/nominal/{name}", (n,), kind)
        for name, kind in _OPTIONAL.items()
        if find(file, f"/nominal/{name}") is not None
    }
    return Equidistant(
        nominal_points_mm=read_array(file, "/nominal/points_mm", (n, 3)),
        normals=read_array(file, "/nominal/normals", (n, 3)),
        slope=read_array(file, "/nominal/slope", (n,)),
        gaussian_curvature_per_mm2=read_array(file, "/nominal/gaussian_curvature_per_mm2", (n,)),
        points_mm=points,
        triangles=indices,
        regular=read_array(file, "/equidistant/regular", (n,), "b"),
        reach=reach,
        **later,
    )
