"""Grid sag for OpticStudio: heights over the plane of projection, frame `surface`, mm."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from cmm_align import formats
from cmm_align.errors import MalformedInputError
from cmm_align.formats.source import Source
from cmm_align.formats.zemax_grid_sag import read as read_sag
from cmm_align.formats.zemax_grid_sag import recognises
from cmm_align.posts.commanded import CommandedPoints
from cmm_align.posts.job import ExportJob
from cmm_align.units import mm_per

_HEAD_BYTES: Final = 4096


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
    """Return what stands in such a file: points in frame `surface`, without normals.

    Raises
    ------
    MalformedInputError
        If it is none, or cut off.
    """
    if not recognises(raw[:_HEAD_BYTES]):
        raise MalformedInputError(
            "no grid sag file", where=where, expected="nx ny delx dely unitflag xdec ydec"
        )
    points = read_sag(Source(where, raw)).points_mm
    return CommandedPoints(points, None, None, "surface", 0.5e-3 * mm_per("nm"))
