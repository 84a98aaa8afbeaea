"""Points as text: x, y, z, or x, y, z and the unit normal i, j, k, in frame `part` or `grinder`, mm."""

from __future__ import annotations

from collections.abc import Iterator

from cmm_align import formats
from cmm_align.errors import MalformedInputError
from cmm_align.formats.points_header import read_header
from cmm_align.model import PointKind, PointSet
from cmm_align.posts.commanded import CommandedPoints, points_and_normals
from cmm_align.posts.job import ExportJob
from cmm_align.posts.numbers import table_of
from cmm_align.posts.rounding import least_normal_decimals, rounding_mm
from cmm_align.surfaces.protocol import Array


def xyz_blocks(job: ExportJob) -> Iterator[bytes]:
    """Give the text of the points."""
    points, _ = points_and_normals(job.correction)
    return formats.text_blocks(_commanded(points, job), decimals=job.decimals)


def xyzijk_blocks(job: ExportJob) -> Iterator[bytes]:
    """Give the text of points and normals."""
    points, normals = points_and_normals(job.correction)
    return formats.text_blocks(
        _commanded(points, job),
        decimals=job.decimals,
        normals=normals,
        normal_decimals=least_normal_decimals(job.wheel),
    )


def read(raw: bytes, where: str) -> CommandedPoints:
    """Return what stands in such a text.

    Raises
    ------
    MalformedInputError
        If its columns are not these.
    """
    start = 0
    while raw.startswith(b"#", start):
        start = raw.find(b"\n", start) + 1
    end = raw.find(b"\n", start)
    names = raw[start:end].strip()
    if b"units=mm" not in raw[:start] or names not in {b"x_mm,y_mm,z_mm", b"x_mm,y_mm,z_mm,i,j,k"}:
        raise MalformedInputError(
            f"columns {names[:60]!r}", where=where, expected="x_mm,y_mm,z_mm and perhaps i,j,k, in mm"
        )
    width = names.count(b",") + 1
    table = table_of(raw[end + 1 :], width, where, b",")
    first = raw[end + 1 : raw.find(b",", end)]
    return CommandedPoints(
        points_mm=table[:, :3],
        normals=table[:, 3:] if width == 6 else None,
        tool_centres_mm=None,
        frame=read_header(raw[: raw.find(b"\n")].decode("utf-8", "replace"), where).frame,
        accuracy_mm=rounding_mm(len(first.partition(b".")[2])),
    )


def _commanded(points: Array, job: ExportJob) -> PointSet:
    return PointSet.of(points, kind=PointKind.COMMANDED, frame=job.frame)
