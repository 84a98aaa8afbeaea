"""A form error with nothing in it that a rigid motion could take away.

The raw shape is astigmatism, trefoil, a few bumps and a mid-spatial ripple. Its best-fit rigid motion
over the aperture (least squares with the rows ``J = [p x n, n]``) is subtracted, then the rest is
scaled to the wanted PV. A perfect alignment therefore finds exactly this error, and the identity.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from cmm_align.surfaces.geometry import unit_normal
from cmm_align.surfaces.protocol import Array, Bounds, Surface

DEFAULT_PV_MM: Final = 0.027
_NODES: Final = (301, 201)
"""Nodes along x and y of the grid that defines PV and the best fit."""
_SIDE: Final = 1


@dataclass(frozen=True, slots=True)
class FormError:
    """Deviation along the outward normal as a function of the foot point's place.

    Attributes
    ----------
    surface : Surface
        The nominal, probe on its +z side.
    bumps : ndarray, shape (k, 4)
        Place (in half widths), width (in half widths) and height of each bump.
    ripple_phase_rad : float
    rigid : ndarray, shape (6,)
        Rigid motion that was taken out, in units of the raw shape.
    scale_mm : float
        Size of one unit of the raw shape, mm.
    """

    surface: Surface
    bumps: Array
    ripple_phase_rad: float
    rigid: Array
    scale_mm: float

    def at(self, x_mm: Array, y_mm: Array) -> Array:
        """Return the deviation at foot points, positive = excess material.

        Parameters
        ----------
        x_mm, y_mm : ndarray, shape (n,), mm, frame `part`
            Places of the foot points.

        Returns
        -------
        ndarray, shape (n,), mm
        """
        raw = _raw_shape(self.surface.bounds, self.bumps, self.ripple_phase_rad, x_mm, y_mm)
        return self.scale_mm * (raw - motion_rows(self.surface, x_mm, y_mm) @ self.rigid)


def form_error(surface: Surface, *, pv_mm: float = DEFAULT_PV_MM, seed: int = 1) -> FormError:
    """Return a smooth form error with exactly the given PV over a dense grid of the surface.

    Parameters
    ----------
    surface : Surface
        Nominal whose bounds are its aperture.
    pv_mm : float
        Peak to valley, mm.
    seed : int
        Chooses the bumps and the phase of the ripple.
    """
    rng = np.random.default_rng(seed)
    bumps = np.column_stack(
        [
            rng.uniform(-0.75, 0.75, size=(5, 2)),
            rng.uniform(0.18, 0.35, size=5),
            rng.choice([-1.0, 1.0], size=5) * rng.uniform(0.25, 0.6, size=5),
        ]
    )
    phase = float(rng.uniform(0.0, 2.0 * np.pi))
    x, y = _net(surface.bounds)
    raw = _raw_shape(surface.bounds, bumps, phase, x, y)
    rows = motion_rows(surface, x, y)
    rigid = np.asarray(np.linalg.lstsq(rows, raw, rcond=None)[0], dtype=np.float64)
    rest = raw - rows @ rigid
    return FormError(surface, bumps, phase, rigid, pv_mm / float(np.ptp(rest)))


def _net(bounds: Bounds) -> tuple[Array, Array]:
    """Return the places that define PV and best fit."""
    x, y = np.meshgrid(
        np.linspace(bounds.x_min, bounds.x_max, _NODES[0]),
        np.linspace(bounds.y_min, bounds.y_max, _NODES[1]),
    )
    return x.ravel(), y.ravel()


def _raw_shape(bounds: Bounds, bumps: Array, phase_rad: float, x_mm: Array, y_mm: Array) -> Array:
    """Return the shape before the rigid motion is taken out, of order one."""
    u = (2.0 * x_mm - bounds.x_min - bounds.x_max) / (bounds.x_max - bounds.x_min)
    v = (2.0 * y_mm - bounds.y_min - bounds.y_max) / (bounds.y_max - bounds.y_min)
    shape = 0.5 * (u**2 - v**2) + 0.3 * u * v + 0.22 * (u**3 - 3.0 * u * v**2)
    shape = shape + 0.07 * np.sin(2.0 * np.pi * (5.0 * u + 1.0 * v) + phase_rad)
    for at_u, at_v, width, height in bumps:
        shape = shape + height * np.exp(-0.5 * ((u - at_u) ** 2 + (v - at_v) ** 2) / width**2)
    return np.asarray(shape, dtype=np.float64)


def motion_rows(surface: Surface, x_mm: Array, y_mm: Array) -> Array:
    """Return rows ``[p x n, n]`` of shape (n, 6), rotations scaled to the size of the part.

    Parameters
    ----------
    surface : Surface
    x_mm, y_mm : ndarray, shape (n,), mm
    """
    jet = surface.jet(x_mm, y_mm)
    normals = unit_normal(jet, _SIDE)
    points = np.column_stack([x_mm, y_mm, jet.z]) / surface.bounds.diagonal_mm
    return np.hstack([np.cross(points, normals), normals])
