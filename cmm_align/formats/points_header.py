"""The first line of our own text files, and the names of columns."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from cmm_align.errors import MalformedInputError, UnitsError
from cmm_align.model import PointKind
from cmm_align.units import MM_PER, mm_per

MARK: Final = "# cmm-align points"
FRAMES: Final = ("machine", "part")
_VERSION: Final = "v1"

_UNIT = r"(?:nm|um|µm|μm|mm|cm|m|inch|in)"
_NAME: Final = re.compile(rf"(?P<name>.*?)(?:[\s_]*[\[(]\s*(?P<a>{_UNIT})\s*[\])]|[\s_](?P<b>{_UNIT}))?")
_WORDS: Final = {
    "x": ("x", "xact", "actualx", "xactual", "measx", "xmeas", "xmeasured"),
    "y": ("y", "yact", "actualy", "yactual", "measy", "ymeas", "ymeasured"),
    "z": ("z", "zact", "actualz", "zactual", "measz", "zmeas", "zmeasured"),
    "i": ("i", "nx", "normalx"),
    "j": ("j", "ny", "normaly"),
    "k": ("k", "nz", "normalz"),
    "id": ("id", "nr", "no", "point", "pointid", "pointnumber"),
    "sigma": ("sigma", "u", "uncertainty"),
    "weight": ("weight",),
}
_MEANING: Final = {word: name for name, words in _WORDS.items() for word in words}


class Header(NamedTuple):
    """What the first line of a file of ours states; empty where it does not."""

    units: str = ""
    kind: PointKind = PointKind.UNSTATED
    frame: str = "machine"


@dataclass(frozen=True, slots=True)
class Columns:
    """Where the columns are, by meaning: x, y, z and perhaps i, j, k, id, sigma, weight."""

    index: dict[str, int]
    count: int
    units: str


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


def name_and_unit(written: str) -> tuple[str, str]:
    """Return the bare name of a column and its unit of length, empty where it states none.

    Examples
    --------
    >>> name_and_unit("Actual X [mm]")
    ('actualx', 'mm')
    >>> name_and_unit("lower_um")
    ('lower', 'um')
    """
    text = written.strip().strip("\"'").strip().lower()
    match = _NAME.fullmatch(text)
    if match is None:
        return "", ""
    return re.sub(r"[\s_.]", "", match["name"]), match["a"] or match["b"] or ""


def read_columns(names: Sequence[str], where: str) -> Columns:
    """Return which column means what; columns with other names are passed over.

    Parameters
    ----------
    names : sequence of str
        Names as written: ``x``, ``X_mm``, ``Y [mm]``, ``actual z``, ``i``, ``id``, ``sigma_um`` ...

    Raises
    ------
    MalformedInputError
        If x, y or z is missing, or a name is there twice.
    UnitsError
        If the columns state different units.
    """
    index: dict[str, int] = {}
    units: set[str] = set()
    for position, written in enumerate(names):
        bare, unit = name_and_unit(written)
        name = _MEANING.get(bare)
        if name is None:
            continue
        if name in index:
            raise MalformedInputError(f"two columns mean {name}", where=where, expected="each name once")
        index[name] = position
        if unit and name in {"x", "y", "z", "sigma"}:
            units.add(unit)
    if not {"x", "y", "z"} <= set(index):
        line = " ".join(names)
        raise MalformedInputError(
            f"{line[:40]!r} is neither numbers nor names of columns", where=where, expected="columns x, y, z"
        )
    if len({MM_PER[u] for u in units}) > 1:
        raise UnitsError(f"columns in {' and '.join(sorted(units))}", where=where, expected="one unit")
    return Columns(index, len(names), min(units) if units else "")
