"""The first line of our own text files."""

from __future__ import annotations

from typing import Final, NamedTuple

from cmm_align.errors import MalformedInputError
from cmm_align.model import PointKind
from cmm_align.units import mm_per

MARK: Final = "# cmm-align points"
FRAMES: Final = ("machine", "part", "grinder")
_VERSION: Final = "v1"


class Header(NamedTuple):
    """What the first line of a file of ours states; empty where it does not."""

    units: str = ""
    kind: PointKind = PointKind.UNSTATED
    frame: str = "machine"


def header_line(units: str, kind: PointKind, frame: str) -> str:
    """Return the first line of a file of ours, without its line end."""
    return f"{MARK} {_VERSION}; units={units}; kind={kind.value}; frame={frame}"


def read_header(line: str, where: str) -> Header:
    """Return what a line that starts with `MARK` states; keys that are not known are passed over.

    Raises
    ------
    MalformedInputError
        If its version, kind or frame is not known.
    UnitsError
        If its unit is not known.
    """
    version, *pairs = (part.strip() for part in line.removeprefix(MARK).split(";"))
    if version != _VERSION:
        raise MalformedInputError(
            f"version {version!r} of a points file", where=where, expected=_VERSION, remedy="update cmm-align"
        )
    table = {key.strip(): value.strip() for key, _, value in (pair.partition("=") for pair in pairs)}
    units = table.get("units", "")
    if units:
        mm_per(units, where=where)
    kind, frame = table.get("kind", PointKind.UNSTATED.value), table.get("frame", "machine")
    if kind not in set(PointKind):
        raise MalformedInputError(f"kind={kind}", where=where, expected=f"one of {', '.join(PointKind)}")
    if frame not in FRAMES:
        raise MalformedInputError(f"frame={frame}", where=where, expected=f"one of {', '.join(FRAMES)}")
    return Header(units, PointKind(kind), frame)
