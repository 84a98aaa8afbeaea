"""Names, units and meaning of everything in our HDF5 files, in one table.

A file's root carries `schema`, `schema_version`, `created_by` and, written last, `complete`.
"""

from __future__ import annotations

from typing import Final, NamedTuple

NOMINAL: Final = "cmm-align/nominal"
ALIGNMENT: Final = "cmm-align/alignment"
MAP: Final = "cmm-align/map"
CORRECTION: Final = "cmm-align/correction"

VERSION: Final = 2
"""Newest version of all schemas; a reader refuses newer ones and knows all older ones.

1: the first. 2: an alignment tells why points did not steer the fit (`status`) and which count (`judged`).
"""


class Stage(NamedTuple):
    """Words for messages about a kind of file."""

    noun: str
    maker: str
    """Command that writes it."""
    taker: str
    """What to do with it next."""


STAGES: Final[dict[str, Stage]] = {
    NOMINAL: Stage(
        "a nominal", "offset", "give it to `cmm-align align MEASURED NOMINAL` as the last argument"
    ),
    ALIGNMENT: Stage("an alignment", "align", "give it to `cmm-align error-map`"),
    MAP: Stage("a deviation map", "error-map", "give it to `cmm-align compensate`"),
    CORRECTION: Stage(
        "a correction", "compensate", "grind with its exports, measure, and `cmm-align align` anew"
    ),
}


class Dataset(NamedTuple):
    """Unit and meaning of a dataset."""

    units: str
    description: str


DATASETS: Final[dict[str, Dataset]] = {
    # A surface, wherever it lies (/surface, /nominal_surface, /equidistant/surface).
    "surface/coefficients_mm": Dataset("mm", "coefficients of the uniform tensor-product B-spline [iy, ix]"),
    "surface/cells": Dataset("1", "cells of a net over the same rectangle that hold surface [iy, ix]"),
    "surface/prescription": Dataset("1", "prescription as TOML text"),
    "surface/knots_u": Dataset("1", "knots of the rational B-spline patch along u, with multiplicity"),
    "surface/knots_v": Dataset("1", "knots of the rational B-spline patch along v, with multiplicity"),
    "surface/control_mm": Dataset("mm", "control points of the patch, frame surface [iu, iv, 3]"),
    "surface/weights": Dataset("1", "weights of the control points [iu, iv]"),
    "surface/loops_uv": Dataset("1", "outline and holes of the patch, one after the other: u, v"),
    "surface/loop_sizes": Dataset("1", "corners of each closed polygon in loops_uv"),
    "surface/surface_from_part": Dataset("mm", "4x4 motion that turns the projection direction to +z"),
    "nominal/points_mm": Dataset("mm", "nodes on the nominal, frame part"),
    "nominal/normals": Dataset("1", "unit normals of the nominal towards the probe, frame part"),
    "nominal/slope": Dataset("1", "slope of the nominal over its projection plane"),
    "nominal/gaussian_curvature_per_mm2": Dataset("1/mm^2", "Gaussian curvature of the nominal"),
    "equidistant/points_mm": Dataset(
        "mm",
        "centre of the ball, frame part: nominal + tip radius * normal, or the envelope where it is held off",
    ),
    "equidistant/triangles": Dataset("1", "Delaunay triangles of the projection: row numbers of points_mm"),
    "equidistant/regular": Dataset("1", "where tip radius * concave curvature < 1"),
    "equidistant/reach": Dataset(
        "1",
        "0 = the ball reaches the node, 1 = an edge that stands proud is touched first, "
        "2 = held off by another part of the surface, 3 = the surface is curved more than the ball",
    ),
    "nominal/least_curvature_per_mm": Dataset(
        "1/mm", "smaller principal curvature, positive = concave towards the probe"
    ),
    "nominal/most_curvature_per_mm": Dataset(
        "1/mm", "larger principal curvature, positive = concave towards the probe"
    ),
    "nominal/feature": Dataset("1", "where the principal curvatures differ by more than the threshold"),
    "pose/part_from_machine": Dataset("mm", "4x4 motion: p_part = R p_machine + t"),
    "pose/covariance": Dataset(
        "rad^2, rad mm, mm^2", "of (rx, ry, rz, tx, ty, tz) about the centroid, frame part"
    ),
    "points/tip_centre_machine_mm": Dataset("mm", "centres of the probe ball as measured, frame machine"),
    "points/tip_centre_part_mm": Dataset("mm", "centres of the probe ball, frame part"),
    "points/contact_part_mm": Dataset("mm", "tip centre - tip radius * normal, frame part"),
    "points/normal": Dataset("1", "unit normal of the nominal at the foot point, frame part"),
    "points/deviation_mm": Dataset("mm", "along the normal, positive = excess material"),
    "points/used": Dataset("1", "points that steered the fit"),
    "points/judged": Dataset("1", "points whose deviation counts in numbers and map"),
    "points/status": Dataset(
        "1",
        "0 = steered the fit, 1 = outside the nominal, 2 = outlier, 3 = in the edge band, "
        "4 = not reached by the ball, 5 = apart (outside the fit region)",
    ),
    "points/sigma_mm": Dataset("mm", "standard uncertainty of the deviation: simulated, or as stated"),
    "points/id": Dataset("1", "number of the point in its source"),
    "grid/x_mm": Dataset("mm", "grid along x, frame surface"),
    "grid/y_mm": Dataset("mm", "grid along y, frame surface"),
    "grid/deviation_mm": Dataset(
        "mm", "along the normal, positive = excess material, NaN = unknown [iy, ix]"
    ),
    "grid/sag_deviation_mm": Dataset("mm", "the same along +z of frame surface [iy, ix]"),
    "grid/sigma_mm": Dataset("mm", "standard uncertainty of deviation_mm [iy, ix]"),
    "comparison/x_mm": Dataset("mm", "common grid of both measurements along x, frame surface"),
    "comparison/y_mm": Dataset("mm", "common grid along y, frame surface"),
    "comparison/before_mm": Dataset(
        "mm",
        "earlier measurement, along the normal, positive = excess material, NaN = not known to both [iy, ix]",
    ),
    "comparison/after_mm": Dataset("mm", "this measurement, in the same way [iy, ix]"),
    "comparison/u_mm": Dataset("mm", "standard uncertainty of after_mm - before_mm [iy, ix]"),
    "comparison/changed": Dataset(
        "1", "where the difference, its rigid motion taken out, is beyond the noise [iy, ix]"
    ),
    "grid/correction_mm": Dataset("mm", "along the normal, negative removes material [iy, ix]"),
    "grid/total_correction_mm": Dataset("mm", "sum over all passes, relative to the nominal [iy, ix]"),
    "grid/commanded_z_mm": Dataset("mm", "height to command, frame surface [iy, ix]"),
    "grid/commanded_normal": Dataset("1", "unit normals of the commanded surface [iy, ix, 3]"),
    "grid/status": Dataset(
        "1",
        "0 = from the map, 1 = beyond what was measured, 2 = hole bridged, 3 = too few points, 4 = outside "
        "the region, 5 = continued past the range and held there [iy, ix]",
    ),
    "grid/extended": Dataset("1", "nodes without data of their own, continued from neighbours [iy, ix]"),
}
"""By the dataset's name and its group's."""
