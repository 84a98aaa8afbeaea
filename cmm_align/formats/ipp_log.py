"""Result files and logs of I++ DME: what a server answered, with its client's commands or without.

Data lines of commands are points, tip centres; those of events (tags with E) are not. Without the commands a
scan is taken to report X, Y, Z, Q, as the protocol has it from the start of a session.
"""

from __future__ import annotations

import re
from typing import Final

from cmm_align.dialects import DIALECTS, MachineProfile
from cmm_align.errors import UnitsError
from cmm_align.formats.machine_text import read_dialect
from cmm_align.formats.source import Source
from cmm_align.formats.statements import first_lines
from cmm_align.model import PointKind, PointSet
from cmm_align.units import mm_per

_LINE: Final = re.compile(
    r"(?:[CS]: *|.*(?:sent|received): *)?(?:\d{5}|E\d{4}) (?:[&%#!](?: |$)|[A-Z]\w*\()", re.IGNORECASE
)


def recognises(head: bytes) -> bool:
    """Return whether one of the first lines has a tag of five characters before a mark or a command."""
    return any(map(_LINE.match, first_lines(head)))


def read(source: Source, units: str | None = None) -> PointSet:
    """Return the points of a log, tip centres, frame `machine`.

    Parameters
    ----------
    source : Source
        Its hint `columns` says what stands on a line of a scan, as ``x,y,z,q``.
    units : str, optional
        Must be mm if given: the protocol knows no other unit.

    Raises
    ------
    MalformedInputError
        With file, line, column and the offending text.
    UnitsError
        If another unit is given.
    """
    if units is not None and mm_per(units) != 1.0:
        raise UnitsError(
            f"I++ DME is in mm, --units says {units}", where=source.where, remedy="leave --units out"
        )
    profile = MachineProfile(dialect="ipp", columns=source.hints.columns or "", kind=PointKind.TIP_CENTRE)
    return read_dialect(source, DIALECTS["ipp"], profile, "responses as 00010 # X(1.0), Y(2.0), Z(3.0)")
