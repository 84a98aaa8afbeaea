"""A surface, and the nominal around it, as one group of a file.

The group is `/surface` in a nominal's file and `/nominal_surface` in the files of later stages, which
carry the nominal without its equidistant net.
"""

from __future__ import annotations

import numpy as np

from cmm_align.errors import GeometryError, InputError, MalformedInputError
from cmm_align.io.hdf5_library import h5py
from cmm_align.io.records import read_record, write_record
from cmm_align.io.safe_hdf5 import attribute, find, read_array, read_text, where_of
from cmm_align.io.writing import write_array, write_text
from cmm_align.model import Nominal, NominalQuality
from cmm_align.pose import Pose
from cmm_align.surfaces.nurbs import NurbsSurface
from cmm_align.surfaces.prescription import prescription_from_toml
from cmm_align.surfaces.protocol import Surface
from cmm_align.surfaces.spline_surface import SplineSurface

CARRIED = "/nominal_surface"
"""Where the files of later stages keep the nominal."""

_FORM_SPLINE = "spline"
_FORM_PRESCRIPTION = "prescription"
_FORM_NURBS = "nurbs"


def write_surface(group: h5py.Group, surface: Surface) -> None:
    """Write a surface as a spline's coefficients, a patch's control net or a prescription's text.

    Raises
    ------
    InputError
        If it is none of them.
    """
    if isinstance(surface, SplineSurface):
        group.attrs["form"] = _FORM_SPLINE
        group.attrs["kind"] = surface.kind
        group.attrs["degree"] = surface.degree
        for name in ("x0_mm", "y0_mm", "dx_mm", "dy_mm"):
            group.attrs[name] = float(getattr(surface, name))
        write_array(group, "coefficients_mm", surface.coefficients_mm, noun="surface")
        write_array(group, "cells", surface.cells, noun="surface")
        return
    if isinstance(surface, NurbsSurface):
        _write_nurbs(group, surface)
        return
    text = getattr(surface, "toml_text", None)
    if not isinstance(text, str):
        raise InputError(f"a surface of type {type(surface).__name__} cannot be stored", where=group.name)
    group.attrs["form"] = _FORM_PRESCRIPTION
    group.attrs["kind"] = surface.kind
    write_text(group, "prescription", text, noun="surface")


def read_surface(file: h5py.File, path: str) -> Surface:
    """Return the surface of a group.

    Raises
    ------
    MalformedInputError
        If the group does not hold a surface.
    """
    form = attribute(file, path, "form")
    if form == _FORM_PRESCRIPTION:
        where = where_of(file, f"{path}/prescription")
        return prescription_from_toml(read_text(file, f"{path}/prescription"), where)
    if form == _FORM_NURBS:
        return _read_nurbs(file, path)
    if form != _FORM_SPLINE:
        raise MalformedInputError(
            f"form {form!r}", where=where_of(file, path), expected="spline, nurbs or prescription"
        )
    degree = attribute(file, path, "degree", int)
    coefficients = read_array(file, f"{path}/coefficients_mm", (None, None), finite=True)
    place = [attribute(file, path, name, float) for name in ("x0_mm", "y0_mm", "dx_mm", "dy_mm")]
    if degree not in {3, 5} or min(coefficients.shape) <= degree or not min(place[2:]) > 0.0:
        raise MalformedInputError(
            f"degree {degree}, coefficients {coefficients.shape}, cells of {place[2]} x {place[3]} mm",
            where=where_of(file, path),
            expected="degree 3 or 5, more coefficients than that, positive cells",
        )
    cells = read_array(file, f"{path}/cells", (None, None), "b")
    return SplineSurface(
        attribute(file, path, "kind"), place[0], place[1], place[2], place[3], degree, coefficients, cells
    )


