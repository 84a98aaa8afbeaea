"""Polynomial in x and y: ``z = sum C_ij (x/L)^i (y/L)^j``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from cmm_align.errors import MalformedInputError
from cmm_align.surfaces.protocol import Array, Jet
from cmm_align.toml_table import check_keys, number


@dataclass(frozen=True, slots=True)
class XYPolynomial:
    """Polynomial of mixed powers.

    Attributes
    ----------
    coefficients : tuple of (int, int, float)
        ``(i, j, C_ij)``, sorted.
    length : float
        Normalisation radius L.
    """

    coefficients: tuple[tuple[int, int, float], ...]
    length: float

    def jet(self, x: Array, y: Array) -> Jet:
        """Return height and derivatives by Horner's rule in y of Horner's rules in x."""
        u, v = x / self.length, y / self.length
        rows: dict[int, dict[int, float]] = {}
        for i, j, value in self.coefficients:
            rows.setdefault(j, {})[i] = value
        zero = np.zeros(np.shape(x))
        z, zu, zv, zuu, zuv, zvv = (zero.copy() for _ in range(6))
        for j in range(max(rows), -1, -1):
            # Horner with derivatives: q <- q v + p, q' <- q' v + q, q''/2 <- q''/2 v + q'.
            zvv = zvv * v + zv
            zv = zv * v + z
            zuv = zuv * v + zu
            p, pu, puu = _horner(rows.get(j, {}), u)
            z, zu, zuu = z * v + p, zu * v + pu, zuu * v + puu
        s = self.length
        return Jet(z, zu / s, zv / s, zuu / s**2, zuv / s**2, 2.0 * zvv / s**2)


def _horner(row: Mapping[int, float], u: Array) -> tuple[Array, Array, Array]:
    """Return a polynomial in u with its first and second derivative."""
    p, pu, puu = np.zeros(np.shape(u)), np.zeros(np.shape(u)), np.zeros(np.shape(u))
    for i in range(max(row, default=-1), -1, -1):
        puu = puu * u + pu
        pu = pu * u + p
        p = p * u + row.get(i, 0.0)
    return p, pu, 2.0 * puu


def from_table(table: Mapping[str, Any], where: str) -> XYPolynomial:
    """Return the term of a [[term]] table with `normalization_radius` and `coefficients`."""
    check_keys(table, {"kind", "normalization_radius", "coefficients"}, where=where)
    length = number(table, "normalization_radius", where=where, default=1.0)
    if length <= 0.0:
        raise MalformedInputError(f"normalization_radius = {length}", where=where, expected="> 0")
    values = table.get("coefficients")
    if not isinstance(values, Mapping) or not values:
        raise MalformedInputError(
            "no coefficients", where=where, expected='coefficients = { "i,j" = C, ... }'
        )
    terms = []
    for key in values:
        parts = [part.strip() for part in key.split(",")]
        if len(parts) != 2 or not all(part.isascii() and part.isdigit() for part in parts):
            raise MalformedInputError(f"power {key!r}", where=where, expected='two integers, as "2,0"')
        terms.append((int(parts[0]), int(parts[1]), number(values, key, where=where)))
    return XYPolynomial(tuple(sorted(terms)), length)
