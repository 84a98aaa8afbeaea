"""Biconic: a conic section of its own along x and along y."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from cmm_align.errors import MalformedInputError
from cmm_align.surfaces.protocol import Array, Jet
from cmm_align.surfaces.terms.conic import curvature_from_table
from cmm_align.surfaces.terms.term import check_term_keys
from cmm_align.toml_table import number


@dataclass(frozen=True, slots=True)
class Biconic:
    """``z = (cx x^2 + cy y^2) / (1 + sqrt(1 - (1 + kx) cx^2 x^2 - (1 + ky) cy^2 y^2))``.

    Attributes
    ----------
    curvature_x, curvature_y : float
        1 / vertex radius in the xz and yz plane; positive = concave towards +z.
    conic_x, conic_y : float
        Conic constants.
    """

    curvature_x: float
    conic_x: float
    curvature_y: float
    conic_y: float

    def jet(self, x: Array, y: Array) -> Jet:
        """Return height and derivatives; NaN where the root is not real.

        Notes
        -----
        Differentiating ``z (1 + s) = cx x^2 + cy y^2`` twice; s is the root, and ``s^2`` is quadratic.
        """
        cx, cy = self.curvature_x, self.curvature_y
        ax, ay = (1.0 + self.conic_x) * cx * cx, (1.0 + self.conic_y) * cy * cy
        with np.errstate(invalid="ignore", divide="ignore"):
            s = np.sqrt(1.0 - ax * x * x - ay * y * y)
            sx, sy = -ax * x / s, -ay * y / s
            sxx, sxy, syy = -(ax + sx * sx) / s, -sx * sy / s, -(ay + sy * sy) / s
            share = 1.0 / (1.0 + s)
            z = (cx * x * x + cy * y * y) * share
            zx = (2.0 * cx * x - z * sx) * share
            zy = (2.0 * cy * y - z * sy) * share
            return Jet(
                z,
                zx,
                zy,
                (2.0 * cx - 2.0 * zx * sx - z * sxx) * share,
                -(zx * sy + zy * sx + z * sxy) * share,
                (2.0 * cy - 2.0 * zy * sy - z * syy) * share,
            )


def from_table(table: Mapping[str, Any], where: str) -> Biconic:
    """Return the term of a table with radius (or curvature) and conic of x and y; a missing one: straight."""
    check_term_keys(
        table, {f"{key}_{axis}" for key in ("radius", "curvature", "conic") for axis in "xy"}, where
    )
    if not any(f"{key}_{axis}" in table for key in ("radius", "curvature") for axis in "xy"):
        raise MalformedInputError("no radius_x, no radius_y", where=where, expected="at least one of them")
    return Biconic(
        curvature_from_table(table, where, "_x"),
        number(table, "conic_x", where=where, default=0.0),
        curvature_from_table(table, where, "_y"),
        number(table, "conic_y", where=where, default=0.0),
    )
