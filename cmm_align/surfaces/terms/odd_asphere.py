"""Odd asphere: a conic plus ``sum A_n q^n`` of all powers from 1, ``q^2 = x^2 + y^2``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from cmm_align.surfaces.protocol import Array, Jet
from cmm_align.surfaces.terms.coefficients import by_index, positive
from cmm_align.surfaces.terms.conic import BASE_KEYS, Conic, base_from_table
from cmm_align.surfaces.terms.even_asphere import EvenAsphere, horner
from cmm_align.surfaces.terms.jet_algebra import plus, radial
from cmm_align.surfaces.terms.term import check_term_keys


@dataclass(frozen=True, slots=True)
class OddAsphere:
    """Conic base with a polynomial in the distance from the axis.

    Attributes
    ----------
    base : Conic
    coefficients : tuple of (int, float)
        ``(n, A_n)``, sorted.
    length : float
        Normalisation radius L: the powers are those of q / L.

    Notes
    -----
    A first power makes a cone: it has no normal at its tip, and the jet is NaN there.
    """

    base: Conic
    coefficients: tuple[tuple[int, float], ...]
    length: float

    def jet(self, x: Array, y: Array) -> Jet:
        """Return height and derivatives: even powers, powers from 3 on, and the cone of power 1."""
        even = tuple((n, value) for n, value in self.coefficients if n % 2 == 0)
        odd = {n: value for n, value in self.coefficients if n % 2}
        jet = EvenAsphere(self.base, even, self.length).jet(x, y) if even else self.base.jet(x, y)
        p, q = x / self.length, y / self.length
        cone = odd.pop(1, 0.0)
        if odd:
            jet = plus(jet, _from_third_power(odd, p, q, self.length))
        return plus(jet, _cone(cone, p, q, self.length)) if cone != 0.0 else jet


def _from_third_power(odd: Mapping[int, float], p: Array, q: Array, length: float) -> Jet:
    """Return the jet of ``r^3 P(r^2)``, ``r^2 = p^2 + q^2``; without a division by r.

    With ``f(v) = v^(3/2) P(v)``: ``f' = r (3/2 P + v P')`` and ``r f'' = 3/4 P + 3 v P' + v^2 P''``; the
    second derivatives need ``p q f''``, which is ``p (q / r) (r f'')``.
    """
    v = p * p + q * q
    r = np.sqrt(v)
    row = [0.0] * ((max(odd) - 3) // 2 + 1)
    for n, value in odd.items():
        row[(n - 3) // 2] = value
    f, f1, f2 = horner(row, v)
    jet = radial(p, q, r * v * f, r * (1.5 * f + v * f1), np.zeros_like(v), length)
    second = (3.0 * f + 12.0 * v * f1 + 4.0 * v * v * f2) / length**2
    safe = np.where(r > 0.0, r, 1.0)
    ps, qs = p / safe * second, q / safe * second
    return jet._replace(zxx=jet.zxx + ps * p, zxy=jet.zxy + ps * q, zyy=jet.zyy + qs * q)


def _cone(height: float, p: Array, q: Array, length: float) -> Jet:
    """Return the jet of ``A r``; NaN at the tip."""
    r = np.hypot(p, q)
    r = np.where(r > 0.0, r, np.nan)
    slope, bend = height / length / r, height / length**2 / r**3
    return Jet(height * r, slope * p, slope * q, bend * q * q, -bend * p * q, bend * p * p)


def from_table(table: Mapping[str, Any], where: str) -> OddAsphere:
    """Return the term of a table with `coefficients` ``{ "3" = A3, ... }`` and the optional conic and L."""
    check_term_keys(table, BASE_KEYS | {"normalization_radius", "coefficients"}, where)
    return OddAsphere(
        base_from_table(table, where),
        by_index(table, where, lowest=1),
        positive(table, "normalization_radius", where, default=1.0),
    )
