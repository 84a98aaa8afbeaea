"""Nominal points on a regular grid: recognised in any order, with holes, and interpolated exactly.

A tensor spline passes through all points. Cubic if its estimated error is negligible, else quintic:
for a steep freeform at 0.5 mm spacing the cubic is some 0.05 nm off, the quintic below 0.001 nm. Points that
were printed are known to their last decimal only, and a spline through them would wave between the digits:
they get the spline with the fewest cells that agrees with every print.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmm_align.errors import GeometryError
from cmm_align.numerics.scattered_spline import fitted_coefficients
from cmm_align.numerics.tensor_spline import (
    interpolating_coefficients,
    smoothed_coefficients,
    spline_jet,
)
from cmm_align.surfaces.protocol import Array, Mask
from cmm_align.surfaces.spline_surface import SplineSurface

MIN_NODES: Final = 4
"""Fewest nodes along an axis: what a cubic spline needs beside its ends is checked there."""

ENOUGH_MM: Final = 2e-10
"""An estimated error (PV) below this keeps the cubic spline, which is twice as fast: 2e-4 nm."""

FITTED_DEGREE: Final = 5
_NODES_PER_CELL: Final = (16, 8, 4, 2)
_PRINT_SLACK: Final = 1.1
_SAMPLE: Final = 40_000


class GridPoints(NamedTuple):
    """Points recognised as a grid."""

    x0_mm: float
    y0_mm: float
    dx_mm: float
    dy_mm: float
    z_mm: Array
    """Shape (ny, nx), NaN in holes."""
    off_x_mm: Array
    """How far each point lies from its node, shape (ny, nx), mm."""
    off_y_mm: Array


class _Axis(NamedTuple):
    """A regular axis found in coordinates."""

    first: float
    step: float
    node: NDArray[np.int64]


def recognised_grid(points_mm: Array, tolerance: float) -> GridPoints | None:
    """Return the regular grid that points form, or None if they form none.

    Parameters
    ----------
    points_mm : ndarray, shape (n, 3), mm
        In any order; up to three quarters of the nodes may be missing.
    tolerance : float
        Largest distance from a node, in steps.

    Raises
    ------
    GeometryError
        If two points share a node with different heights.
    """
    x_axis, y_axis = (_regular_axis(points_mm[:, k], tolerance) for k in (0, 1))
    if x_axis is None or y_axis is None:
        return None
    nx, ny = int(x_axis.node.max()) + 1, int(y_axis.node.max()) + 1
    if min(nx, ny) < MIN_NODES or nx * ny > 4 * len(points_mm):
        return None
    node = y_axis.node * nx + x_axis.node
    z = np.full(nx * ny, np.nan)
    z[node] = points_mm[:, 2]
    clash = z[node] != points_mm[:, 2]
    if clash.any():
        k = int(np.argmax(clash))
        raise GeometryError(
            f"two points at x = {points_mm[k, 0]:.6g}, y = {points_mm[k, 1]:.6g} mm differ in z by "
            f"{abs(points_mm[k, 2] - z[node[k]]):.3g} mm",
            expected="one height at every place",
        )
    off_x, off_y = np.zeros(nx * ny), np.zeros(nx * ny)
    off_x[node] = points_mm[:, 0] - (x_axis.first + x_axis.node * x_axis.step)
    off_y[node] = points_mm[:, 1] - (y_axis.first + y_axis.node * y_axis.step)
    shape = (ny, nx)
    return GridPoints(
        x_axis.first,
        y_axis.first,
        x_axis.step,
        y_axis.step,
        z.reshape(shape),
        off_x.reshape(shape),
        off_y.reshape(shape),
    )


def _regular_axis(values: Array, tolerance: float) -> _Axis | None:
    """Find equal steps in coordinates that repeat, jittered by up to `tolerance` of a step."""
    ordered = np.sort(values)
    gaps = np.diff(ordered)
    largest = float(gaps.max(initial=0.0))
    if largest <= 0.0:
        return None
    # Coordinates of one column stand together; a gap of half a step or more leads to the next one.
    step = float(np.median(gaps[gaps > 0.25 * largest]))
    starts = np.flatnonzero(np.r_[True, gaps > 0.5 * step])
    if not 2 <= len(starts) <= len(values) // 2:
        return None
    columns = np.add.reduceat(ordered, starts) / np.diff(np.r_[starts, len(ordered)])
    step = float(np.median(np.diff(columns)))
    number = np.r_[0.0, np.cumsum(np.rint(np.diff(columns) / step))]
    step, first = (float(v) for v in np.polyfit(number, columns, 1))
    nodes = np.rint((values - first) / step).astype(np.int64)
    if nodes.min() != 0 or float(np.abs(values - (first + nodes * step)).max()) > tolerance * step:
        return None
    return _Axis(first, step, nodes)


def grid_surface(grid: GridPoints, degree: int) -> tuple[SplineSurface, float]:
    """Return the spline through a grid and an estimate of its error.

    Parameters
    ----------
    grid : GridPoints
    degree : int
        3, 5, or 0 to choose.

    Returns
    -------
    surface : SplineSurface
    error_pv_mm : float
        PV of the error between the nodes, mm, from the errors of every second and every fourth node.
    """
    known = np.isfinite(grid.z_mm)
    if degree == 0:
        printed = _surface_through_prints(grid, known)
        if printed is not None:
            return printed
        degree = 3
        if min(grid.z_mm.shape) >= 9:
            cubic = _surface_of_degree(grid, known, 3)
            if cubic[1] <= ENOUGH_MM:
                return cubic
            quintic = _surface_of_degree(grid, known, 5)
            return quintic if quintic[1] < cubic[1] else cubic
    return _surface_of_degree(grid, known, degree)


def print_step_mm(z_mm: Array) -> float:
    """Return the last decimal that heights were printed with, mm, or 0 if they were not printed.

    Parameters
    ----------
    z_mm : ndarray, any shape, mm
        NaN where unknown.
    """
    sample = z_mm[np.isfinite(z_mm)][:_SAMPLE]
    for decimals in range(1, 9):
        digits = sample * 10.0**decimals
        if float(np.abs(digits - np.rint(digits)).max()) < 1e-4:
            return float(10.0**-decimals)
    return 0.0


def _surface_through_prints(grid: GridPoints, known: Mask) -> tuple[SplineSurface, float] | None:
    """Return the spline with the fewest cells that agrees with every printed height, if there is one."""
    step = print_step_mm(grid.z_mm)
    if step == 0.0:
        return None
    z = grid.z_mm if known.all() else _filled(grid.z_mm, known)
    nodes = [a.astype(np.float64) for a in np.nonzero(known)]
    few = [a[:: max(1, len(a) // _SAMPLE)] for a in nodes]
    for every in _NODES_PER_CELL:
        ny, nx = (max(1, (n - 1) // every) for n in z.shape)
        if min(z.shape[0] - 1 - ny, z.shape[1] - 1 - nx) < FITTED_DEGREE:
            continue
        coefficients = smoothed_coefficients(z, (ny, nx), FITTED_DEGREE)
        dx, dy = grid.dx_mm * (z.shape[1] - 1) / nx, grid.dy_mm * (z.shape[0] - 1) / ny
        surface = SplineSurface(
            "grid", grid.x0_mm, grid.y0_mm, dx, dy, FITTED_DEGREE, coefficients, _full_cells(known)
        )
        if all(_agrees(surface, grid, part[1], part[0], step) for part in (few, nodes)):
            return surface, step
    return None


def _agrees(surface: SplineSurface, grid: GridPoints, ix: Array, iy: Array, step_mm: float) -> bool:
    """Return whether a surface is within half a print step of the points at some nodes."""
    rows, columns = iy.astype(np.intp), ix.astype(np.intp)
    x = grid.x0_mm + ix * grid.dx_mm + grid.off_x_mm[rows, columns]
    y = grid.y0_mm + iy * grid.dy_mm + grid.off_y_mm[rows, columns]
    for part in np.array_split(np.arange(len(x)), len(x) // 16384 + 1):
        jet = surface.jet(x[part], y[part])
        # x and y are printed too: what they are off by shows in z through the slope.
        allowed = 0.5 * step_mm * (1.0 + np.abs(jet.zx) + np.abs(jet.zy)) * _PRINT_SLACK
        if (np.abs(jet.z - grid.z_mm[rows[part], columns[part]]) > allowed).any():
            return False
    return True


def _full_cells(known: Mask) -> Mask:
    """Return the cells of the grid that have all four corners."""
    cells: Mask = known[:-1, :-1] & known[:-1, 1:] & known[1:, :-1] & known[1:, 1:]
    return cells


def _surface_of_degree(grid: GridPoints, known: Mask, degree: int) -> tuple[SplineSurface, float]:
    """Interpolate, moving jittered points back to their nodes along the slope."""
    z = grid.z_mm if known.all() else _filled(grid.z_mm, known)
    at_nodes = z
    coefficients = interpolating_coefficients(z, degree)
    if (
        max(float(np.abs(grid.off_x_mm).max()) / grid.dx_mm, float(np.abs(grid.off_y_mm).max()) / grid.dy_mm)
        > 1e-9
    ):
        iy, ix = (a.ravel().astype(np.float64) for a in np.indices(z.shape))
        for _ in range(2):
            jet = spline_jet(coefficients, degree, ix, iy)
            shift = (
                jet.zu.reshape(z.shape) / grid.dx_mm * grid.off_x_mm
                + jet.zv.reshape(z.shape) / grid.dy_mm * grid.off_y_mm
            )
            at_nodes = z - shift
            coefficients = interpolating_coefficients(at_nodes, degree)
    surface = SplineSurface(
        "grid", grid.x0_mm, grid.y0_mm, grid.dx_mm, grid.dy_mm, degree, coefficients, _full_cells(known)
    )
    return surface, _error_between_nodes(at_nodes, known, degree)


def _filled(z: Array, known: Mask) -> Array:
    """Fill holes with a smooth surface fitted to what is known, so that the spline does not ring."""
    iy, ix = np.nonzero(known)
    cells = tuple(max(4, (n - 1) // 4) for n in z.shape)
    scale = [c / (n - 1) for c, n in zip(cells, z.shape, strict=True)]
    degree = 5
    coefficients = fitted_coefficients(ix * scale[1], iy * scale[0], z[known], (cells[0], cells[1]), degree)
    hy, hx = np.nonzero(~known)
    filled = z.copy()
    filled[~known] = spline_jet(coefficients, degree, hx * scale[1], hy * scale[0]).z
    return filled


def _error_between_nodes(z: Array, known: Mask, degree: int) -> float:
    """Estimate the PV error by leaving out nodes: the error falls with the density as it did before."""
    errors = []
    for stride in (2, 4):
        coarse = z[::stride, ::stride]
        if min(coarse.shape) < degree + 2:
            break
        ny, nx = ((n - 1) * stride + 1 for n in coarse.shape)
        iy, ix = np.nonzero(known[:ny, :nx])
        pick = slice(None, None, max(1, len(ix) // _SAMPLE))
        iy, ix = iy[pick], ix[pick]
        jet = spline_jet(
            interpolating_coefficients(coarse, degree), degree, ix / float(stride), iy / float(stride)
        )
        errors.append(float(np.ptp(jet.z - z[iy, ix])))
    if not errors:
        return float("nan")
    gain = errors[1] / errors[0] if len(errors) == 2 and errors[0] > 0.0 else 1.0
    return errors[0] / float(np.clip(gain, 1.0, 2.0 ** (degree + 1)))
