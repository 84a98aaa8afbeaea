"""Which wavelengths the form error of a map has: its spectral density by rings, and the RMS of bands."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Band:
    """The waves between two lengths."""

    short_mm: float
    long_mm: float
    """The longest band reaches as far as the map."""
    band_rms_um: float
    """RMS of its waves, noise included: bands add up in squares to the RMS of the map less its plane, as the
    window weighs it."""
    noise_rms_um: float
    """What noise alone has there; NaN if no uncertainty is known."""


@dataclass(frozen=True, slots=True)
class Spectrum:
    """The spectral density of a map, averaged over directions.

    Attributes
    ----------
    frequency_per_mm : tuple of float
        Of each ring of the frequency plane, 1/mm: one over its wavelength; from long waves to the shortest
        that the grid carries along every direction.
    psd_um2_mm2 : tuple of float
        Mean of the two-sided density over all directions of each ring, um^2 mm^2, noise included.
    freedom : tuple of float
        Independent values in each ring: the density of noise scatters by sqrt(2 / freedom) of itself.
    bands : tuple of Band
        From short to long waves, with borders of 1, 2 and 5 times a power of ten mm.
    noise_floor_um2_mm2 : float
        Density of the noise of the single points, the same at all wavelengths; NaN if it is not known. The
        window of the map's nodes takes of it at wavelengths of a few spacings, so that the map can lie below.
    shortest_mm : float
        Two spacings of the grid.
    taper_mm : float
        Width over which the window rises from the border of the map.
    missing : str
        Why there is no spectrum; empty where there is one.
    """

    frequency_per_mm: tuple[float, ...] = ()
    psd_um2_mm2: tuple[float, ...] = ()
    freedom: tuple[float, ...] = ()
    bands: tuple[Band, ...] = ()
    noise_floor_um2_mm2: float = float("nan")
    shortest_mm: float = float("nan")
    taper_mm: float = float("nan")
    missing: str = ""
