"""Hits of PC-DMIS's GMServer, ``( X Y Z W I J K ) HIT``: tip centres.

Four numbers in brackets are the reply to a poll of the position, and no point.
"""

from __future__ import annotations

import re
from typing import Final

from cmm_align.dialects import DIALECTS, MachineProfile
from cmm_align.formats.machine_text import read_dialect
from cmm_align.formats.source import Source, scale_to_mm
from cmm_align.formats.statements import first_lines
from cmm_align.model import PointKind, PointSet

_BRACKETS: Final = re.compile(r"\s*\(( +[-+.\deE]+){4,7} *\)", re.ASCII)


def recognises(head: bytes) -> bool:
    """Return whether one of the first lines has four to seven numbers in brackets."""
    return any(map(_BRACKETS.match, first_lines(head)))


def read(source: Source, units: str | None = None) -> PointSet:
    """Return the hits of a log, tip centres, frame `machine`.

    Parameters
    ----------
    source : Source
    units : str, optional
        Unit of length; mm by default.

    Raises
    ------
    MalformedInputError
        With file, line, column and the offending text.
    """
    scale_to_mm("", units, source.where)
    profile = MachineProfile(dialect="gmserver", units=units or "mm", hit_code="", kind=PointKind.TIP_CENTRE)
    return read_dialect(source, DIALECTS["gmserver"], profile, "lines as ( X Y Z W I J K ) HIT")
