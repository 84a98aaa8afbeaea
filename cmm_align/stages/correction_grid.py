"""The grid of a correction: that of the map, carried on to the bounds of the nominal; and the surface on it.

The commanded height is ``z = s + total / n_z``, total the sum of the corrections of all passes along the
normal; with ``total`` in its place a slope of 45 degrees would keep 29 % of its error.
"""

from __future__ import annotations

from typing import Final, Literal

import numpy as np

from cmm_align.errors import InputError
from cmm_align.model import Correction, DeviationMap
from cmm_align.numerics.grid_field import continued, interpolated
from cmm_align.stages.map_noise import step_of
from cmm_align.surfaces.protocol import Array, Bounds, Jet

MAX_NODES: Final = 4096
"""Most nodes along a side of the commanded grid."""


def carried_on(deviation_map: DeviationMap) -> tuple[Array, Array, tuple[slice, slice]]:
    """Return the nodes of a map carried on past the bounds of the nominal, and where the map lies in them.

    Returns
    -------
    x_mm, y_mm : ndarray, shape (nx,), (ny,), mm, frame `surface`
    here : pair of slice
        Rows and columns of the map.

    Raises
    ------
    InputError
        If the aperture is far larger than what was measured.
    """
    m, bounds = deviation_map, deviation_map.alignment.nominal.surface.bounds
    x_mm, before_x = _further(m.x_mm, *bounds[:2])
    y_mm, before_y = _further(m.y_mm, *bounds[2:])
    _check_size(x_mm, y_mm, bounds)
    ny, nx = m.deviation_mm.shape
    return x_mm, y_mm, (slice(before_y, before_y + ny), slice(before_x, before_x + nx))


def total_so_far(previous: Correction | None, x_mm: Array, y_mm: Array) -> Array:
    """Return the total correction of the earlier passes on a grid, complete.

    Parameters
    ----------
    previous : Correction or None
    x_mm, y_mm : ndarray, shape (nx,), (ny,), mm, frame `surface`

    Returns
    -------
    ndarray, shape (ny, nx), mm
    """
    if previous is None:
        return np.zeros((len(y_mm), len(x_mm)))
    return continued(on_grid(previous, continued(previous.total_correction_mm), x_mm, y_mm))


def on_grid(correction: Correction, field: Array, x_mm: Array, y_mm: Array) -> Array:
    """Return a field of a correction on another grid, NaN where it does not reach.

    Parameters
    ----------
    correction : Correction
    field : ndarray, shape of its grid
    x_mm, y_mm : ndarray, shape (nx,), (ny,), mm, frame `surface`

    Returns
    -------
    ndarray, shape (ny, nx)
    """
    x, y = (a.ravel() for a in np.meshgrid(x_mm, y_mm))
    return interpolated(correction.x_mm, correction.y_mm, field, x, y).reshape(len(y_mm), len(x_mm))


def commanded_surface(jet: Jet, side: int, total: Array, x_mm: Array, y_mm: Array) -> tuple[Array, Array]:
    """Return height and unit normals of ``z = s + total / n_z``.

    With ``1 / n_z = side w``, ``w = sqrt(1 + s_x^2 + s_y^2)``, the gradient is that of s plus
    ``side (w grad(total) + total grad(w))``; only ``grad(total)`` is taken from the grid (second order).

    Parameters
    ----------
    jet : Jet
        Of the nominal, each of shape (ny, nx).
    side : int
    total : ndarray, shape (ny, nx), mm
        Along the normal.
    x_mm, y_mm : ndarray, shape (nx,), (ny,), mm

    Returns
    -------
    height : ndarray, shape (ny, nx), mm
    normal : ndarray, shape (ny, nx, 3)
    """
    w = np.sqrt(1.0 + jet.zx**2 + jet.zy**2)
    total_y, total_x = gradient(total, x_mm, y_mm)
    zx = jet.zx + side * (w * total_x + total * (jet.zx * jet.zxx + jet.zy * jet.zxy) / w)
    zy = jet.zy + side * (w * total_y + total * (jet.zx * jet.zxy + jet.zy * jet.zyy) / w)
    scale = side / np.sqrt(1.0 + zx**2 + zy**2)
    return jet.z + side * w * total, np.stack([-zx * scale, -zy * scale, scale], axis=-1)


def gradient(field: Array, x_mm: Array, y_mm: Array) -> tuple[Array, Array]:
    """Return the derivatives of a field along y and along x, second order, each of shape (ny, nx)."""
    order: Literal[1, 2] = 2 if min(field.shape) >= 3 else 1
    along_y: Array = np.gradient(field, y_mm, axis=0, edge_order=order)
    along_x: Array = np.gradient(field, x_mm, axis=1, edge_order=order)
    return along_y, along_x


def _further(nodes_mm: Array, low_mm: float, high_mm: float) -> tuple[Array, int]:
    """Return nodes carried on past both limits by the same step, and how many were put before."""
    step = step_of(nodes_mm)
    before = max(int(np.ceil((nodes_mm[0] - low_mm) / step - 1e-9)), 0)
    after = max(int(np.ceil((high_mm - nodes_mm[-1]) / step - 1e-9)), 0)
    start, end = nodes_mm[0] - step * np.arange(before, 0, -1), nodes_mm[-1] + step * np.arange(1, after + 1)
    return np.concatenate([start, nodes_mm, end]), before


def _check_size(x_mm: Array, y_mm: Array, bounds: Bounds) -> None:
    """Refuse an aperture that is far larger than what was measured."""
    if max(len(x_mm), len(y_mm)) > MAX_NODES:
        raise InputError(
            f"the aperture ({bounds.x_max - bounds.x_min:.4g} x {bounds.y_max - bounds.y_min:.4g} mm) takes "
            f"{len(x_mm)} x {len(y_mm)} nodes at the spacing of the map",
            expected=f"at most {MAX_NODES} along a side",
            remedy="make the map with a larger spacing, or the nominal with a smaller aperture",
        )
