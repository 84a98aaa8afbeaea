"""A height field as a tensor-product B-spline on uniform knots, with a mask of cells.

Both gridded nominals (interpolated) and scattered ones (fitted) end up as this one class; only the
way to the coefficients differs (`grid`, `scattered`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from cmm_align.numerics.tensor_spline import spline_jet
from cmm_align.surfaces.protocol import Array, Bounds, Jet, Mask

BORDER_SLACK: Final = 1e-3
"""A foot point this share of a cell past the border still lies on the surface: noise moves it there."""


@dataclass(frozen=True, slots=True)
class SplineSurface:
    """Spline ``z = s(x, y)`` over the cells of a uniform net.

    Attributes
    ----------
    kind : str
        ``grid``, ``scattered`` or ``mesh``.
    x0_mm, y0_mm : float
        Lower left corner of the net, mm.
    dx_mm, dy_mm : float
        Size of a cell, mm.
    degree : int
        3 or 5.
    coefficients_mm : ndarray, shape (n_cells_y + degree, n_cells_x + degree), mm
        Of the uniform B-splines.
    cells : ndarray of bool, shape (n_mask_y, n_mask_x)
        Which cells of a net over the same rectangle hold surface; it may be coarser or finer than
        the net of the spline.
    """

    kind: str
    x0_mm: float
    y0_mm: float
    dx_mm: float
    dy_mm: float
    degree: int
    coefficients_mm: Array
    cells: Mask

    @property
    def bounds(self) -> Bounds:
        """Rectangle of the net, mm."""
        ny, nx = (n - self.degree for n in self.coefficients_mm.shape)
        return Bounds(self.x0_mm, self.x0_mm + nx * self.dx_mm, self.y0_mm, self.y0_mm + ny * self.dy_mm)

    def jet(self, x_mm: Array, y_mm: Array) -> Jet:
        """Return height and derivatives; past the border the last cell's polynomial continues."""
        z, zu, zv, zuu, zuv, zvv = spline_jet(
            self.coefficients_mm,
            self.degree,
            (x_mm - self.x0_mm) / self.dx_mm,
            (y_mm - self.y0_mm) / self.dy_mm,
        )
        dx, dy = self.dx_mm, self.dy_mm
        return Jet(z, zu / dx, zv / dy, zuu / dx**2, zuv / (dx * dy), zvv / dy**2)

    def contains(self, x_mm: Array, y_mm: Array) -> Mask:
        """Return whether places lie in a cell that holds surface."""
        b = self.bounds
        ny, nx = self.cells.shape
        u = (x_mm - b.x_min) / (b.x_max - b.x_min) * nx
        v = (y_mm - b.y_min) / (b.y_max - b.y_min) * ny
        inside: Mask = (
            (u >= -BORDER_SLACK) & (u <= nx + BORDER_SLACK) & (v >= -BORDER_SLACK) & (v <= ny + BORDER_SLACK)
        )
        if self.cells.all():
            return inside
        ix = np.clip(np.where(np.isfinite(u), u, 0.0).astype(np.intp), 0, nx - 1)
        iy = np.clip(np.where(np.isfinite(v), v, 0.0).astype(np.intp), 0, ny - 1)
        result: Mask = inside & self.cells[iy, ix]
        return result
