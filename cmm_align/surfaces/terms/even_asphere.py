"""Even asphere: a conic plus ``sum A_n q^n`` of even powers, ``q^2 = x^2 + y^2``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cmm_align.surfaces.protocol import Array, Jet
from cmm_align.surfaces.terms.coefficients import by_index, positive
from cmm_align.surfaces.terms.conic import BASE_KEYS, Conic, base_from_table
from cmm_align.surfaces.terms.jet_algebra import plus, radial
from cmm_align.surfaces.terms.term import check_term_keys


@dataclass(frozen=True, slots=True)
class EvenAsphere:
    """Conic base with a polynomial in the squared distance from the axis.

    Attributes
    ----------
    base : Conic
    coefficients : tuple of (int, float)
        ``(n, A_n)``, n even, sorted.
    length : float
        Normalisation radius L: the powers are those of q / L.
    """

    base: Conic
    coefficients: tuple[tuple[int, float], ...]
    length: float

    def jet(self, x: Array, y: Array) -> Jet:
        """Return height and derivatives by Horner's rule in ``q^2``."""
        p, q = x / self.length, y / self.length
        row = [0.0] * (self.coefficients[-1][0] // 2 + 1)
        for n, value in self.coefficients:
            row[n // 2] = value
        f, f1, f2 = horner(row, p * p + q * q)
        jet = radial(p, q, f, f1, f2, self.length)
        return jet if self.base.curvature == 0.0 else plus(self.base.jet(x, y), jet)


def horner(row: Sequence[float], v: Array) -> tuple[Array, Array, Array]:
    """Return ``sum row[k] v^k`` with first and second derivative, each of shape (n,) like v."""
    p, p1, p2 = np.zeros(np.shape(v)), np.zeros(np.shape(v)), np.zeros(np.shape(v))
    for value in reversed(row):
        # p <- p v + a, p' <- p' v + p, p''/2 <- p''/2 v + p', the last one first.
        p2 *= v
        p2 += p1
        p1 *= v
        p1 += p
        p *= v
        p += value
    p2 *= 2.0
    return p, p1, p2


def from_table(table: Mapping[str, Any], where: str) -> EvenAsphere:
    """Return the term of a table with `coefficients` ``{ "4" = A4, ... }`` and the optional conic and L."""
    check_term_keys(table, BASE_KEYS | {"normalization_radius", "coefficients"}, where)
    return EvenAsphere(
        base_from_table(table, where),
        by_index(table, where, lowest=2, step=2),
        positive(table, "normalization_radius", where, default=1.0),
    )
