"""Which wavelengths a map has: its radial spectral density, the noise floor of its points, the RMS of bands.

The density of white noise of standard deviation s on points that stand for an area a each is s^2 a, whatever
the grid; a node that averages several points has as much less noise as the points are denser than nodes.
Method and sources: `numerics.spectral_density`.
"""

from __future__ import annotations

from math import floor, inf, log10, nan
from typing import Final

import numpy as np

from cmm_align.errors import GeometryError
from cmm_align.model.spectrum import Band, Spectrum
from cmm_align.numerics.spectral_density import RadialPsd, band_rms_mm, radial_psd
from cmm_align.surfaces.protocol import Array
from cmm_align.units import UM_PER_MM

_STEPS: Final = (1.0, 2.0, 5.0)
"""Borders of the bands in each decade."""


def map_spectrum(
    deviation_mm: Array, spacing_mm: tuple[float, float], scatter_mm: float, n_points: int
) -> Spectrum:
    """Return the spectrum of a map, or why it has none.

    Parameters
    ----------
    deviation_mm : ndarray, shape (ny, nx), mm
        NaN where unknown; filtered or not.
    spacing_mm : (float, float)
        Along x and along y.
    scatter_mm : float
        Standard deviation of the single points about the map; NaN if it is not known.
    n_points : int
        Points behind the map, taken as spread evenly over it.

    Notes
    -----
    A sine on 90 x 60 nodes is found in its ring and band with its RMS within 3 %, and the floor is that of
    the white noise of the points within its scatter (tested).
    """
    dx, dy = spacing_mm
    points_a_node = n_points / max(int(np.isfinite(deviation_mm).sum()), 1)
    try:
        psd = radial_psd(deviation_mm, spacing_mm, scatter_mm / points_a_node**0.5)
    except GeometryError as error:
        return Spectrum(missing=error.what)
    squared = UM_PER_MM**2
    whole = [k for k, edge in enumerate(psd.edge_per_mm[1:]) if edge <= psd.nyquist_per_mm * (1.0 + 1e-9)]
    shortest_mm = 2.0 * max(dx, dy)
    return Spectrum(
        frequency_per_mm=tuple(psd.frequency_per_mm[k] for k in whole),
        psd_um2_mm2=tuple(psd.psd_mm4[k] * squared for k in whole),
        freedom=tuple(psd.freedom[k] for k in whole),
        bands=_bands(psd, shortest_mm),
        noise_floor_um2_mm2=psd.noise_floor_mm4 * squared,
        shortest_mm=shortest_mm,
        taper_mm=psd.taper_mm,
    )


def _bands(psd: RadialPsd, shortest_mm: float) -> tuple[Band, ...]:
    """Return the bands, the shortest waves first; the first and the last take what lies beyond."""
    longest_mm = 1.0 / psd.frequency_per_mm[0]
    borders = [
        step * 10.0**power
        for power in range(floor(log10(shortest_mm)), floor(log10(longest_mm)) + 1)
        for step in _STEPS
    ]
    inner = [border for border in borders if shortest_mm < border < longest_mm]
    shown = [shortest_mm, *inner, longest_mm]
    cuts = [0.0, *inner, inf]
    bands = []
    for k in range(len(cuts) - 1):
        rms_mm, noise_mm = band_rms_mm(psd, cuts[k], cuts[k + 1])
        noise_um = noise_mm * UM_PER_MM if np.isfinite(noise_mm) else nan
        bands.append(Band(shown[k], shown[k + 1], rms_mm * UM_PER_MM, noise_um))
    return tuple(bands)
