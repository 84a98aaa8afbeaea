"""The best gain for each spatial frequency, and a field filtered by a gain curve.

A map holds the form error and noise. The gain that leaves the least mean square of the form error is

    g(f) = S_e(f) / (S_e(f) + S_noise(f)),   S_e = S_map - S_noise,

(N. Wiener, "Extrapolation, interpolation, and smoothing of stationary time series", 1949): near 1 where the
form stands out of the noise, 0 where it does not. One rule gives filter and gain. S_map is the spectrum of
the map averaged over directions and over neighbouring rings, so far that its own scatter stays small.

A field is filtered on a grid wider than itself: its quadratic trend is taken out, the rest is continued
smoothly (`smooth_extension`) and faded to nothing, and both are put together again after the Fourier
transforms. At the border of what is known the filter so meets a smooth surface, not a step.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cmm_align.numerics.areal_filter import Spacing, gaussian_transmission, spacings
from cmm_align.numerics.smooth_extension import extended
from cmm_align.numerics.spectral_density import RadialPsd

Array = NDArray[np.float64]

ENOUGH_FREEDOM: Final = 40.0
"""Independent values behind each entry of the averaged spectrum: it scatters by a fifth of itself."""

SURE: Final = 2.0
"""Standard deviations of its power over that of noise, from which a ring is said to hold form."""

CLEAR_OF_NOISE: Final = 2.0
"""A wave stands out where the map has this many times the power of the noise: S_e > S_noise."""


def averaged_psd_mm4(psd: RadialPsd) -> Array:
    """Return the spectrum averaged over neighbouring rings until its scatter is small.

    Parameters
    ----------
    psd : RadialPsd

    Returns
    -------
    ndarray, shape (rings,), mm^4
        Each the geometric mean over the fewest rings about it, as many on either side, that have
        `ENOUGH_FREEDOM`, weighted by their independent values: a power law stays as it is. The mean logarithm
        of a chi-square of nu degrees of freedom over nu, ``digamma(nu / 2) - log(nu / 2)``, is taken out.
    """
    from scipy.special import digamma

    freedom = np.maximum(np.array(psd.freedom), 1.0)
    half = 0.5 * freedom
    logarithm = np.log(np.maximum(psd.psd_mm4, 1e-300)) - (digamma(half) - np.log(half))
    result = np.empty_like(freedom)
    last = len(freedom) - 1
    for k in range(len(freedom)):
        reach = 0
        while freedom[k - reach : k + reach + 1].sum() < ENOUGH_FREEDOM and reach < min(k, last - k):
            reach += 1
        part = slice(k - reach, k + reach + 1)
        result[k] = np.average(logarithm[part], weights=freedom[part])
    return np.asarray(np.exp(result))


def wiener_share(psd: RadialPsd, chance_mm4: Array | float = 0.0) -> Array:
    """Return the share of lasting form error in the power of each ring, 0 to 1.

    Parameters
    ----------
    psd : RadialPsd
        Of the map, with its noise floor.
    chance_mm4 : ndarray, shape (rings,), mm^4, or float
        What is in the map but will not be there the next time, beside the noise.

    Returns
    -------
    ndarray, shape (rings,)
        1 everywhere if neither is known.
    """
    power = averaged_psd_mm4(psd)
    # a ring that noise alone would give is noise: else chance lets a tenth of all noise through
    sure = 1.0 + SURE * np.sqrt(2.0 / np.maximum(np.array(psd.freedom), ENOUGH_FREEDOM))
    noise = max(psd.noise_floor_mm4, 0.0) + chance_mm4 if psd.noise_floor_mm4 > 0.0 else chance_mm4
    share = np.clip(1.0 - noise / np.maximum(power, 1e-300), 0.0, 1.0)
    return np.asarray(np.where(power > sure * noise, share, 0.0))


def noise_wavelength_mm(psd: RadialPsd) -> float:
    """Return the shortest wave down to which all waves of a map stand out of the noise, mm.

    Parameters
    ----------
    psd : RadialPsd

    Returns
    -------
    float
        That of the border between the last ring that stands out and the next; infinity if not even the
        longest waves do, 0 if all do or no noise is known.
    """
    if not psd.noise_floor_mm4 > 0.0:
        return 0.0
    low = np.flatnonzero(averaged_psd_mm4(psd) < CLEAR_OF_NOISE * psd.noise_floor_mm4)
    if not len(low):
        return 0.0
    return float("inf") if low[0] == 0 else 1.0 / psd.edge_per_mm[int(low[0])]


def regression_mixture(psd: RadialPsd, gain: Array, cutoffs_mm: Array) -> Array:
    """Return the shares of Gaussian regressions whose sum comes nearest to a gain curve.

    A sum of regressions has no bias at the border, as none of them has. Away from the best curve g the mean
    square grows by ``sum S_map (G - g)^2`` over the frequency plane, so this is what is made small.

    Parameters
    ----------
    psd : RadialPsd
        Of the map.
    gain : ndarray, shape (rings,)
        Wanted at its frequencies.
    cutoffs_mm : ndarray, shape (k,), mm
        Of the regressions.

    Returns
    -------
    ndarray, shape (k,)
        None is negative.
    """
    from scipy.optimize import nnls

    wavelength = 1.0 / np.array(psd.frequency_per_mm)
    curves = np.stack([gaussian_transmission(wavelength, float(c)) for c in cutoffs_mm], axis=1)
    weight = np.sqrt(averaged_psd_mm4(psd) * np.array(psd.area_per_mm2))
    trend = float(np.sqrt(np.sum(weight**2)))  # the trend is in no ring: as strong as all of them
    rows = np.vstack([curves * weight[:, None], np.full((1, len(cutoffs_mm)), trend)])
    shares, _ = nnls(rows / trend, np.append(gain * weight, gain[0] * trend) / trend)
    return np.asarray(shares, dtype=np.float64)


def gain_filtered(
    values: Array, spacing_mm: Spacing, gain_at: Callable[[Array], Array], margin_mm: float
) -> Array:
    """Return a masked field with every wave multiplied by the gain of its frequency.

    Parameters
    ----------
    values : ndarray, shape (ny, nx)
        Any unit; NaN where unknown.
    spacing_mm : float or pair of float
        Of both axes, or along x and along y.
    gain_at : callable
        Gain of frequencies in 1/mm, any shape; smooth over one over the size of the field.
    margin_mm : float
        Over which the continued field fades to nothing: at least the longest wave whose gain differs from
        that of the trend.

    Returns
    -------
    ndarray, shape (ny, nx)
        Unit of `values`; NaN where these are unknown.
    """
    from scipy.fft import irfft2, next_fast_len, rfft2

    known = np.isfinite(values)
    trend = _trend(values, known)
    dx, dy = spacings(spacing_mm)
    ny, nx = values.shape
    pad_y, pad_x = (max(int(np.ceil(margin_mm / step)), 1) for step in (dy, dx))
    wide = np.full(
        (next_fast_len(ny + 2 * pad_y, real=True), next_fast_len(nx + 2 * pad_x, real=True)), np.nan
    )
    here = slice(pad_y, pad_y + ny), slice(pad_x, pad_x + nx)
    wide[here] = values - trend
    fade = np.outer(_fade(wide.shape[0], pad_y, ny), _fade(wide.shape[1], pad_x, nx))
    wide[fade <= 0.0] = 0.0
    wide = extended(wide, margin_mm / max(dx, dy)) * fade
    frequency = np.hypot(np.fft.rfftfreq(wide.shape[1], dx), np.fft.fftfreq(wide.shape[0], dy)[:, None])
    smooth = irfft2(rfft2(wide) * gain_at(frequency), s=wide.shape)[here]
    result: Array = np.where(known, smooth + float(gain_at(np.zeros(1))[0]) * trend, np.nan)
    return result


def _trend(values: Array, known: NDArray[np.bool_]) -> Array:
    """Return the quadratic through the known nodes, at all nodes."""
    v, u = np.meshgrid(*(np.linspace(-1.0, 1.0, n) for n in values.shape), indexing="ij")
    basis = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=-1)
    rows = basis[known]
    fit = np.linalg.lstsq(rows.T @ rows, rows.T @ values[known], rcond=None)[0]
    return np.asarray(basis @ fit, dtype=np.float64)


def _fade(count: int, pad: int, inner: int) -> Array:
    """Return weights along an axis: 1 inside, falling to 0 at the outer ends."""
    place = np.arange(count)
    outside = np.maximum(np.maximum(pad - place, place - (pad + inner - 1)), 0)
    return np.asarray(np.cos(0.5 * np.pi * np.minimum(outside / pad, 1.0)) ** 2, dtype=np.float64)
