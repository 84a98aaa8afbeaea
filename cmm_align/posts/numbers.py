"""Numbers out of text that machines read, many lines at a time."""

from __future__ import annotations

import io
from collections.abc import Iterable

import numpy as np

from cmm_align.errors import MalformedInputError
from cmm_align.surfaces.protocol import Array


def table_of(lines: Iterable[bytes] | bytes, width: int, where: str, letters: bytes = b"") -> Array:
    """Return the numbers of lines that all look the same.

    Parameters
    ----------
    lines : iterable of bytes, or bytes
    width : int
        Numbers in each line.
    where : str
        Name of the file.
    letters : bytes
        Characters that stand between the numbers besides blanks.

    Returns
    -------
    ndarray, shape (n, width)

    Raises
    ------
    MalformedInputError
        If there is no line, or one has other than `width` numbers.
    """
    raw = lines if isinstance(lines, bytes) else b"\n".join(lines)
    table = bytes.maketrans(letters, b" " * len(letters))
    try:
        found = np.loadtxt(io.BytesIO(raw.translate(table)), dtype=np.float64, ndmin=2, comments=None)
    except ValueError as error:
        raise MalformedInputError(" ".join(str(error).split())[:120], where=where) from None
    if found.shape[1:] != (width,) or not len(found) or not np.isfinite(found).all():
        raise MalformedInputError(
            f"lines of {found.shape[1]} numbers", where=where, expected=f"{width} numbers in each line"
        )
    return found
