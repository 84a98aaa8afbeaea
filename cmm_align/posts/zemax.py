"""Grid sag for OpticStudio: heights over the plane of projection, frame `surface`, mm."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from cmm_align import formats
from cmm_align.errors import MalformedInputError
from cmm_align.formats.zemax_grid_sag import recognises
from cmm_align.posts.commanded import CommandedPoints
from cmm_align.posts.job import ExportJob
from cmm_align.posts.numbers import table_of
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
    first, _, rest = raw.partition(b"\n")
    words = first.split()
    nx, ny = int(words[0]), int(words[1])
    table = table_of(rest, 5, where)
    if len(table) != nx * ny or words[4] != b"0":
        raise MalformedInputError(
            f"{len(table)} heights", where=where, expected=f"{nx} x {ny} = {nx * ny}, in mm (unitflag 0)"
        )
    dx, dy, x0, y0 = (float(words[k]) for k in (2, 3, 5, 6))
    row, column = np.divmod(np.flatnonzero(table[:, 4] == 0.0), nx)
    points = np.column_stack(
        [
            x0 + dx * (column - 0.5 * (nx - 1)),
            y0 - dy * (row - 0.5 * (ny - 1)),  # the upper row comes first
            table[row * nx + column, 0],
        ]
    )
    return CommandedPoints(points, None, None, "surface", 0.5e-3 * mm_per("nm"))
