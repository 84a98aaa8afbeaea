"""Which waves of a map are corrected: what sampling, noise and wheel allow, and the filter that keeps to it.

The longest of these is the cutoff, and is named:

- sampling: four steps of the map;
- noise: the shortest wave down to which the form stands out of the noise, S_e(f) > S_noise(f);
- wheel: a concave ripple of amplitude A must not be curved more than the wheel of radius rho on a surface of
  curvature k, so ``L >= 2 pi sqrt(A rho_eff)``, ``rho_eff = rho / (1 - rho k)`` (k > 0 where concave), A the
  amplitude of a sine with the RMS of the correction;
- map: the low-pass that the map went through; asked: what the user wants.

With a fixed gain the filter is the areal Gaussian regression of order 2 (half at the cutoff), which has no
bias at the border. With the Wiener gain every frequency has a gain of its own,
``min(g_W, exp(-ln 2 (f L)^4)) / c``, c the transfer of the process where it is known; noise then needs no
cutoff, and what differs from pass to pass counts as noise. The filter is the sum of Gaussian regressions that
comes nearest to that curve: filtered by Fourier transforms the same curve left 2 to 5 % more, all of it along
the border. On twenty spectra both rules are within 2 % of the best fixed gain
(``tests/bench/gain_rules.py``).
"""

from __future__ import annotations

from math import log, pi, sqrt
from typing import Final

import numpy as np

from cmm_align.config import CompensateConfig
from cmm_align.model import CorrectionBand, DeviationMap, LearnedTransfer, ProcessTransfer
from cmm_align.numerics.areal_filter import (
    SPACINGS_PER_CUTOFF,
    cutoff_limits_mm,
    gaussian_regression,
    gaussian_transmission,
)
from cmm_align.numerics.spectral_density import RadialPsd
from cmm_align.numerics.wiener_gain import noise_wavelength_mm, regression_mixture, wiener_share
from cmm_align.stages.learned_transfer import gain_of, gains_at, stepped_gain
from cmm_align.stages.map_noise import MapNoise, step_of
from cmm_align.stages.repeatability import repeatability_psd_mm4
from cmm_align.surfaces.geometry import principal_curvatures
from cmm_align.surfaces.protocol import Array

MAX_GAIN: Final = 1.2
"""The loop stays well inside its limit of 2 even for a process that cuts more than it is told."""

RATIO: Final = 1.6
"""Of neighbouring cutoffs of the regressions that make up a Wiener gain."""

_WORDS: Final = {
    "sampling": "the spacing of the map",
    "noise": "noise: shorter waves do not stand out of it",
    "wheel": "the wheel: it cannot cut shorter waves of this size",
    "map": "the low-pass of the map",
    "asked": "as asked",
}


