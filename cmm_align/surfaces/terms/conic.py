"""Conic of revolution: ``z = c q^2 / (1 + sqrt(1 - (1 + k) c^2 q^2))``, ``q^2 = x^2 + y^2``.

Alone it is the term `conic`; aspheres and the Q polynomials carry one as their base.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from cmm_align.errors import MalformedInputError
from cmm_align.surfaces.protocol import Array, Jet
from cmm_align.surfaces.terms.term import check_term_keys
from cmm_align.toml_table import number

BASE_KEYS: Final = frozenset({"radius", "curvature", "conic"})
"""Keys that describe a conic: its vertex radius or curvature, and the conic constant."""


@dataclass(frozen=True, slots=True)
class Conic:
    """Conic of revolution about z with its vertex at the origin.

    Attributes
    ----------
    curvature : float
        1 / vertex radius; positive = concave towards +z; 0 is the plane.
    conic : float
        Conic constant: 0 sphere, -1 paraboloid.
    """

    curvature: float
    conic: float

    def jet(self, x: Array, y: Array) -> Jet:
        """Return height and derivatives; NaN beyond the rim of an ellipsoid.

        Notes
        -----
        With ``s = sqrt(1 - (1 + k) c^2 q^2)``: ``dz/d(q^2) = c / (2 s)`` and
        ``d2z/d(q^2)2 = (1 + k) c^3 / (4 s^3)``.
        """
        c, factor = self.curvature, (1.0 + self.conic) * self.curvature**2
        q2 = x * x + y * y
        with np.errstate(invalid="ignore", divide="ignore"):
            s = np.sqrt(1.0 - factor * q2)
            z = c * q2 / (1.0 + s)
            first = c / s  # 2 dz/d(q^2)
            second = factor * c / (s * s * s)  # 4 d2z/d(q^2)2
        sx = second * x
        return Jet(z, first * x, first * y, first + sx * x, sx * y, first + second * y * y)

    def obliquity(self, x: Array, y: Array) -> Jet:
        """Return the jet of 1 / cos(angle between the conic's normal and z).

        Parameters
        ----------
        x, y : Array
            Places, shape (n,), unit of the prescription.

        Notes
        -----
        ``1 + z'^2 = (1 - k e) / (1 - (1 + k) e) = a / b`` with ``e = c^2 q^2``, and its root g has
        ``dg/de = g / (2 a b)``.
        """
        k, c2 = self.conic, self.curvature**2
        e = c2 * (x * x + y * y)
        a, b = 1.0 - k * e, 1.0 - (1.0 + k) * e
        with np.errstate(invalid="ignore", divide="ignore"):
            g = np.sqrt(a / b)
            ab = a * b
            first = c2 * g / ab  # 2 dg/d(q^2)
            second = c2 * first / ab * (1.0 + 2.0 * (k * b + (1.0 + k) * a))  # 4 d2g/d(q^2)2
        sx = second * x
        return Jet(g, first * x, first * y, first + sx * x, sx * y, first + second * y * y)


def from_table(table: Mapping[str, Any], where: str) -> Conic:
    """Return the term of a [[term]] table with `radius` (or `curvature`) and `conic`."""
    check_term_keys(table, BASE_KEYS, where)
    if "radius" not in table and "curvature" not in table:
        raise MalformedInputError("no radius", where=where, expected="radius or curvature")
    return base_from_table(table, where)


def base_from_table(table: Mapping[str, Any], where: str) -> Conic:
    """Return the base that a term carries; the plane where it states neither radius nor curvature.

    Raises
    ------
    MalformedInputError
        If both are given, the radius is zero, or there is a conic constant without either.
    """
    curvature = curvature_from_table(table, where)
    if "conic" in table and "radius" not in table and "curvature" not in table:
        raise MalformedInputError("conic without a radius", where=where, expected="radius or curvature")
    return Conic(curvature, number(table, "conic", where=where, default=0.0))


def curvature_from_table(table: Mapping[str, Any], where: str, suffix: str = "") -> float:
    """Return the curvature given as `radius` or `curvature` (with a suffix such as ``_x``); 0 if neither is.

    Raises
    ------
    MalformedInputError
        If both are given or the radius is zero.
    """
    radius_key, curvature_key = f"radius{suffix}", f"curvature{suffix}"
    if radius_key in table and curvature_key in table:
        raise MalformedInputError(f"{radius_key} and {curvature_key}", where=where, expected="one of the two")
    if radius_key not in table:
        return number(table, curvature_key, where=where, default=0.0)
    radius = number(table, radius_key, where=where)
    if radius == 0.0:
        raise MalformedInputError(f"{radius_key} = 0", where=where, expected="a radius that is not zero")
    return 1.0 / radius
