"""Q_bfs of Forbes: departures from a sphere (or conic) along its normal, orthogonal in slope."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from cmm_align.surfaces.protocol import Array, Jet
from cmm_align.surfaces.terms.coefficients import by_index, positive
from cmm_align.surfaces.terms.conic import BASE_KEYS, Conic, base_from_table
from cmm_align.surfaces.terms.forbes_slope import slope_sums
from cmm_align.surfaces.terms.jet_algebra import plus, radial, times
from cmm_align.surfaces.terms.recurrence import dense
from cmm_align.surfaces.terms.term import check_term_keys


@dataclass(frozen=True, slots=True)
class QBfs:
    """``z = base + u^2 (1 - u^2) / cos(a) sum a_n Q_n(u^2)``, ``u = q / L``, a the slope angle of the base.

    Attributes
    ----------
    base : Conic
        A sphere in Forbes' papers of 2007 and 2010; with another conic constant the departure is along the
        conic's normal in the same way.
    coefficients : tuple of (int, float)
        ``(n, a_n)``, sorted.
    length : float
        Normalisation radius L, the half aperture.
    """

    base: Conic
    coefficients: tuple[tuple[int, float], ...]
    length: float

    def jet(self, x: Array, y: Array) -> Jet:
        """Return height and derivatives (Forbes 2010, doi 10.1364/OE.18.019700, eq. 3.13)."""
        p, q = x / self.length, y / self.length
        v = p * p + q * q
        f, f1, f2 = rim_and_centre(v, slope_sums(0, [dense(self.coefficients)], v)[0])
        return on_base(self.base, radial(p, q, f, f1, f2, self.length), x, y)


def rim_and_centre(v: Array, sums: Array) -> Array:
    """Return ``v (1 - v) S(v)``: it vanishes at centre and rim.

    Parameters
    ----------
    v : Array
        Squared normalised radius, shape (n,).
    sums : Array
        S with its derivatives, shape (3, n).

    Returns
    -------
    Array, shape (3, n)
        Value, first and second derivative by v.
    """
    s, s1, s2 = sums
    w, w1 = v * (1.0 - v), 1.0 - 2.0 * v
    return np.stack([w * s, w1 * s + w * s1, 2.0 * (w1 * s1 - s) + w * s2])


def on_base(base: Conic, departure: Jet, x: Array, y: Array) -> Jet:
    """Return base plus departure / cos(a); departure, x and y of shape (n,)."""
    if base.curvature == 0.0:
        return departure
    return plus(base.jet(x, y), times(base.obliquity(x, y), departure))


def from_table(table: Mapping[str, Any], where: str) -> QBfs:
    """Return the term of a table with base, `normalization_radius` and `coefficients` ``{ "0" = C }``."""
    check_term_keys(table, BASE_KEYS | {"normalization_radius", "coefficients"}, where)
    return QBfs(
        base_from_table(table, where),
        by_index(table, where),
        positive(table, "normalization_radius", where),
    )