def correction_band(
    deviation_map: DeviationMap,
    noise: MapNoise,
    config: CompensateConfig,
    transfer: ProcessTransfer,
    learned: LearnedTransfer | None = None,
) -> CorrectionBand:
    """Return which waves of a map are to be corrected, by how much, and what allows no shorter ones.

    Parameters
    ----------
    deviation_map : DeviationMap
    noise : MapNoise
    config : CompensateConfig
        Gain, rule, low-pass and wheel.
    transfer : ProcessTransfer
    learned : LearnedTransfer, optional
        From a ledger: the gain of each band is divided by it, whatever the rule.
    """
    m = deviation_map
    wiener = config.gain_rule == "wiener"
    longest = cutoff_limits_mm(m.deviation_mm, (step_of(m.x_mm), step_of(m.y_mm)))[1]
    limits = {
        "sampling": SPACINGS_PER_CUTOFF * max(step_of(m.x_mm), step_of(m.y_mm)),
        "noise": noise_wavelength_mm(noise.psd),
        "wheel": _wheel_limit_mm(deviation_map, config),
        "map": 0.0 if m.filter is None else m.filter.low_pass_mm,
        "asked": config.low_pass_mm,
    }
    bound = max((name for name in limits if not (wiener and name == "noise")), key=lambda name: limits[name])
    low_pass = min(limits[bound], longest)
    frequency = np.array(noise.psd.frequency_per_mm)
    cutoffs, shares = np.array([low_pass]), np.array([config.gain])
    if wiener:
        chance = repeatability_psd_mm4(config, m.alignment.nominal.surface.bounds, noise.psd)
        share = np.minimum(wiener_share(noise.psd, chance), np.exp(-log(2.0) * (frequency * low_pass) ** 4))
        wanted = np.minimum(share / transfer.at(frequency) if transfer.known else share, MAX_GAIN)
        if learned is not None:
            wanted = share * gains_at(learned, frequency)
        cutoffs = np.geomspace(low_pass, longest, max(round(log(longest / low_pass) / log(RATIO)), 1) + 1)
        shares = regression_mixture(noise.psd, wanted, cutoffs)
        cutoffs, shares = cutoffs[shares > 0.0], shares[shares > 0.0]
    elif learned is not None:
        cutoffs, shares = stepped_gain(learned, config.gain, low_pass, longest)
    most = max(MAX_GAIN, config.gain) * (1.0 if learned is None else max(map(gain_of, learned.bands)))
    curves = [s * gaussian_transmission(1.0 / frequency, c) for c, s in zip(cutoffs, shares, strict=True)]
    gain = np.minimum(np.sum(curves, axis=0), most) if curves else 0.0 * frequency
    lead = "gain by frequency (Wiener), waves" if wiener else "waves"
    return CorrectionBand(
        low_pass_mm=low_pass,
        bound=bound,
        sampling_mm=limits["sampling"],
        noise_mm=min(limits["noise"], longest),
        wheel_mm=limits["wheel"],
        frequency_per_mm=tuple(frequency.tolist()),
        gain=tuple(gain.tolist()),
        cutoff_mm=tuple(cutoffs.tolist()),
        share=tuple(shares.tolist()),
        words=f"{lead} over {low_pass:.3g} mm, set by {_WORDS[bound]}",
    )


def filtered_deviation(deviation_map: DeviationMap, band: CorrectionBand, usable: Array) -> Array:
    """Return what is to be taken off, gain included.

    Parameters
    ----------
    deviation_map : DeviationMap
    band : CorrectionBand
    usable : ndarray, shape (ny, nx), mm
        The deviations of the map, NaN at nodes that are not to be used.

    Returns
    -------
    ndarray, shape (ny, nx), mm
        NaN where there is nothing to go by.
    """
    steps = step_of(deviation_map.x_mm), step_of(deviation_map.y_mm)
    result = np.zeros(usable.shape)
    longest = cutoff_limits_mm(usable, steps)[1]
    for cutoff, share in zip(band.cutoff_mm, band.share, strict=True):
        result += share * gaussian_regression(usable, steps, min(cutoff, longest))
    return result


def mean_gain(psd: RadialPsd, band: CorrectionBand) -> float:
    """Return the gain averaged over the power of a map."""
    power = np.array(psd.psd_mm4) * np.array(psd.area_per_mm2)
    return float(power @ np.array(band.gain) / power.sum()) if power.sum() > 0.0 else float(band.gain[0])


def _wheel_limit_mm(deviation_map: DeviationMap, config: CompensateConfig) -> float:
    """Return the shortest wave that the wheel can cut, mm; 0 if its radius is not known."""
    rho = config.wheel_radius_mm
    if rho <= 0.0:
        return 0.0
    known = np.isfinite(deviation_map.deviation_mm)
    x, y = (a[known] for a in np.meshgrid(deviation_map.x_mm, deviation_map.y_mm))
    nominal = deviation_map.alignment.nominal
    curvature = float(principal_curvatures(nominal.surface.jet(x, y), nominal.side).most.max())
    effective = rho / max(1.0 - rho * curvature, 1e-3)
    amplitude = sqrt(2.0) * config.gain * float(np.sqrt(np.mean(deviation_map.deviation_mm[known] ** 2)))
    return 2.0 * pi * sqrt(amplitude * max(effective, 0.0))
