"""A term that is decentred and tilted.

The term's own frame lies in the prescription's like this: its origin is moved by `decentre` first; then the
frame turns about its own x, then its own (turned) y, then its own z, right-handed, by ``tilt_deg = [rx, ry,
rz]``. So ``P = d + Rx Ry Rz p`` takes coordinates p of the term to P of the prescription.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from cmm_align import units
from cmm_align.errors import MalformedInputError
from cmm_align.surfaces.protocol import Array, Jet
from cmm_align.surfaces.terms.term import Term
from cmm_align.toml_table import numbers

MOST_STEPS: Final = 60
"""Newton needs 3 to 6; what has not settled by then has no height there."""
SETTLED: Final = 1e-9
"""A step below this share of the size is followed by one more, which squares it."""


@dataclass(frozen=True, slots=True)
class Placed:
    """A term in a frame of its own.

    Attributes
    ----------
    term : Term
    decentre : tuple of float
        Origin of the term's frame (dx, dy, dz), unit of the prescription.
    tilt_rad : tuple of float
        Angles (rx, ry, rz), rad.
    """

    term: Term
    decentre: tuple[float, float, float]
    tilt_rad: tuple[float, float, float]

    def jet(self, x: Array, y: Array) -> Jet:
        """Return height and derivatives; NaN where no point of the tilted term is found over (x, y).

        Notes
        -----
        With tilt the height w is where ``F(w) = p_z - f(p_x, p_y) = 0`` along the vertical through (x, y); a
        tangent ``t = e_a + w_a e_z`` maps to ``R^T t``, and ``w_ab = t_a' H t_b' / n_z`` with f's Hessian H
        and the normal ``n = R (-f_x, -f_y, 1)``.
        """
        dx, dy, dz = self.decentre
        u, v = x - dx, y - dy
        if not any(self.tilt_rad):
            jet = self.term.jet(u, v)
            return jet._replace(z=jet.z + dz)
        r = rotation(*self.tilt_rad)
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            w = self._height(r, u, v)
            px, py, pz = _own(r, u, v, w)
            own = self.term.jet(px, py)
            nx, ny, nz = _normal(r, own)
            w = w + (own.z - pz) / nz
            nz = np.where(nz > 0.0, nz, np.nan)
            zx, zy = -nx / nz, -ny / nz
            ax, ay = r[0, 0] + zx * r[2, 0], r[0, 1] + zx * r[2, 1]
            bx, by = r[1, 0] + zy * r[2, 0], r[1, 1] + zy * r[2, 1]
            hax, hay = own.zxx * ax + own.zxy * ay, own.zxy * ax + own.zyy * ay
            hbx, hby = own.zxx * bx + own.zxy * by, own.zxy * bx + own.zyy * by
            return Jet(
                w + dz + 0.0 * nz,
                zx,
                zy,
                (hax * ax + hay * ay) / nz,
                (hax * bx + hay * by) / nz,
                (hbx * bx + hby * by) / nz,
            )

    def _height(self, r: Array, u: Array, v: Array) -> Array:
        """Return w by Newton from the term's plane; a step out of the term's domain is halved."""
        x3, y3, z3 = float(r[0, 2]), float(r[1, 2]), float(r[2, 2])
        along = x3 * u + y3 * v
        w = -along / z3
        px, py, _ = _own(r, u, v, w)
        outside = ~np.isfinite(self.term.jet(px, py).z)
        if outside.any():
            # Nearest to the term's axis, where a conic is defined if it is anywhere on this vertical.
            w = np.where(outside, along * z3 / max(1.0 - z3 * z3, 1e-300), w)
        found = np.full(np.shape(u), np.nan)
        busy = np.arange(len(u))  # places whose height is still sought
        last, size = w, np.hypot(u, v)
        for _ in range(MOST_STEPS):
            px, py, pz = _own(r, u[busy], v[busy], w)
            own = self.term.jet(px, py)
            step = (own.z - pz) / _normal(r, own)[2]
            defined = np.isfinite(step)
            settled = defined & (np.abs(step) <= SETTLED * (size[busy] + np.abs(w)))
            found[busy[settled]] = (w + step)[settled]
            w, last = np.where(defined, w + step, 0.5 * (w + last)), np.where(defined, w, last)
            busy, w, last = busy[~settled], w[~settled], last[~settled]
            if len(busy) == 0:
                break
        return found


def _own(r: Array, u: Array, v: Array, w: Array) -> tuple[Array, Array, Array]:
    """Return the coordinates in the term's frame, ``R^T (u, v, w)``."""
    px, py, pz = (r[0, k] * u + r[1, k] * v + r[2, k] * w for k in range(3))
    return px, py, pz


def _normal(r: Array, own: Jet) -> tuple[Array, Array, Array]:
    """Return ``R (-f_x, -f_y, 1)``: the upward normal in the prescription's frame, not of length 1."""
    nx, ny, nz = (r[k, 2] - r[k, 0] * own.zx - r[k, 1] * own.zy for k in range(3))
    return nx, ny, nz


def rotation(rx: float, ry: float, rz: float) -> Array:
    """Return ``Rx Ry Rz``, shape (3, 3), of angles in rad."""
    (ca, cb, cc), (sa, sb, sc) = np.cos([rx, ry, rz]), np.sin([rx, ry, rz])
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, ca, -sa], [0.0, sa, ca]])
    about_y = np.array([[cb, 0.0, sb], [0.0, 1.0, 0.0], [-sb, 0.0, cb]])
    about_z = np.array([[cc, -sc, 0.0], [sc, cc, 0.0], [0.0, 0.0, 1.0]])
    turned: Array = about_x @ about_y @ about_z
    return turned


def placed_from_table(term: Term, table: Mapping[str, Any], where: str) -> Term:
    """Return the term in the frame that `decentre` and `tilt_deg` of its table state; itself without them.

    Raises
    ------
    MalformedInputError
        If they are not lists of 2 or 3, and of 3 numbers, or the tilt turns the term upside down.
    """
    if "decentre" not in table and "tilt_deg" not in table:
        return term
    shift, tilt = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
    if "decentre" in table:
        given = table["decentre"]
        count = 3 if isinstance(given, list) and len(given) == 3 else 2
        shift = [*numbers(table, "decentre", where=where, count=count), 0.0][:3]
    if "tilt_deg" in table:
        tilt = [angle * units.RAD_PER_DEG for angle in numbers(table, "tilt_deg", where=where, count=3)]
    if rotation(*tilt)[2, 2] <= 0.0:
        raise MalformedInputError(
            f"tilt_deg = {table['tilt_deg']}", where=where, expected="the term's z axis to point upwards"
        )
    return Placed(term, (shift[0], shift[1], shift[2]), (tilt[0], tilt[1], tilt[2]))
