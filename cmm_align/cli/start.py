"""Where an alignment starts: as the part lies, from a matrix in a text file, or from an earlier alignment."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from cmm_align.errors import MalformedInputError, MissingFileError
from cmm_align.pose import Pose

_HDF5_MAGIC: Final = b"\x89HDF"
_LARGEST_TEXT: Final = 10_000


def start_pose(source: str) -> Pose:
    """Return ``part_from_machine`` to start from.

    Parameters
    ----------
    source : str
        ``identity``, or a file: a 4x4 matrix in mm as text, or an alignment.

    Raises
    ------
    MissingFileError
        If the file cannot be read.
    MalformedInputError
        If it holds no 4x4 matrix.
    """
    if source == "identity":
        return Pose.identity("part", "machine")
    try:
        content = Path(source).read_bytes()
    except OSError as error:
        raise MissingFileError(f"cannot read it ({error.strerror})", where=source) from None
    if content.startswith(_HDF5_MAGIC):
        from cmm_align.io import read_alignment

        return read_alignment(source).part_from_machine
    try:
        text = content[:_LARGEST_TEXT].decode("ascii")
        rows = [
            line.replace(",", " ").split() for line in text.splitlines() if line.strip() and line[0] != "#"
        ]
        matrix = np.array([[float(word) for word in row] for row in rows])
    except ValueError:
        matrix = np.empty(0)
    if matrix.shape != (4, 4):
        raise MalformedInputError(
            "not a start pose",
            where=source,
            expected="four rows of four numbers, part_from_machine in mm, or what align wrote",
        )
    return Pose.from_matrix(matrix, "part", "machine", where=source)
