"""Points behind letters, ``X100.000,Y200.000,Z300.000`` or ``X100000,Y200000,Z300000[,W2455]``: tip centres.

These are the line shapes 3, 4, 7 and 8 that PC-DMIS's GMServer takes from a "Generic CMM"; the shapes without
letters are delimited text. Whole numbers are counts of a machine whose scale the file does not state.
"""

from __future__ import annotations

import re
from collections import Counter
from itertools import islice
from typing import Final

from cmm_align.dialects import DIALECTS, MachineProfile
from cmm_align.errors import UnitsError
from cmm_align.formats.decoding import decoded
from cmm_align.formats.machine_text import read_dialect
from cmm_align.formats.source import Source, scale_to_mm
from cmm_align.formats.statements import SHOWN, first_lines
from cmm_align.model import PointKind, PointSet

_NUMBER: Final = r" *[+-]?\d+(?:\.(\d+))?"
_BETWEEN: Final = r"[ \t]*[,; \t][ \t]*"
_SHAPE: Final = re.compile(
    rf"\s*{_BETWEEN.join(axis + _NUMBER for axis in 'XYZ')}(?P<w>{_BETWEEN}W.*)?\s*", re.ASCII
)
_LOOKED_AT: Final = 1000
_MOST: Final = 0.95
"""A share of numbers with the same count of decimals, reached by machines that always print so many."""
_ANGLES: Final = 0.1
"""Degrees of a count of the rotary table: as GMServer's example, W2455 is 245.5 degrees."""


def recognises(head: bytes) -> bool:
    """Return whether one of the first lines has the letters X, Y and Z before its numbers."""
    return any(map(_SHAPE.fullmatch, first_lines(head)))


def read(source: Source, units: str | None = None) -> PointSet:
    """Return the points of a dump, tip centres, frame `machine`.

    Parameters
    ----------
    source : Source
    units : str, optional
        Unit of length, mm by default; must be given for counts: ``um`` for counts of a micrometre.

    Raises
    ------
    MalformedInputError
        With file, line, column and the offending text.
    UnitsError
        If the numbers are counts, and no unit is given.
    """
    lines = (line for line in decoded(source.raw, source.where).split("\n") if line.strip())
    shapes = [match for match in map(_SHAPE.fullmatch, islice(lines, _LOOKED_AT)) if match is not None]
    digits = Counter(len(match[k] or "") for match in shapes for k in (1, 2, 3))
    usual, often = digits.most_common(1)[0] if digits else (-1, 0)
    decimals = usual if often >= _MOST * digits.total() else -1
    counts = decimals == 0
    if counts and units is None:
        first = shapes[0][0].strip()[:SHOWN]
        raise UnitsError(
            f"{first!r} has two readings: whole millimetres, or counts of the machine",
            where=f"{source.where}:1:1",
            expected="--units um for counts of a micrometre, --units mm for millimetres",
        )
    scale_to_mm("", units, source.where)
    profile = MachineProfile(
        dialect="xyz_letters",
        columns="x,y,z,w" if any(match["w"] for match in shapes) else "x,y,z",
        decimals=decimals,
        units=units or "mm",
        rotary_scale=_ANGLES if counts else 1.0,
        kind=PointKind.TIP_CENTRE,
    )
    return read_dialect(source, DIALECTS["xyz_letters"], profile, "lines as X1.000,Y2.000,Z3.000")
