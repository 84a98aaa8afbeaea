"""What lies between the nodes of a grid: splines through fields that end at an aperture."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from cmm_align.model import Correction
from cmm_align.numerics.grid_field import continued
from cmm_align.numerics.tensor_spline import SplineJet, interpolating_coefficients, spline_jet
from cmm_align.surfaces.geometry import unit_normal
from cmm_align.surfaces.protocol import Array

_DEGREE: Final = 5
_RINGS: Final = 8
_ROUNDING: Final = 1e-9
_CHUNK: Final = 16_384


class Between:
    """A field between its nodes: the spline through them, carried on past the known ones by parabolas.

    Attributes
    ----------
    x_mm, y_mm : ndarray, shape (nx,), (ny,), mm
        Nodes at equal steps.
    known : ndarray of bool, shape (ny, nx)
    """

    def __init__(self, x_mm: Array, y_mm: Array, field: Array) -> None:
        self.x_mm, self.y_mm, self.known = x_mm, y_mm, np.isfinite(field)
        self._step = float(x_mm[1] - x_mm[0]), float(y_mm[1] - y_mm[0])
        self._degree = _DEGREE if min(field.shape) >= _DEGREE + 2 else 3
        self._coefficients = interpolating_coefficients(continued(_carried_on(field)), self._degree)

    def jet(self, x: Array, y: Array) -> SplineJet:
        """Return value and derivatives (per mm) at places of shape (n,); good where `inside` says so."""
        u, v = (x - self.x_mm[0]) / self._step[0], (y - self.y_mm[0]) / self._step[1]
        parts = [
            spline_jet(self._coefficients, self._degree, u[k : k + _CHUNK], v[k : k + _CHUNK])
            for k in range(0, len(x), _CHUNK)
        ]
        z, zu, zv, zuu, zuv, zvv = (np.concatenate(one) for one in zip(*parts, strict=True))
        dx, dy = self._step
        return SplineJet(z, zu / dx, zv / dy, zuu / dx**2, zuv / (dx * dy), zvv / dy**2)


def inside_known(x_mm: Array, y_mm: Array, known: NDArray[np.bool_], x: Array, y: Array) -> NDArray[np.bool_]:
    """Return which places lie between four known nodes, or on a line between two, or on one.

    Parameters
    ----------
    x_mm, y_mm : ndarray, shape (nx,), (ny,), mm
    known : ndarray of bool, shape (ny, nx)
    x, y : ndarray, shape (n,), mm

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    inside = np.ones(len(x), np.bool_)
    corners = []
    for nodes, places in ((y_mm, y), (x_mm, x)):
        t = (places - nodes[0]) / (nodes[1] - nodes[0])
        inside &= (t >= -_ROUNDING) & (t <= len(nodes) - 1 + _ROUNDING)
        held = np.clip(t, 0.0, len(nodes) - 1)
        corners.append(
            [np.floor(held + _ROUNDING).astype(np.intp), np.ceil(held - _ROUNDING).astype(np.intp)]
        )
    for iy in corners[0]:
        for ix in corners[1]:
            inside &= known[iy, ix]
    return inside


def commanded_between(correction: Correction, x: Array, y: Array) -> tuple[Array, Array]:
    """Return points and normals of the commanded surface at places of shape (n,), frame `surface`."""
    x_mm, y_mm, nominal = correction.x_mm, correction.y_mm, correction.nominal
    xg, yg = np.meshgrid(x_mm, y_mm)
    more = correction.commanded_z_mm - nominal.surface.jet(xg.ravel(), yg.ravel()).z.reshape(xg.shape)
    on = Between(x_mm, y_mm, more).jet(x, y)
    jet = nominal.surface.jet(x, y)
    points = np.column_stack([x, y, jet.z + on.z])
    return points, unit_normal(jet._replace(zx=jet.zx + on.zu, zy=jet.zy + on.zv), nominal.side)


def _carried_on(field: Array) -> Array:
    """Return a field with some rings of unknown nodes carried on by parabolas from the known ones."""
    out = np.pad(field, 3, constant_values=np.nan)
    for _ in range(_RINGS):
        known = np.isfinite(out)
        beside = np.zeros_like(known)
        beside[1:-1, 1:-1] = known[2:, 1:-1] | known[:-2, 1:-1] | known[1:-1, 2:] | known[1:-1, :-2]
        beside[:3], beside[-3:], beside[:, :3], beside[:, -3:] = False, False, False, False
        iy, ix = np.nonzero(beside & ~known)
        found = [
            3.0 * out[iy + dy, ix + dx] - 3.0 * out[iy + 2 * dy, ix + 2 * dx] + out[iy + 3 * dy, ix + 3 * dx]
            for dy, dx in ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1))
        ]
        some = np.isfinite(found)
        count = some.sum(axis=0)
        out[iy, ix] = np.where(
            count > 0, np.where(some, found, 0.0).sum(axis=0) / np.maximum(count, 1), np.nan
        )
    return out[3:-3, 3:-3]
