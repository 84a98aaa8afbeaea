"""The surface that a machine is to be told, and how far points of a file are off it.

It is made of the nominal and the sum of all corrections along the normal, ``z = s + total / n_z``, and of
nothing that an export is written from. At nodes it is exact: there the nominal is carried to a rounded
place by its slope. Between them ``total / n_z`` is a spline of degree five; near the border of an aperture
that cuts through the grid there are no nodes to carry it, and what may be wrong there is said.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates, minimum_filter

from cmm_align.model import Correction
from cmm_align.numerics.grid_field import carried_on, continued, interpolated
from cmm_align.numerics.tensor_spline import SplineJet, interpolating_coefficients, spline_jet
from cmm_align.stages.map_noise import step_of
from cmm_align.surfaces.geometry import unit_normal
from cmm_align.surfaces.protocol import Array, Jet, Mask, Surface

ON_NODE_MM: Final = 2e-6
"""Points this near to a node, in x and in y, are that node: what rounding to six decimals may move."""

_DEGREE: Final = 5
_BORDER: Final = 8
"""Nodes over which what is made up past a border dies out in the spline (by 0.43 from node to node)."""
_RINGS: Final = 2
"""Rings of nodes past a border that are carried on by parabolas, so that there is no kink at it."""
_OUTSIDE: Final = 0.05
"""Share of a step that a point may lie outside the known cells: contacts are recovered to some um aside."""
_CHUNK: Final = 65_536


@dataclass(frozen=True, slots=True)
class Found:
    """Points of a file over the nominal, each of shape (n,), frame `surface`.

    Attributes
    ----------
    x_mm, y_mm : ndarray
    total_mm : ndarray
        Along the normal, from the nominal to the point; for a grid of removal, what it takes off.
    told_mm : ndarray
        What it should be; NaN outside the aperture.
    n_z : ndarray
        Of the normal of the nominal.
    unsure_mm : ndarray
        By how much `told_mm` may be wrong between the nodes beside a border.
    node : ndarray of int
        Number of the nearest node, row by row.
    on_node : ndarray of bool
    """

    x_mm: Array
    y_mm: Array
    total_mm: Array
    told_mm: Array
    n_z: Array
    unsure_mm: Array
    node: NDArray[np.intp]
    on_node: Mask

    @property
    def off_mm(self) -> Array:
        """How far the file is off what it should say, along the normal, shape (n,)."""
        return self.total_mm - self.told_mm


class ToldSurface:
    """What is told: a field along the normal on the grid of a correction, and the nominal below it.

    Attributes
    ----------
    x_mm, y_mm : ndarray, shape (nx,), (ny,), mm, frame `surface`
    total_mm : ndarray, shape (ny, nx), mm
        NaN outside the aperture.
    jet : Jet
        Of the nominal, each of shape (ny, nx).
    n_z : ndarray, shape (ny, nx)
    """

    def __init__(self, correction: Correction, jet: Jet | None = None, total_mm: Array | None = None) -> None:
        """Keep the fields; `total_mm` other than the sum of all passes is for exports of this pass alone."""
        nominal = correction.nominal
        self.x_mm, self.y_mm = correction.x_mm, correction.y_mm
        self.total_mm = correction.total_correction_mm if total_mm is None else total_mm
        self._surface, self._side = nominal.surface, nominal.side
        self._step = step_of(self.x_mm), step_of(self.y_mm)
        if jet is None:
            x, y = np.meshgrid(self.x_mm, self.y_mm)
            flat = _jet_at(self._surface, x.ravel(), y.ravel())
            jet = Jet(*(a.reshape(x.shape) for a in flat))
        self.jet = jet
        self.n_z = self._side / np.sqrt(1.0 + jet.zx**2 + jet.zy**2)
        self.known = np.isfinite(self.total_mm)

    def found(self, points_mm: Array) -> Found:
        """Return points of shape (n, 3), mm, frame `surface`, over the nominal."""
        x, y, z = points_mm.T
        node, on_node, distance = self._nodes(x, y)
        flat = self.jet
        n_z, unsure = self.n_z.ravel()[node], np.zeros(len(x))
        row, column = np.divmod(node, len(self.x_mm))
        height = flat.z.ravel()[node] + flat.zx.ravel()[node] * (x - self.x_mm[column])
        height += flat.zy.ravel()[node] * (y - self.y_mm[row])
        total = (z - height) * n_z
        told = self.total_mm.ravel()[node]
        rest = np.flatnonzero(~on_node)
        if len(rest):
            there = _jet_at(self._surface, x[rest], y[rest])
            n_z[rest] = self._side / np.sqrt(1.0 + there.zx**2 + there.zy**2)
            total[rest] = (z[rest] - there.z) * n_z[rest]
            told[rest] = self.height_spline(x[rest], y[rest]).z * n_z[rest]
            told[rest[~self._within(x[rest], y[rest])]] = np.nan
            unsure[rest] = self._unsure(node[rest], distance[rest])
        return Found(x, y, total, told, n_z, unsure, node, on_node)

    def found_field(self, x_mm: Array, y_mm: Array, field_mm: Array) -> Found:
        """Return what a file states along the normal, of shape (n,), mm, at places (x, y)."""
        node, on_node, distance = self._nodes(x_mm, y_mm)
        told, unsure = self.total_mm.ravel()[node], np.zeros(len(x_mm))
        n_z = self.n_z.ravel()[node]
        rest = np.flatnonzero(~on_node)
        if len(rest):
            step = self._step
            at = self._spline(self._field_coefficients, x_mm[rest], y_mm[rest], step).z
            told[rest] = np.where(self._within(x_mm[rest], y_mm[rest]), at, np.nan)
            unsure[rest] = self._unsure(node[rest], distance[rest])
        return Found(x_mm, y_mm, field_mm, told, n_z, unsure, node, on_node)

    def height_spline(self, x_mm: Array, y_mm: Array) -> SplineJet:
        """Return what is told more than the nominal along z, with slopes, at places of shape (n,)."""
        return self._spline(self._height_coefficients, x_mm, y_mm, self._step)

    def nominal_at(self, x_mm: Array, y_mm: Array) -> Jet:
        """Return the nominal at places of shape (n,)."""
        return _jet_at(self._surface, x_mm, y_mm)

    def normals_at(self, x_mm: Array, y_mm: Array) -> Array:
        """Return the normals of what is told at places of shape (n,): shape (n, 3), frame `surface`."""
        jet, more = self.nominal_at(x_mm, y_mm), self.height_spline(x_mm, y_mm)
        return unit_normal(jet._replace(zx=jet.zx + more.zu, zy=jet.zy + more.zv), self._side)

    def reaches(self, x_mm: Array, y_mm: Array) -> Mask:
        """Return which places of shape (n,) lie on the grid, or within a step of it."""
        dx, dy = self._step
        inside = (x_mm >= self.x_mm[0] - dx) & (x_mm <= self.x_mm[-1] + dx)
        return np.asarray(inside & (y_mm >= self.y_mm[0] - dy) & (y_mm <= self.y_mm[-1] + dy))

    def at(self, field: Array, x_mm: Array, y_mm: Array) -> Array:
        """Return a field of the grid, shape (ny, nx), at places of shape (n,)."""
        return interpolated(self.x_mm, self.y_mm, field, x_mm, y_mm)

    def roughly_at(self, field: Array, x_mm: Array, y_mm: Array) -> Array:
        """Return a complete field of the grid, linear between its nodes, at places of shape (n,)."""
        row = (y_mm - self.y_mm[0]) / self._step[1]
        column = (x_mm - self.x_mm[0]) / self._step[0]
        return np.asarray(map_coordinates(field, [row, column], order=1, mode="nearest"))

    @cached_property
    def _height_coefficients(self) -> Array:
        return _coefficients(self.total_mm / self.n_z)

    @cached_property
    def _field_coefficients(self) -> Array:
        return _coefficients(self.total_mm)

    @cached_property
    def inner(self) -> Mask:
        """Return which nodes, shape (ny, nx), are so far from unknown ones that the spline ignores them."""
        width = 2 * _BORDER + 1
        return np.asarray(minimum_filter(self.known, width, mode="nearest"))

    @cached_property
    def _bend_mm(self) -> float:
        """How wrong a spline may be between two nodes beside a border: bends inside, and a kink at it."""
        second, first = 0.0, 0.0
        for axis in (0, 1):
            one = np.abs(np.diff(self.total_mm, axis=axis))
            two = np.abs(np.diff(self.total_mm, 2, axis=axis))
            first += float(np.nanmax(one, initial=0.0))
            second += float(np.nanmax(two, initial=0.0))
        return second / 4.0 + 0.15 * first

    def _unsure(self, node: NDArray[np.intp], distance: Array) -> Array:
        """Return what the spline may be wrong by, `distance` steps from the nearest node."""
        border = ~self.inner.ravel()[node]
        return np.asarray(np.where(border, self._bend_mm * np.minimum(1.0, 2.0 * distance), 0.0))

    def _nodes(self, x: Array, y: Array) -> tuple[NDArray[np.intp], Mask, Array]:
        """Return the nearest node of each place, whether it is that node, and how many steps it is away."""
        number, away = [], []
        for nodes, places, step in ((self.y_mm, y, self._step[1]), (self.x_mm, x, self._step[0])):
            held = np.clip(np.rint((places - nodes[0]) / step), 0, len(nodes) - 1).astype(np.intp)
            number.append(held)
            away.append(places - nodes[held])
        node = number[0] * len(self.x_mm) + number[1]
        near = (np.abs(away[0]) <= ON_NODE_MM) & (np.abs(away[1]) <= ON_NODE_MM)
        distance = np.maximum(np.abs(away[0]) / self._step[1], np.abs(away[1]) / self._step[0])
        return node, near, distance

    def _within(self, x: Array, y: Array) -> Mask:
        """Return which places lie in a known cell, or hardly outside it."""
        inside = np.zeros(len(x), np.bool_)
        for dx in (-_OUTSIDE, 0.0, _OUTSIDE):
            for dy in (-_OUTSIDE, 0.0, _OUTSIDE):
                inside |= self._in_cell(x + dx * self._step[0], y + dy * self._step[1])
                if inside.all():
                    return inside
        return inside

    def _in_cell(self, x: Array, y: Array) -> Mask:
        u, v = (x - self.x_mm[0]) / self._step[0], (y - self.y_mm[0]) / self._step[1]
        slack = _OUTSIDE
        on_grid = (u >= -slack) & (u <= len(self.x_mm) - 1 + slack)
        on_grid &= (v >= -slack) & (v <= len(self.y_mm) - 1 + slack)
        ix = np.clip(u, 0, len(self.x_mm) - 2).astype(np.intp)
        iy = np.clip(v, 0, len(self.y_mm) - 2).astype(np.intp)
        k = self.known
        full = k[iy, ix] & k[iy, ix + 1] & k[iy + 1, ix] & k[iy + 1, ix + 1]
        # A path along a line of nodes at a border has known nodes on one side only.
        line_x = (np.abs(v - np.rint(v)) <= slack) & _both(k, np.rint(v), ix, along_x=True)
        line_y = (np.abs(u - np.rint(u)) <= slack) & _both(k, np.rint(u), iy, along_x=False)
        return np.asarray(on_grid & (full | line_x | line_y))

    def _spline(self, coefficients: Array, x: Array, y: Array, step: tuple[float, float]) -> SplineJet:
        degree = _degree(self.total_mm)
        u, v = (x - self.x_mm[0]) / step[0], (y - self.y_mm[0]) / step[1]
        parts = [
            spline_jet(coefficients, degree, u[k : k + _CHUNK], v[k : k + _CHUNK])
            for k in range(0, len(x), _CHUNK)
        ]
        z, zu, zv, zuu, zuv, zvv = (np.concatenate(one) for one in zip(*parts, strict=True))
        return SplineJet(
            z, zu / step[0], zv / step[1], zuu / step[0] ** 2, zuv / (step[0] * step[1]), zvv / step[1] ** 2
        )


def _both(known: Mask, line: Array, cell: NDArray[np.intp], *, along_x: bool) -> Mask:
    """Return whether both nodes of a piece of a grid line are known."""
    field = known if along_x else known.T
    row = np.clip(line, 0, len(field) - 1).astype(np.intp)
    return np.asarray(field[row, cell] & field[row, cell + 1])


def _degree(field: Array) -> int:
    return _DEGREE if min(field.shape) >= _DEGREE + 2 else 3


def _coefficients(field: Array) -> Array:
    return interpolating_coefficients(continued(carried_on(field, _RINGS)), _degree(field))


def _jet_at(surface: Surface, x: Array, y: Array) -> Jet:
    """Return the jet of a surface in pieces that stay in cache."""
    parts = [surface.jet(x[k : k + _CHUNK], y[k : k + _CHUNK]) for k in range(0, max(len(x), 1), _CHUNK)]
    return Jet(*(np.concatenate(one) for one in zip(*parts, strict=True)))
