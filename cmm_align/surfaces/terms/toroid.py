"""Toroid: a curve in the yz plane, turned about an axis parallel to y."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from cmm_align.errors import MalformedInputError
from cmm_align.surfaces.protocol import Array, Jet
from cmm_align.surfaces.terms.coefficients import by_index, positive
from cmm_align.surfaces.terms.conic import BASE_KEYS, Conic, base_from_table, curvature_from_table
from cmm_align.surfaces.terms.even_asphere import EvenAsphere
from cmm_align.surfaces.terms.term import check_term_keys


@dataclass(frozen=True, slots=True)
class Toroid:
    """Curve ``g(y)`` (a conic plus even powers) turned about the line x = 0, z = R.

    Attributes
    ----------
    curvature : float
        C = 1 / R, R being the radius of rotation at the vertex; 0 sweeps along x (a cylinder).
    profile : Conic or EvenAsphere
        The curve, as its surface of revolution.
    """

    curvature: float
    profile: Conic | EvenAsphere

    def jet(self, x: Array, y: Array) -> Jet:
        """Return height and derivatives; NaN where the curve or the circle ends.

        Notes
        -----
        A point of the curve lies ``R - g`` from the axis, so ``(1 - C z)^2 = (1 - C g)^2 - (C x)^2``. With
        ``u = 1 - C g`` and ``s = 1 - C z``, differentiated: ``z_x = C x / s``, ``z_y = u g' / s``.
        """
        c = self.curvature
        curve = self.profile.jet(np.zeros_like(y), y)
        g, g1, g2 = curve.z, curve.zy, curve.zyy
        t, u = c * x, 1.0 - c * g
        with np.errstate(invalid="ignore", divide="ignore"):
            s = np.sqrt(np.where(u > 0.0, (u - t) * (u + t), np.nan))
            zx, zy = t / s, u * g1 / s
            bend = c / s
            return Jet(
                g + t * x / (u + s),
                zx,
                zy,
                bend * (1.0 + zx * zx),
                bend * zx * zy,
                u * g2 / s + bend * (zx * g1) ** 2,
            )


def from_table(table: Mapping[str, Any], where: str) -> Toroid:
    """Return the term of a table with `radius_of_rotation`, and the curve as an even asphere's keys."""
    turning = {"radius_of_rotation", "curvature_of_rotation"}
    check_term_keys(table, BASE_KEYS | turning | {"normalization_radius", "coefficients"}, where)
    if turning.isdisjoint(table):
        raise MalformedInputError(
            "no radius_of_rotation", where=where, expected="it, or curvature_of_rotation (0 for a cylinder)"
        )
    curvature = curvature_from_table(table, where, "_of_rotation")
    base = base_from_table(table, where)
    length = positive(table, "normalization_radius", where, default=1.0)
    if "coefficients" not in table:
        return Toroid(curvature, base)
    return Toroid(curvature, EvenAsphere(base, by_index(table, where, lowest=2, step=2), length))