def _write_nurbs(group: h5py.Group, patch: NurbsSurface) -> None:
    """Write all numbers of a patch: reading it again needs no CAD library."""
    group.attrs["form"] = _FORM_NURBS
    group.attrs["kind"] = patch.kind
    group.attrs["degree_u"], group.attrs["degree_v"] = patch.degree_u, patch.degree_v
    group.attrs["source"] = patch.source
    group.attrs["conversion_error_mm"] = patch.conversion_error_mm
    for name in ("knots_u", "knots_v", "control_mm", "weights"):
        write_array(group, name, getattr(patch, name), noun="surface")
    write_array(group, "loops_uv", np.concatenate(patch.loops_uv), noun="surface")
    write_array(group, "loop_sizes", [len(loop) for loop in patch.loops_uv], noun="surface")


def _read_nurbs(file: h5py.File, path: str) -> NurbsSurface:
    """Return the patch of a group."""
    control = read_array(file, f"{path}/control_mm", (None, None, 3), finite=True)
    loops = read_array(file, f"{path}/loops_uv", (None, 2), finite=True)
    sizes = read_array(file, f"{path}/loop_sizes", (None,), "i")
    if not len(sizes) or sizes.min() < 3 or sizes.sum() != len(loops):
        raise MalformedInputError(
            f"polygons of {sizes.tolist()[:8]} corners",
            where=where_of(file, f"{path}/loop_sizes"),
            expected=f"at least 3 each, {len(loops)} together",
        )
    try:
        return NurbsSurface.of(
            (attribute(file, path, "degree_u", int), attribute(file, path, "degree_v", int)),
            read_array(file, f"{path}/knots_u", (None,), finite=True),
            read_array(file, f"{path}/knots_v", (None,), finite=True),
            control,
            read_array(file, f"{path}/weights", control.shape[:2], finite=True),
            np.split(loops, np.cumsum(sizes)[:-1]),
            attribute(file, path, "source"),
            attribute(file, path, "conversion_error_mm", float),
        )
    except GeometryError as problem:
        raise MalformedInputError(
            problem.what, where=where_of(file, path), expected=problem.expected
        ) from None


def write_pose(group: h5py.Group, name: str, pose: Pose, *, noun: str = "") -> None:
    """Write a pose as a 4x4 matrix with the names of its frames."""
    write_array(group, name, pose.matrix(), noun=noun)
    group[name].attrs["target"] = pose.target
    group[name].attrs["source"] = pose.source


def read_pose(file: h5py.File, path: str) -> Pose:
    """Return a pose, bit for bit as it was written, after checking that it is a rigid motion.

    Raises
    ------
    InputError
        If it is not.
    """
    matrix = read_array(file, path, (4, 4), finite=True)
    target, source = attribute(file, path, "target"), attribute(file, path, "source")
    Pose.from_matrix(matrix, target, source, where=where_of(file, path))
    return Pose(matrix[:3, :3], matrix[:3, 3], target, source)


def write_nominal_group(group: h5py.Group, nominal: Nominal) -> None:
    """Write a nominal without its equidistant net."""
    group.attrs["side"] = nominal.side
    group.attrs["tip_radius_mm"] = float(nominal.tip_radius_mm)
    group.attrs["digest"] = nominal.digest
    write_surface(group, nominal.surface)
    write_pose(group, "surface_from_part", nominal.surface_from_part, noun="surface")
    if nominal.quality is not None:
        write_record(group.create_group("quality"), nominal.quality)


def read_nominal_group(file: h5py.File, path: str) -> Nominal:
    """Return a nominal without its equidistant net.

    Raises
    ------
    MalformedInputError
        If something is missing or out of range.
    """
    side = attribute(file, path, "side", int)
    radius = attribute(file, path, "tip_radius_mm", float)
    if side not in {-1, 1} or not (np.isfinite(radius) and radius >= 0.0):
        raise MalformedInputError(
            f"side {side}, tip radius {radius} mm",
            where=where_of(file, path),
            expected="side +1 or -1, radius >= 0",
        )
    has_quality = find(file, f"{path}/quality") is not None
    return Nominal(
        surface=read_surface(file, path),
        side=side,
        tip_radius_mm=radius,
        surface_from_part=read_pose(file, f"{path}/surface_from_part"),
        digest=attribute(file, path, "digest"),
        quality=read_record(file, f"{path}/quality", NominalQuality) if has_quality else None,
    )
