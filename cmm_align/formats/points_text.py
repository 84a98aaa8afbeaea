"""Points as text of ours: what `delimited` reads back, in blocks ready to be written."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from cmm_align.formats.points_header import header_line
from cmm_align.model import PointSet
from cmm_align.surfaces.protocol import Array
from cmm_align.units import mm_per

_BLOCK_ROWS: Final = 8192


def text_blocks(
    points: PointSet,
    *,
    units: str = "mm",
    decimals: int = 6,
    normals: Array | None = None,
    with_ids: bool = False,
    notes: Sequence[str] = (),
) -> Iterator[bytes]:
    """Give a text file of ours, block by block.

    Parameters
    ----------
    points : PointSet
    units : str
        Unit of length in the file.
    decimals : int
        Digits after the decimal point of lengths, in `units`.
    normals : ndarray, shape (N, 3), optional
        Unit vectors for the columns i, j, k, in the frame of the points.
    with_ids : bool
        Whether to write the column `id`.
    notes : sequence of str
        Lines for people, written as comments under the header.

    Yields
    ------
    bytes
        ASCII; the first block is the header and the names of the columns.
    """
    scale = mm_per(units)
    lengths = points.points_mm if scale == 1.0 else points.points_mm / scale
    names = [f"{axis}_{units}" for axis in "xyz"]
    formats = [f"%.{decimals}f"] * 3
    columns = [lengths]
    if normals is not None:
        names += ["i", "j", "k"]
        formats += ["%.9f"] * 3
        columns.append(normals)
    if with_ids:
        names.append("id")
        formats.append("%d")
        columns.append(points.ids[:, None].astype(np.float64))
    if points.sigma_mm is not None:
        names.append(f"sigma_{units}")
        formats.append("%.3e")
        columns.append(points.sigma_mm[:, None] / scale)
    if points.weight is not None:
        names.append("weight")
        formats.append("%.9g")
        columns.append(points.weight[:, None])
    row = ",".join(formats) + "\n"
    comments = "".join(f"# {note}\n" for note in notes)
    header = header_line(units, points.kind, points.frame)
    yield f"{header}\n{comments}{','.join(names)}\n".encode("ascii")
    for start in range(0, len(points), _BLOCK_ROWS):
        block = np.concatenate([column[start : start + _BLOCK_ROWS] for column in columns], axis=1)
        yield (row * len(block) % tuple(block.ravel().tolist())).encode("ascii")
