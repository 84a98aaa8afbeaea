"""Grid sag for OpticStudio: heights over the plane of projection, frame `surface`, mm."""

from __future__ import annotations

from collections.abc import Iterator

from cmm_align import formats
from cmm_align.formats.source import Source
from cmm_align.formats.zemax_grid_sag import read as read_sag
from cmm_align.posts.commanded import CommandedPoints
from cmm_align.posts.job import ExportJob
from cmm_align.units import mm_per


def blocks(job: ExportJob) -> Iterator[bytes]:
    """Give the text of the grid.

    Raises
    ------
    UsageError
        If it has fewer than five nodes along an axis.
    """
    correction = job.correction
    return formats.zemax_grid_sag_text(correction.x_mm, correction.y_mm, correction.commanded_z_mm)


def read(raw: bytes, where: str) -> CommandedPoints:
    """Return what stands in such a file: points in frame `surface`, without normals."""
    points = read_sag(Source(where, raw)).points_mm
    return CommandedPoints(points, None, None, "surface", 0.5e-3 * mm_per("nm"))
