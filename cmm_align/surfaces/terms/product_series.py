"""Products of Chebyshev's or Legendre's polynomials over a rectangle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from cmm_align.surfaces.protocol import Array, Jet
from cmm_align.surfaces.terms.coefficients import by_pair, positive
from cmm_align.surfaces.terms.recurrence import Step, combine, dense, tabulate
from cmm_align.surfaces.terms.term import check_term_keys


@dataclass(frozen=True, slots=True)
class ProductSeries:
    """``z = sum C_ij P_i(x / a) P_j(y / b)``, P_n(1) = 1.

    Attributes
    ----------
    family : str
        chebyshev (first kind) or legendre.
    coefficients : tuple of (int, int, float)
        ``(i, j, C_ij)``, sorted.
    half_width, half_height : float
        a and b.
    """

    family: str
    coefficients: tuple[tuple[int, int, float], ...]
    half_width: float
    half_height: float

    def jet(self, x: Array, y: Array) -> Jet:
        """Return height and derivatives: a table for each axis, joined row by row."""
        a, b = self.half_width, self.half_height
        rows: dict[int, list[tuple[int, float]]] = {}
        for i, j, value in self.coefficients:
            rows.setdefault(j, []).append((i, value))
        along_x = tabulate(1.0, steps(self.family, max(i for i, _, _ in self.coefficients)), x / a)
        along_y = tabulate(1.0, steps(self.family, max(rows)), y / b)
        sums = np.zeros((6, *np.shape(x)))
        for j, row in rows.items():
            p, p1, p2 = combine(dense(row), along_x)
            q, q1, q2 = along_y[:, j]
            for total, s, t in zip(sums, (p, p1, p, p2, p1, p), (q, q, q1, q, q1, q2), strict=True):
                np.add(total, s * t, out=total)
        z, zx, zy, zxx, zxy, zyy = sums
        return Jet(z, zx / a, zy / b, zxx / a**2, zxy / (a * b), zyy / b**2)


def steps(family: str, count: int) -> list[Step]:
    """Return the recurrence of a family.

    Notes
    -----
    NIST DLMF 18.9.1, table 18.9.1: ``T_{k+1} = 2 x T_k - T_{k-1}`` and
    ``(k + 1) P_{k+1} = (2 k + 1) x P_k - k P_{k-1}``.
    """
    if family == "chebyshev":
        return [Step(0.0, 2.0 if k else 1.0, 1.0 if k else 0.0) for k in range(count)]
    return [Step(0.0, (2 * k + 1) / (k + 1), k / (k + 1)) for k in range(count)]


def from_table(table: Mapping[str, Any], where: str) -> ProductSeries:
    """Return the term of a table with `half_width`, `half_height` and `coefficients` ``{ "i,j" = C }``."""
    check_term_keys(table, {"half_width", "half_height", "coefficients"}, where)
    return ProductSeries(
        str(table["kind"]),
        by_pair(table, where),
        positive(table, "half_width", where),
        positive(table, "half_height", where),
    )
