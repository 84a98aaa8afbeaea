"""A nominal as a formula: a prescription in TOML."""

from __future__ import annotations

import re
from typing import Final

from cmm_align.errors import UnitsError
from cmm_align.formats.decoding import decoded
from cmm_align.formats.source import Source
from cmm_align.surfaces.prescription import PrescriptionSurface, prescription_from_toml
from cmm_align.units import mm_per

_TELLS: Final = re.compile(
    rb"^\s*(?:schema\s*=\s*[\"']cmm-align/prescription|\[\[\s*term\s*\]\]|\[\s*aperture\s*\])", re.M
)
_UNITS: Final = re.compile(r"^\s*units\s*=\s*[\"'](\w+)[\"']", re.M)


def recognises(head: bytes) -> bool:
    """Return whether a file has the schema or one of the tables of a prescription."""
    return _TELLS.search(head) is not None


def read(source: Source, units: str | None = None) -> PrescriptionSurface:
    """Return the surface of a prescription.

    Parameters
    ----------
    source : Source
    units : str, optional
        Unit the user gave; must not differ from the one in the file.

    Raises
    ------
    MalformedInputError
        If the text is not a prescription.
    UnitsError
        If the file states another unit than `units`.
    """
    text = decoded(source.raw, source.where)
    stated = _UNITS.search(text)
    in_file = stated[1] if stated else "mm"
    if units and mm_per(units) != mm_per(in_file, where=source.where):
        raise UnitsError(f"the file is in {in_file}, --units says {units}", where=source.where)
    return prescription_from_toml(text, source.where)
