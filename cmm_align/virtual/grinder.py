"""A virtual grinder: it cuts the surface it is told, with its own error on top.

``part = process error + transfer x (commanded - nominal) + repeatability``. The process error comes
back in every pass (wheel shape, machine geometry); that is why telling the machine the opposite
helps. The transfer is a little below one, and every pass differs a little from the last.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from scipy.interpolate import RBFInterpolator

from cmm_align.surfaces.geometry import unit_normal
from cmm_align.surfaces.protocol import Array, Surface

TRANSFER: Final = 0.96
REPEATABILITY_MM: Final = 0.0008
_WAVES: Final = 6
_NEIGHBOURS: Final = 16
_SIDE: Final = 1

Deviation = Callable[[Array, Array], Array]


def second_pass(
    surface: Surface,
    process_error: Deviation,
    commanded_mm: Array,
    *,
    transfer: float = TRANSFER,
    repeatability_mm: float = REPEATABILITY_MM,
    seed: int = 4,
) -> Deviation:
    """Return the deviation of the part after it was ground to a commanded surface.

    Parameters
    ----------
    surface : Surface
        Nominal, probe on its +z side.
    process_error : callable
        What the machine adds in every pass: deviation in mm at foot points (x, y).
    commanded_mm : ndarray, shape (n, 3), mm, frame `part`
        Points of the commanded surface, as in the exported text.
    transfer : float
        Share of a commanded change that reaches the part.
    repeatability_mm : float
        Standard deviation of what differs from pass to pass, mm.
    seed : int
        Of the repeatability.

    Returns
    -------
    callable
        Deviation in mm at foot points (x, y), positive = excess material.
    """
    jet = surface.jet(commanded_mm[:, 0], commanded_mm[:, 1])
    # To first order in the correction, which is a thousand times smaller than the part's curvature radius.
    along_normal = (commanded_mm[:, 2] - jet.z) * unit_normal(jet, _SIDE)[:, 2]
    # A thin plate through the nearest nodes also carries on to the border, past the last node.
    change = RBFInterpolator(commanded_mm[:, :2], along_normal, neighbors=_NEIGHBOURS)
    wander = _repeatability(surface, repeatability_mm, seed)

    def deviation_at(x_mm: Array, y_mm: Array) -> Array:
        """Return the deviation of the new part."""
        cut = change(np.column_stack([x_mm, y_mm]))
        result: Array = process_error(x_mm, y_mm) + transfer * cut + wander(x_mm, y_mm)
        return result

    return deviation_at


def _repeatability(surface: Surface, size_mm: float, seed: int) -> Deviation:
    """Return a smooth random field of the given standard deviation: a few long waves."""
    rng = np.random.default_rng(seed)
    waves = rng.normal(scale=2.0 * np.pi / (0.5 * surface.bounds.diagonal_mm), size=(_WAVES, 2))
    phases = rng.uniform(0.0, 2.0 * np.pi, _WAVES)
    amplitude = size_mm * np.sqrt(2.0 / _WAVES)

    def wander(x_mm: Array, y_mm: Array) -> Array:
        """Return the field at places (x, y)."""
        angles = np.multiply.outer(x_mm, waves[:, 0]) + np.multiply.outer(y_mm, waves[:, 1]) + phases
        return np.asarray(amplitude * np.sin(angles).sum(axis=-1), dtype=np.float64)

    return wander
