"""Terms of a sag: one file per family, each with height, gradient and Hessian in closed form."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

from cmm_align.errors import MalformedInputError
from cmm_align.surfaces.terms import (
    biconic,
    conic,
    even_asphere,
    odd_asphere,
    product_series,
    q_2d,
    q_bfs,
    q_con,
    toroid,
    xy_polynomial,
    zernike,
)
from cmm_align.surfaces.terms.placed import placed_from_table
from cmm_align.surfaces.terms.term import Term
from cmm_align.toml_table import did_you_mean

READERS: Final[dict[str, Callable[[Mapping[str, Any], str], Term]]] = {
    "conic": conic.from_table,
    "even_asphere": even_asphere.from_table,
    "odd_asphere": odd_asphere.from_table,
    "biconic": biconic.from_table,
    "toroid": toroid.from_table,
    "xy_polynomial": xy_polynomial.from_table,
    "zernike": zernike.from_table,
    "chebyshev": product_series.from_table,
    "legendre": product_series.from_table,
    "q_bfs": q_bfs.from_table,
    "q_con": q_con.from_table,
    "q_2d": q_2d.from_table,
}
"""How to read each kind of term: table and place -> term."""


def term_from_table(table: Mapping[str, Any], *, where: str) -> Term:
    """Return the term that a [[term]] table describes, in the frame it states.

    Raises
    ------
    MalformedInputError
        If the kind is not known (the nearest known one is named) or a key is wrong.
    """
    if not isinstance(table, Mapping):
        raise MalformedInputError(f"term = {table!r}", where=where, expected="a [[term]] table")
    if "kind" not in table:
        raise MalformedInputError("no kind", where=where, expected=f"one of {', '.join(READERS)}")
    kind = str(table["kind"])
    if kind not in READERS:
        raise MalformedInputError(f"unknown kind {kind!r}", where=where, remedy=did_you_mean(kind, READERS))
    return placed_from_table(READERS[kind](table, where), table, where)
