"""What the names of columns mean, in English and German: X/Y/Z, Istwert/Sollwert, x_act, ``Z [µm]`` ..."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

from cmm_align.errors import MalformedInputError, UsageError
from cmm_align.units import MM_PER

AXES: Final = ("x", "y", "z")
NOT_WANTED: Final = {"", "-", "_"}
"""How `--columns` writes a column that is passed over."""

_UNIT = r"(?:nm|um|µm|μm|mm|cm|m|inch|in)"
_NAME: Final = re.compile(
    rf"(?P<name>.*?)(?:[\s_]*[\[(]\s*(?P<a>{_UNIT})\s*[\])]|[\s_](?P<b>{_UNIT})|\s*/\s*(?P<c>{_UNIT}))?"
)
_ACTUAL: Final = "ist istwert actual act actuals meas measured measurement mess messwert gemessen aktuell"
_NOMINAL: Final = "soll sollwert nominal nom theo theoretical theor design"
_PLAIN: Final = "wert koordinate koord achse coordinate coord position pos axis value"
_WORDS: Final = {
    "i": "i nx normalx normalex",
    "j": "j ny normaly normaley",
    "k": "k nz normalz normalez",
    "id": "id nr no num nummer number index lfdnr name bezeichnung merkmal label pt pnt point pointid"
    " pointnumber pointno pointname punkt punktnr punktnummer punktname",
    "sigma": "sigma u uncertainty unsicherheit messunsicherheit",
    "weight": "weight gewicht gewichtung",
    "quality": "quality qualität qualitaet q güte guete",
    "unit": "unit units einheit masseinheit maßeinheit uom",
}


def _coordinates() -> dict[str, str]:
    """Return the words for measured and nominal coordinates."""
    meaning = {}
    for axis in AXES:
        meaning[axis] = axis
        for words, name in ((_ACTUAL, axis), (_PLAIN, axis), (_NOMINAL, f"nominal {axis}")):
            for word in words.split():
                meaning[axis + word] = meaning[word + axis] = name
    return meaning


_ROLES: Final = dict.fromkeys(_ACTUAL.split(), "") | dict.fromkeys(_NOMINAL.split(), "nominal ")
_MEANING: Final = {word: name for name, words in _WORDS.items() for word in words.split()} | _coordinates()
_VECTOR: Final = {"u": "i", "v": "j", "w": "k"}


@dataclass(frozen=True, slots=True)
class Columns:
    """Where the columns are, by meaning: x, y, z and perhaps i, j, k, id, sigma, weight, quality, unit."""

    index: dict[str, int]
    count: int
    units: dict[str, str] = field(default_factory=dict)
    """Unit of length of the columns that state one, by meaning."""
    is_nominal: bool = False
    """Whether x, y, z are coordinates of the design: no others are there."""


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
    return re.sub(r"[\s_.\-]", "", match["name"]), match["a"] or match["b"] or match["c"] or ""


def is_unit(written: str) -> str:
    """Return the unit of length that a field is, with brackets or without; empty if it is none."""
    bare = written.strip().strip("[]()\"'").strip().lower()
    return bare if bare in MM_PER else ""


def role_of(written: str) -> str | None:
    """Return ``nominal `` or an empty string for a heading as Sollwert or Istwert; None if it is neither."""
    return _ROLES.get(name_and_unit(written)[0])


def read_columns(names: Sequence[str], where: str, roles: Sequence[str] = ()) -> Columns:
    """Return which column means what; columns with other names are passed over.

    Parameters
    ----------
    names : sequence of str
        Names as written: ``x``, ``X_mm``, ``Y [mm]``, ``Istwert Z``, ``i``, ``Nr.``, ``sigma_um`` ...
    where : str
        Place of the line of names.
    roles : sequence of str
        What the line above says of each column: ``nominal `` or empty.

    Raises
    ------
    MalformedInputError
        If x, y or z is missing, or a name is there twice.
    """
    index: dict[str, int] = {}
    units: dict[str, str] = {}
    bare = [name_and_unit(written)[0] for written in names]
    vector = _VECTOR if set(_VECTOR) <= set(bare) else {}
    meanings = [vector.get(name) or _MEANING.get(name) for name in bare]
    for position, (written, meaning) in enumerate(zip(names, meanings, strict=True)):
        if meaning is None:
            continue
        name = f"{roles[position]}{meaning}" if roles and meaning in AXES else meaning
        if name in index:
            if name in {"id", "quality", "unit"}:
                continue  # a number and a name, say: the first one counts
            raise MalformedInputError(
                f"two columns mean {name}",
                where=where,
                expected="each name once",
                remedy='say which with --columns "id,x,y,z" (- for a column that is not wanted)',
            )
        index[name] = position
        if unit := name_and_unit(written)[1]:
            units[name] = unit
    nominal = [f"nominal {axis}" for axis in AXES]
    is_nominal = not set(AXES) & set(index) and set(nominal) <= set(index)
    if is_nominal:
        index |= {axis: index[name] for axis, name in zip(AXES, nominal, strict=True)}
        units |= {axis: units[name] for axis, name in zip(AXES, nominal, strict=True) if name in units}
    if not set(AXES) <= set(index):
        line = " ".join(names)
        raise MalformedInputError(
            f"{line[:40]!r} is neither numbers nor names of columns",
            where=where,
            expected="columns x, y, z",
            remedy='name them with --columns "x,y,z"',
        )
    for table in (index, units):
        for name in nominal:
            table.pop(name, None)
    return Columns(index, len(names), units, is_nominal)


def given_columns(given: str) -> Columns:
    """Return the columns that the user names in order, as ``id,x,y,z``; ``-`` is one that is not wanted.

    Raises
    ------
    UsageError
        If x, y or z is missing, or a name is not known or there twice.
    """
    names = [name.strip().lower() for name in given.split(",")]
    known = {name for name in names if _MEANING.get(name_and_unit(name)[0]) is not None}
    unknown = next((name for name in names if name not in known | NOT_WANTED), None)
    if unknown is not None:
        raise UsageError(
            f"--columns {given}: {unknown!r} is not known",
            expected="x, y, z, i, j, k, id, sigma, weight, quality, unit, or - for one that is not wanted",
        )
    try:
        return read_columns(names, "--columns")
    except MalformedInputError as error:
        raise UsageError(f"--columns {given}: {error.what}", expected=error.expected) from None
