"""Conic of revolution: ``z = c q^2 / (1 + sqrt(1 - (1 + k) c^2 q^2))``, ``q^2 = x^2 + y^2``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from cmm_align.errors import MalformedInputError
from cmm_align.surfaces.protocol import Array, Jet
from cmm_align.toml_table import check_keys, number


@dataclass(frozen=True, slots=True)
class Conic:
    """Conic of revolution about z with its vertex at the origin.

    Attributes
    ----------
    curvature : float
        1 / vertex radius; positive = concave towards +z.
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
            second = factor * c / s**3  # 4 d2z/d(q^2)2
        return Jet(z, first * x, first * y, first + second * x * x, second * x * y, first + second * y * y)


def from_table(table: Mapping[str, Any], where: str) -> Conic:
    """Return the term of a [[term]] table with `radius` (or `curvature`) and `conic`."""
    check_keys(table, {"kind", "radius", "curvature", "conic"}, where=where)
    if ("radius" in table) == ("curvature" in table):
        raise MalformedInputError("radius or curvature", where=where, expected="one of the two")
    if "curvature" in table:
        curvature = number(table, "curvature", where=where)
    else:
        radius = number(table, "radius", where=where)
        if radius == 0.0:
            raise MalformedInputError("radius = 0", where=where, expected="a radius that is not zero")
        curvature = 1.0 / radius
    return Conic(curvature, number(table, "conic", where=where, default=0.0))
