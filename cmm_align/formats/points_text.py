"""Points as text of ours: what `delimited` reads back, in blocks ready to be written."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from cmm_align.formats.fixed_decimals import Field, Piece, lines_of
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
    normal_decimals: int = 9,
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
    normal_decimals : int
        Digits after the decimal point of the normals.
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
    fields = [Field(k, decimals) for k in range(3)]
    columns = [lengths[:, k] for k in range(3)]
    if normals is not None:
        names += ["i", "j", "k"]
        fields += [Field(k, normal_decimals) for k in range(3, 6)]
        columns += [normals[:, k] for k in range(3)]
    if with_ids:
        names.append("id")
        fields.append(Field(len(columns), 0))
        columns.append(points.ids.astype(np.float64))
    if points.sigma_mm is not None:
        names.append(f"sigma_{units}")
    if points.weight is not None:
        names.append("weight")
    comments = "".join(f"# {note}\n" for note in notes)
    header = header_line(units, points.kind, points.frame)
    yield f"{header}\n{comments}{','.join(names)}\n".encode("ascii")
    if points.sigma_mm is None and points.weight is None:
        pieces: list[Piece] = [piece for field in fields for piece in (field, b",")]
        yield from lines_of([*pieces[:-1], b"\n"], columns)
        return
    formats = [f"%.{field.decimals}f" for field in fields]
    if points.sigma_mm is not None:
        formats.append("%.3e")
        columns.append(points.sigma_mm / scale)
    if points.weight is not None:
        formats.append("%.9g")
        columns.append(points.weight)
    row = ",".join(formats) + "\n"
    for start in range(0, len(points), _BLOCK_ROWS):
        block = np.stack([column[start : start + _BLOCK_ROWS] for column in columns], axis=1)
        yield (row * len(block) % tuple(block.ravel().tolist())).encode("ascii")
