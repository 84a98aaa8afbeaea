"""Polynomial in x and y: ``z = sum C_ij (x/L)^i (y/L)^j``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from cmm_align.surfaces.protocol import Array, Jet
from cmm_align.surfaces.terms.coefficients import by_pair, positive
from cmm_align.surfaces.terms.term import check_term_keys


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
    check_term_keys(table, {"normalization_radius", "coefficients"}, where)
    return XYPolynomial(by_pair(table, where), positive(table, "normalization_radius", where, default=1.0))
