"""Zernike polynomials in the conventions of Noll and of the Fringe list."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isqrt, sqrt
from typing import Any, Final

from cmm_align.errors import MalformedInputError
from cmm_align.surfaces.protocol import Array, Jet
from cmm_align.surfaces.terms.circular_series import series_jet
from cmm_align.surfaces.terms.coefficients import by_index, positive
from cmm_align.surfaces.terms.recurrence import combine, dense, jacobi_steps, tabulate
from cmm_align.surfaces.terms.term import check_term_keys
from cmm_align.toml_table import did_you_mean

HIGHEST: Final = {"noll": 1326, "fringe": 37}
"""Last index: radial degree 50 of Noll's order; the Fringe list ends with 37."""


@dataclass(frozen=True, slots=True)
class Zernike:
    """``z = sum C_j Z_j(x / L, y / L)``.

    Attributes
    ----------
    convention : str
        noll: orthonormal, RMS 1 over the disk; fringe: R_n^m(1) = 1.
    coefficients : tuple of (int, float)
        ``(j, C_j)``, sorted.
    length : float
        Normalisation radius L.
    """

    convention: str
    coefficients: tuple[tuple[int, float], ...]
    length: float

    def jet(self, x: Array, y: Array) -> Jet:
        """Return height and derivatives.

        Notes
        -----
        ``R_n^m(r) = r^m P_k^(0, m)(2 r^2 - 1)``, ``k = (n - m) / 2``: Born & Wolf, Principles of Optics,
        section 9.2.1; NIST DLMF 18.37.
        """
        rows: dict[tuple[int, bool], list[tuple[int, float]]] = {}
        for j, value in self.coefficients:
            n, m, sine = degrees(self.convention, j)
            scale = norm(n, m) if self.convention == "noll" else 1.0
            rows.setdefault((m, sine), []).append(((n - m) // 2, scale * value))
        p, q = x / self.length, y / self.length
        v = p * p + q * q
        radials: dict[int, tuple[Array | None, Array | None]] = {}
        for m in sorted({order for order, _ in rows}):
            cosine, sine_row = dense(rows.get((m, False), ())), dense(rows.get((m, True), ()))
            count = max(len(cosine), len(sine_row))
            table = tabulate(1.0, jacobi_steps(m, count - 1), v)
            radials[m] = (
                combine(cosine, table[:, : len(cosine)]) if cosine else None,
                combine(sine_row, table[:, : len(sine_row)]) if sine_row else None,
            )
        return series_jet(p, q, radials, self.length)


def degrees(convention: str, j: int) -> tuple[int, int, bool]:
    """Return radial degree n, azimuthal order m >= 0 and whether it is the sine, of a single index.

    Notes
    -----
    Noll, J. Opt. Soc. Am. 66, 207 (1976), doi 10.1364/JOSA.66.000207, table I: n rises, then m; even j are
    cosines. Fringe: groups of constant n + m, m falling, cosine before sine; the 37th is n = 12, m = 0.
    """
    if convention == "noll":
        n = (isqrt(8 * j - 7) - 1) // 2
        place = j - n * (n + 1) // 2
        m = 2 * (place // 2) if n % 2 == 0 else 2 * ((place - 1) // 2) + 1
        return n, m, m > 0 and j % 2 == 1
    if j == HIGHEST["fringe"]:
        return 12, 0, False
    group = isqrt(j - 1) + 1
    before = group * group - j
    m = (before + 1) // 2
    return 2 * (group - 1) - m, m, before % 2 == 1


def norm(n: int, m: int) -> float:
    """Return Noll's factor, ``sqrt(n + 1)`` and for m > 0 also ``sqrt(2)`` (Noll 1976, eq. 1)."""
    return sqrt((n + 1) * (2 if m else 1))


def from_table(table: Mapping[str, Any], where: str) -> Zernike:
    """Return the term of a table with `convention`, `normalization_radius` and `coefficients` by index."""
    check_term_keys(table, {"convention", "normalization_radius", "coefficients"}, where)
    convention = str(table.get("convention", ""))
    if convention not in HIGHEST:
        raise MalformedInputError(
            "no convention" if "convention" not in table else f"unknown convention {convention!r}",
            where=where,
            expected='convention = "noll" or "fringe"',
            remedy=did_you_mean(convention, HIGHEST) if convention else "",
        )
    return Zernike(
        convention,
        by_index(table, where, lowest=1, highest=HIGHEST[convention]),
        positive(table, "normalization_radius", where),
    )
