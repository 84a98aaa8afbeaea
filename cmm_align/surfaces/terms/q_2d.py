"""Q_2d of Forbes: freeform departures from a sphere (or conic) along its normal, orthogonal in slope."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from cmm_align.errors import MalformedInputError
from cmm_align.surfaces.protocol import Array, Jet
from cmm_align.surfaces.terms.circular_series import series_jet
from cmm_align.surfaces.terms.coefficients import MAX_ORDER, entries, positive
from cmm_align.surfaces.terms.conic import BASE_KEYS, Conic, base_from_table
from cmm_align.surfaces.terms.forbes_slope import slope_sums
from cmm_align.surfaces.terms.q_bfs import on_base, rim_and_centre
from cmm_align.surfaces.terms.recurrence import dense
from cmm_align.surfaces.terms.term import check_term_keys

_KEY: Final = re.compile(r"\s*([ab])\s*(\d{1,4})\s*,\s*(\d{1,4})\s*", re.ASCII)


@dataclass(frozen=True, slots=True)
class Q2d:
    """Freeform of Forbes 2012, doi 10.1364/OE.20.002483, eq. 2.2.

    ``z = base + D / cos(a)`` with the slope angle a of the base, ``u = q / L``, t from +x towards +y, and
    ``D = u^2 (1 - u^2) sum_n a0,n Q_n^0(u^2) + sum_m u^m sum_n (am,n cos(m t) + bm,n sin(m t)) Q_n^m(u^2)``.

    Attributes
    ----------
    base : Conic
        A sphere in the paper.
    coefficients : tuple of (str, int, int, float)
        ``("a" or "b", m, n, value)``, sorted.
    length : float
        Normalisation radius L, the half aperture.
    """

    base: Conic
    coefficients: tuple[tuple[str, int, int, float], ...]
    length: float

    def jet(self, x: Array, y: Array) -> Jet:
        """Return height and derivatives."""
        p, q = x / self.length, y / self.length
        v = p * p + q * q
        radials: dict[int, tuple[Array | None, Array | None]] = {}
        for m in sorted({order for _, order, _, _ in self.coefficients}):
            rows = {
                letter: dense(
                    [
                        (n, value)
                        for kind, order, n, value in self.coefficients
                        if (kind, order) == (letter, m)
                    ]
                )
                for letter in "ab"
            }
            letters = [letter for letter in "ab" if rows[letter]]
            sums = dict(zip(letters, slope_sums(m, [rows[letter] for letter in letters], v), strict=True))
            radials[m] = (sums.get("a"), sums.get("b")) if m else (rim_and_centre(v, sums["a"]), None)
        return on_base(self.base, series_jet(p, q, radials, self.length), x, y)


def from_table(table: Mapping[str, Any], where: str) -> Q2d:
    """Return the term of a table with base, `normalization_radius` and `coefficients` ``{ "b2,0" = C }``.

    Raises
    ------
    MalformedInputError
        If a key is not a letter and two orders, or b has m = 0.
    """
    check_term_keys(table, BASE_KEYS | {"normalization_radius", "coefficients"}, where)
    found: dict[tuple[str, int, int], float] = {}
    for key, value in entries(table, where, 'coefficients = { "a0,n" = C, "am,n" = C, "bm,n" = C }'):
        match = _KEY.fullmatch(key)
        letter, m, n = (match[1], int(match[2]), int(match[3])) if match else ("", 0, 0)
        if not letter or max(m, n) > MAX_ORDER or (letter == "b" and m == 0):
            raise MalformedInputError(
                f"coefficient {key!r}",
                where=where,
                expected=f'"am,n" (m from 0) or "bm,n" (m from 1), at most {MAX_ORDER}, as "a2,0"',
            )
        if (letter, m, n) in found:
            raise MalformedInputError(f"coefficient {key!r} is given twice", where=where)
        found[letter, m, n] = value
    return Q2d(
        base_from_table(table, where),
        tuple((letter, m, n, value) for (letter, m, n), value in sorted(found.items())),
        positive(table, "normalization_radius", where),
    )
