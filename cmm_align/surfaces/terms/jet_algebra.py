"""Sums and products of jets, and the jet of a function of the distance from the axis."""

from __future__ import annotations

from cmm_align.surfaces.protocol import Array, Jet


def radial(p: Array, q: Array, f: Array, f1: Array, f2: Array, length: float = 1.0) -> Jet:
    """Return the jet of ``f(v)``, ``v = p^2 + q^2``, with respect to x = p L and y = q L.

    Parameters
    ----------
    p, q : Array
        Places divided by L, shape (n,).
    f, f1, f2 : Array
        Value, first and second derivative of f by v, shape (n,).
    length : float
        L, unit of the prescription.
    """
    first, second = 2.0 / length * f1, 4.0 / length**2 * f2
    flat = first / length
    sp = second * p
    return Jet(f, first * p, first * q, flat + sp * p, sp * q, flat + second * q * q)


def plus(a: Jet, b: Jet) -> Jet:
    """Return the sum of two jets of shape (n,)."""
    return Jet(*(s + t for s, t in zip(a, b, strict=True)))


def times(a: Jet, b: Jet) -> Jet:
    """Return the product of two jets of shape (n,) (Leibniz' rule)."""
    return Jet(
        a.z * b.z,
        a.zx * b.z + a.z * b.zx,
        a.zy * b.z + a.z * b.zy,
        a.zxx * b.z + 2.0 * a.zx * b.zx + a.z * b.zxx,
        a.zxy * b.z + a.zx * b.zy + a.zy * b.zx + a.z * b.zxy,
        a.zyy * b.z + 2.0 * a.zy * b.zy + a.z * b.zyy,
    )
