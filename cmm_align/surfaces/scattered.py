"""Nominal points without order: a smooth surface fitted to them, and where it is known.

A least-squares tensor spline of degree 5, its knots refined until the misfit stops falling. Its normal
equations are summed cell by cell, so the cost grows with the number of points alone.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from cmm_align.errors import GeometryError
from cmm_align.numerics.scattered_spline import fitted_coefficients
from cmm_align.surfaces.protocol import Array, Mask
from cmm_align.surfaces.spline_surface import SplineSurface

DEGREE: Final = 5
POINTS_PER_CELL: Final = 12
"""Fewest points a cell should hold on average: fewer leave the spline to its smoothness term."""
MOST_CELLS: Final = 160
"""Along the longer side; the width of the band, and so the cost, grows with the shorter one."""

_TRIAL_POINTS: Final = 120_000
_ENOUGH: Final = 1e-13
"""Misfit below this share of the size is rounding."""


def fitted_surface(points_mm: Array, kind: str, enough_mm: float = 0.0) -> tuple[SplineSurface, float]:
    """Return a smooth surface through scattered points, and its misfit.

    Parameters
    ----------
    points_mm : ndarray, shape (n, 3), mm, frame `surface`
    kind : str
        Kind of the surface.
    enough_mm : float
        Misfit (PV) at which to stop refining, mm; 0 goes on to rounding.

    Returns
    -------
    surface : SplineSurface
    misfit_pv_mm : float
        PV of the misfit at the points, mm.

    Raises
    ------
    GeometryError
        If the points span no area.
    """
    low, high = points_mm[:, :2].min(axis=0), points_mm[:, :2].max(axis=0)
    size = high - low
    if float(size.min()) <= 1e-9 * float(size.max()):
        raise GeometryError("the nominal points lie on a line", expected="points that span an area")
    mask = _where_known(points_mm, low, size)
    area = float(size.prod()) * float(mask.mean())
    sample = points_mm[:: max(1, len(points_mm) // _TRIAL_POINTS)]
    best: tuple[SplineSurface, float] | None = None
    per_cell, finest = 96.0, POINTS_PER_CELL * len(sample) / len(points_mm)
    # Refine on a sample as far as all points could carry it; then fit the best net to all points.
    while True:
        cells = _cells(size, area, len(sample) / per_cell)
        trial = _fit(sample, low, size, cells, mask, kind)
        if best is not None and trial[1] > 0.5 * best[1]:
            break
        best = trial
        if best[1] < max(_ENOUGH * float(size.max()), enough_mm) or max(cells) >= MOST_CELLS:
            break
        if per_cell / 3.0 < max(finest, POINTS_PER_CELL):
            break
        per_cell /= 3.0
    if len(sample) == len(points_mm):
        return best
    ny, nx = (n - DEGREE for n in best[0].coefficients_mm.shape)
    return _fit(points_mm, low, size, (ny, nx), mask, kind)


def _cells(size: Array, area: float, count: float) -> tuple[int, int]:
    """Return (ny, nx) of nearly square cells, `count` of them on the known area."""
    pitch = float(np.sqrt(area / max(count, 1.0)))
    pitch = max(pitch, float(size.max()) / MOST_CELLS)
    nx, ny = (max(1, round(float(s) / pitch)) for s in size)
    return ny, nx


def _fit(
    points_mm: Array, low: Array, size: Array, cells: tuple[int, int], mask: Mask, kind: str
) -> tuple[SplineSurface, float]:
    """Fit one net of cells."""
    ny, nx = cells
    dx, dy = float(size[0]) / nx, float(size[1]) / ny
    coefficients = fitted_coefficients(
        (points_mm[:, 0] - low[0]) / dx, (points_mm[:, 1] - low[1]) / dy, points_mm[:, 2], cells, DEGREE
    )
    surface = SplineSurface(kind, float(low[0]), float(low[1]), dx, dy, DEGREE, coefficients, mask)
    rest = [
        surface.jet(part[:, 0], part[:, 1]).z - part[:, 2]
        for part in np.array_split(points_mm, len(points_mm) // 16384 + 1)
    ]
    return surface, float(np.ptp(np.concatenate(rest)))


def _where_known(points_mm: Array, low: Array, size: Array) -> Mask:
    """Return the cells of a net of about four points each that hold points, small gaps closed."""
    pitch = float(np.sqrt(4.0 * float(size.prod()) / len(points_mm)))
    nx, ny = (max(2, min(1024, int(float(s) / pitch))) for s in size)
    ix = np.minimum(((points_mm[:, 0] - low[0]) / size[0] * nx).astype(np.intp), nx - 1)
    iy = np.minimum(((points_mm[:, 1] - low[1]) / size[1] * ny).astype(np.intp), ny - 1)
    mask = np.zeros((ny, nx), dtype=bool)
    mask[iy, ix] = True
    return _eroded(_grown(mask))


def _grown(mask: Mask) -> Mask:
    """Add every cell that touches one of the mask, the diagonal included."""
    padded = np.pad(mask, 1)
    ny, nx = mask.shape
    result = mask.copy()
    for j in range(3):
        for i in range(3):
            result |= padded[j : j + ny, i : i + nx]
    return result


def _eroded(mask: Mask) -> Mask:
    """Take away every cell that touches the outside of the mask; the border of the net is not outside."""
    return ~_grown(~mask)
