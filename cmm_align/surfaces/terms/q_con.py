"""Q_con of Forbes: departures from a conic along z, orthogonal in height."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from cmm_align.surfaces.protocol import Array, Jet
from cmm_align.surfaces.terms.coefficients import by_index, positive
from cmm_align.surfaces.terms.conic import BASE_KEYS, Conic, base_from_table
from cmm_align.surfaces.terms.jet_algebra import plus, radial
from cmm_align.surfaces.terms.recurrence import combine, dense, jacobi_steps, tabulate
from cmm_align.surfaces.terms.term import check_term_keys


@dataclass(frozen=True, slots=True)
class QCon:
    """``z = base + u^4 sum a_n Q_n(u^2)``, ``u = q / L``.

    Attributes
    ----------
    base : Conic
    coefficients : tuple of (int, float)
        ``(n, a_n)``, sorted.
    length : float
        Normalisation radius L, the half aperture.
    """

    base: Conic
    coefficients: tuple[tuple[int, float], ...]
    length: float

    def jet(self, x: Array, y: Array) -> Jet:
        """Return height and derivatives.

        Notes
        -----
        ``Q_n(v) = P_n^(0, 4)(2 v - 1)``: Forbes 2007, doi 10.1364/OE.15.005218; sums in Forbes 2010, doi
        10.1364/OE.18.013851, section 5.
        """
        p, q = x / self.length, y / self.length
        v = p * p + q * q
        row = dense(self.coefficients)
        s, s1, s2 = combine(row, tabulate(1.0, jacobi_steps(4, len(row) - 1), v))
        f1 = v * (2.0 * s + v * s1)
        f2 = 2.0 * s + v * (4.0 * s1 + v * s2)
        jet = radial(p, q, v * v * s, f1, f2, self.length)
        return jet if self.base.curvature == 0.0 else plus(self.base.jet(x, y), jet)


def from_table(table: Mapping[str, Any], where: str) -> QCon:
    """Return the term of a table with base, `normalization_radius` and `coefficients` ``{ "0" = C }``."""
    check_term_keys(table, BASE_KEYS | {"normalization_radius", "coefficients"}, where)
    return QCon(
        base_from_table(table, where),
        by_index(table, where),
        positive(table, "normalization_radius", where),
    )
