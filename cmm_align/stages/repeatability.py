"""What differs from pass to pass: a stationary field with the covariance ``s^2 exp(-r^2 / (2 l^2))``.

A best fit takes the rigid motions out of it. Over the part the height and the two tilts are its longest
waves, so the three lowest of the modes that the part holds (one per 1 / area of the frequency plane) are
left out of its spectrum; what the other three motions take, on a curved part, lies higher and is little.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from cmm_align.config import CompensateConfig
from cmm_align.numerics.spectral_density import RadialPsd
from cmm_align.surfaces.protocol import Array, Bounds
from cmm_align.units import UM_PER_MM

LENGTHS_PER_DIAGONAL: Final = 12.0
"""Correlation length where it is not given: the diagonal of the part over this."""
MOTIONS: Final = 3
"""Modes that a best fit takes out."""


def repeatability_length_mm(config: CompensateConfig, bounds: Bounds) -> float:
    """Return the correlation length of what differs from pass to pass, mm."""
    return config.repeatability_length_mm or bounds.diagonal_mm / LENGTHS_PER_DIAGONAL


def repeatability_psd_mm4(config: CompensateConfig, bounds: Bounds, psd: RadialPsd) -> Array:
    """Return its spectrum on the rings of a map, of the right variance there, shape (rings,), mm^4.

    Parameters
    ----------
    config : CompensateConfig
    bounds : Bounds
        Of the part.
    psd : RadialPsd
        Whose rings to take.
    """
    frequency, area = np.array(psd.frequency_per_mm), np.array(psd.area_per_mm2)
    shape = np.exp(-2.0 * (np.pi * repeatability_length_mm(config, bounds) * frequency) ** 2)
    part_mm2 = (bounds.x_max - bounds.x_min) * (bounds.y_max - bounds.y_min)
    modes = part_mm2 * np.concatenate([[0.0], np.cumsum(area)])
    shape *= np.diff(np.maximum(modes - MOTIONS, 0.0)) / np.diff(modes)
    total = float(shape @ area)
    scale = (config.repeatability_um / UM_PER_MM) ** 2 / total if total > 0.0 else 0.0
    return np.asarray(scale * shape, dtype=np.float64)
