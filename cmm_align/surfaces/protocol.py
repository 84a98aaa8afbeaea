"""What every nominal surface must answer: height, gradient and Hessian over its own plane.

Normals, curvatures, foot points and the equidistant surface are derived from these in one place
(`geometry`, `numerics.foot_point`) for every kind of surface.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


class Jet(NamedTuple):
    """Height and derivatives of ``z = s(x, y)`` at n places, each of shape (n,)."""

    z: Array
    """Height, mm."""
    zx: Array
    """Slope along x, dimensionless."""
    zy: Array
    zxx: Array
    """Second derivatives, 1/mm."""
    zxy: Array
    zyy: Array


class Bounds(NamedTuple):
    """Rectangle of the plane outside which a surface is not defined, mm."""

    x_min: float
    x_max: float
    y_min: float
    y_max: float

    @property
    def diagonal_mm(self) -> float:
        """Length of the diagonal, mm."""
        return float(np.hypot(self.x_max - self.x_min, self.y_max - self.y_min))


class Surface(Protocol):
    """A height field over the projection plane (frame `surface`)."""

    @property
    def kind(self) -> str:
        """Kind of the nominal: grid, scattered, mesh, prescription."""
        ...

    @property
    def bounds(self) -> Bounds:
        """Rectangle that holds the surface, mm."""
        ...

    def jet(self, x_mm: Array, y_mm: Array) -> Jet:
        """Return height and derivatives at places of shape (n,), mm; NaN where undefined.

        A surface continues smoothly a little past its border, so that a foot point may settle
        there and be told apart by `contains`.
        """
        ...

    def contains(self, x_mm: Array, y_mm: Array) -> Mask:
        """Return, shape (n,), whether places lie where the surface is defined."""
        ...
