"""Series over a disk: radial polynomials times ``r^m cos(m t)`` and ``r^m sin(m t)``.

``r^m cos(m t)`` and ``r^m sin(m t)`` are polynomials in x and y (real and imaginary part of ``(x + iy)^m``),
so the derivatives are exact at the centre too: nothing is divided by r.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cmm_align.surfaces.protocol import Array, Jet

Radials = Mapping[int, tuple[Array | None, Array | None]]
"""Of every m the radial sums of cosine and sine, each of shape (3, n): value and derivatives by r^2."""


def series_jet(p: Array, q: Array, radials: Radials, length: float) -> Jet:
    """Return the jet of ``sum_m r^m (A_m(r^2) cos(m t) + B_m(r^2) sin(m t))`` by x = p L and y = q L.

    Parameters
    ----------
    p, q : Array
        Places divided by L, shape (n,); ``r^2 = p^2 + q^2``, t from +x towards +y.
    radials : mapping
        m -> (A_m, B_m).
    length : float
        L, unit of the prescription.
    """
    # Sums over m: of f h, f' h, f'' h; of f and f' times the gradient of h; of f times h_pp and h_pq.
    sums = np.zeros((9, *np.shape(p)))
    product = np.empty(np.shape(p))
    c = [np.ones(np.shape(p))]
    s = [np.zeros(np.shape(p))]
    for m in range(max(radials, default=0) + 1):
        if m > 0:
            c.append(p * c[m - 1] - q * s[m - 1])
            s.append(p * s[m - 1] + q * c[m - 1])
        for radial, sine in zip(radials.get(m, (None, None)), (False, True), strict=True):
            if radial is None:
                continue
            f, f1, f2 = radial
            # h is harmonic: with its conjugate k, dh_m/dp = m h_{m-1} and dh_m/dq = -+ m k_{m-1}.
            h, k, sign = (s, c, 1.0) if sine else (c, s, -1.0)
            pairs = [(f, h[m]), (f1, h[m]), (f2, h[m])]
            if m > 0:
                hp, hq = m * h[m - 1], (sign * m) * k[m - 1]
                pairs += [(f, hp), (f, hq), (f1, hp), (f1, hq)]
            if m > 1:
                pairs += [(f, (m * (m - 1)) * h[m - 2]), (f, (sign * m * (m - 1)) * k[m - 2])]
            for total, (a, b) in zip(sums, pairs, strict=False):
                np.add(total, np.multiply(a, b, out=product), out=total)
    z, g1, g2, zp, zq, g1p, g1q, bend, twist = sums
    g1 *= 2.0
    g2 *= 4.0
    return Jet(
        z,
        (zp + p * g1) / length,
        (zq + q * g1) / length,
        (bend + 4.0 * p * g1p + g1 + p * p * g2) / length**2,
        (twist + 2.0 * (q * g1p + p * g1q) + p * q * g2) / length**2,
        (4.0 * q * g1q - bend + g1 + q * q * g2) / length**2,
    )
