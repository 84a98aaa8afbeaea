"""Points as a NumPy array in a `.npy` file: (N, 3), or (ny, nx, 3) for a grid."""

from __future__ import annotations

import io
import math

import numpy as np

from cmm_align.errors import MalformedInputError
from cmm_align.formats.source import Source, scale_to_mm
from cmm_align.model import PointSet

MAGIC = b"\x93NUMPY"


def recognises(head: bytes) -> bool:
    """Return whether a file starts as `.npy` does."""
    return head.startswith(MAGIC)


def read(source: Source, units: str | None = None) -> PointSet:
    """Return the points of an array; pickled objects are never loaded.

    Parameters
    ----------
    source : Source
    units : str, optional
        Unit of length; mm by default, the file cannot state it.

    Raises
    ------
    MalformedInputError
        If the file is cut off, or the array is not one of points.
    """
    stream = io.BytesIO(source.raw)
    try:
        version = np.lib.format.read_magic(stream)
        header = (
            np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        )
        shape, _, dtype = header(stream)
    except (ValueError, OSError, SyntaxError, TypeError) as error:
        raise MalformedInputError(f"a damaged .npy file ({error})", where=source.where) from None
    if dtype.kind not in "fiu" or len(shape) not in {2, 3} or shape[-1] != 3:
        raise MalformedInputError(
            f"an array of {dtype} of shape {shape}",
            where=source.where,
            expected="numbers of shape (N, 3) or (ny, nx, 3)",
        )
    wanted, there = math.prod(shape) * dtype.itemsize, len(source.raw) - stream.tell()
    if wanted != there:
        raise MalformedInputError(
            f"the file is incomplete ({there} of {wanted} bytes of data)",
            where=source.where,
            remedy="make it again",
        )
    array = np.load(io.BytesIO(source.raw), allow_pickle=False)
    scale = scale_to_mm("", units, source.where)
    return PointSet.of(array.reshape(-1, 3).astype(np.float64) * scale, source=source.where)
