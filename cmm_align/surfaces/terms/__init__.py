"""Terms of a sag: one file per family, each with height, gradient and Hessian in closed form."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final, Protocol

from cmm_align.errors import MalformedInputError
from cmm_align.surfaces.protocol import Array, Jet
from cmm_align.surfaces.terms import conic, xy_polynomial
from cmm_align.toml_table import did_you_mean


class Term(Protocol):
    """One summand of the sag, in the unit of the prescription."""

    def jet(self, x: Array, y: Array) -> Jet:
        """Return height and derivatives at places of shape (n,); NaN where undefined."""
        ...


READERS: Final[dict[str, Callable[[Mapping[str, Any], str], Term]]] = {
    "conic": conic.from_table,
    "xy_polynomial": xy_polynomial.from_table,
}
"""How to read each kind of term: table and place -> term."""


def term_from_table(table: Mapping[str, Any], *, where: str) -> Term:
    """Return the term that a [[term]] table describes.

    Raises
    ------
    MalformedInputError
        If the kind is not known (the nearest known one is named) or a key is wrong.
    """
    kind = str(table.get("kind"))
    if kind not in READERS:
        raise MalformedInputError(f"unknown kind {kind!r}", where=where, remedy=did_you_mean(kind, READERS))
    return READERS[kind](table, where)
