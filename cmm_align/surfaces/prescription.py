"""A nominal given by its formula: the sag is the sum of terms over an aperture.

The TOML text itself is kept and stored, so that a file of ours holds the definition as it was written.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from typing import Final

from cmm_align import units
from cmm_align.errors import MalformedInputError
from cmm_align.surfaces.aperture import Aperture, aperture_from_table
from cmm_align.surfaces.protocol import Array, Bounds, Jet, Mask
from cmm_align.surfaces.terms import term_from_table
from cmm_align.surfaces.terms.term import Term
from cmm_align.toml_table import check_keys

SCHEMA: Final = "cmm-align/prescription/1"


@dataclass(frozen=True, slots=True)
class PrescriptionSurface:
    """Sum of sag terms over an aperture; lengths in mm whatever the unit of the text.

    Attributes
    ----------
    terms : tuple of Term
    aperture : Aperture
    mm_per_unit : float
        Length of the text's unit, mm.
    toml_text : str
        The definition as it was read.
    """

    terms: tuple[Term, ...]
    aperture: Aperture
    mm_per_unit: float
    toml_text: str
    kind: str = "prescription"

    @property
    def bounds(self) -> Bounds:
        """Rectangle that holds the aperture, mm."""
        return Bounds(*(value * self.mm_per_unit for value in self.aperture.bounds))

    def jet(self, x_mm: Array, y_mm: Array) -> Jet:
        """Return height and derivatives in closed form; NaN where a term is not defined."""
        unit = self.mm_per_unit
        x, y = x_mm / unit, y_mm / unit
        jets = [term.jet(x, y) for term in self.terms]
        z, zx, zy, zxx, zxy, zyy = (sum(parts[1:], parts[0]) for parts in zip(*jets, strict=True))
        return Jet(z * unit, zx, zy, zxx / unit, zxy / unit, zyy / unit)

    def contains(self, x_mm: Array, y_mm: Array) -> Mask:
        """Return whether places lie in the aperture."""
        return self.aperture.contains(x_mm / self.mm_per_unit, y_mm / self.mm_per_unit)


def prescription_from_toml(text: str, where: str) -> PrescriptionSurface:
    """Return the surface that a prescription describes.

    Parameters
    ----------
    text : str
        TOML as in the README's "Prescriptions".
    where : str
        Name of the file, for messages.

    Raises
    ------
    MalformedInputError
        If the text is not TOML, or a key or kind is not known (the nearest known one is named).
    """
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise MalformedInputError(f"not valid TOML: {error}", where=where) from None
    check_keys(table, {"schema", "units", "aperture", "term", "name"}, where=where)
    if table.get("schema") != SCHEMA:
        raise MalformedInputError(
            f"schema is {table.get('schema')!r}", where=f"{where}:schema", expected=repr(SCHEMA)
        )
    terms = table.get("term", [])
    if not isinstance(terms, list) or not terms:
        raise MalformedInputError("no [[term]]", where=where, expected="at least one term of the sag")
    return PrescriptionSurface(
        tuple(term_from_table(t, where=f"{where}:term[{k}]") for k, t in enumerate(terms, 1)),
        aperture_from_table(table.get("aperture"), where=f"{where}:aperture"),
        units.mm_per(str(table.get("units", "mm")), where=f"{where}:units"),
        text,
    )
