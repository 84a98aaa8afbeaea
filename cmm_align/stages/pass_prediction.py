"""What the next measurement will find, and whether another pass pays.

Model. A pass makes the whole surface anew: ``e_k = d_k + v_k``, d the error that the process repeats and v
what differs from pass to pass, measured with noise n_k. With the correction ``-G (e_k + n_k)`` and the
transfer c the next measurement is

    e' = (1 - cG) (e_k + n_k) - v_k - n_k + v_{k+1} + n_{k+1},

and its mean square, v and n being independent of d and of each other,

    RMS'^2 = <((1 - cG) e_measured)^2> + 2 tr(cG (V + N)) + u_c^2 <(G e)^2>,

V and N the spectra of v and n, u_c the standard uncertainty of c. The first term is what the correction
leaves of this very map, the second what it cannot know: noise and chance of this pass are ground into the
next one as if they would come back. (A single formula of the literature, ``(1 - gc)^2 RMS_F^2 + RMS_out^2 +
s_rep^2 + g^2 s_m^2``, leaves out that the repeatability of pass k is in its map too; with g c = 1 a stable
process then scatters by sqrt(2) s_rep: W. E. Deming, "Out of the crisis", 1986, the funnel, rule 2.)

The variance of RMS'^2 has four parts: ``2 tr((1 + c^2 G^2)^2 V^2)`` and ``4 <a, (1 + c^2 G^2) V a>`` with a
the residual, the same for the white noise of the N points, and the transfer. The interval is that of a
gamma distribution with this mean and variance (F. E. Satterthwaite 1946, doi 10.2307/3002019). The field v
is taken as a stationary one with the covariance ``s_rep^2 exp(-r^2 / (2 l^2))``. What is common to
neighbouring touches (drift and lobing of the machine) is not in it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from cmm_align.config import CompensateConfig
from cmm_align.model import CorrectionBand, PassPrediction, ProcessTransfer, Statistics
from cmm_align.numerics.grid_field import interpolated
from cmm_align.numerics.wiener_gain import gain_filtered
from cmm_align.stages.deviation_statistics import deviation_statistics
from cmm_align.stages.map_grid import Places
from cmm_align.stages.map_noise import MapNoise, step_of
from cmm_align.stages.repeatability import repeatability_psd_mm4
from cmm_align.surfaces.protocol import Array, Bounds
from cmm_align.units import UM_PER_MM

MIN_IMPROVEMENT: Final = 0.2
"""Another pass is worth it if the RMS falls by at least this share, and surely."""

PV_SCATTER: Final = 0.729 / 3.735
"""Relative standard deviation of the range of 20 normal numbers (d3 / d2 of control charts, ASTM MNL 7A): a
part of twelve correlation lengths across holds about so many places that err independently."""

_TAILS: Final = (0.025, 0.975)
_COVERAGE: Final = 1.96


def pass_prediction(
    points: Places,
    grid: tuple[Array, Array, Array],
    noise: MapNoise,
    band: CorrectionBand,
    transfer: ProcessTransfer,
    config: CompensateConfig,
    bounds: Bounds,
) -> tuple[PassPrediction, Statistics]:
    """Return what to expect of single points after the pass, with 95 % intervals, and their statistics.

    Parameters
    ----------
    points : Places
    grid : x_mm, y_mm, correction_mm
        Of shapes (nx,), (ny,), (ny, nx), mm; complete.
    noise : MapNoise
    band : CorrectionBand
    transfer : ProcessTransfer
    config : CompensateConfig
        Repeatability and its length.
    bounds : Bounds
        Of the part.
    """
    x_mm, y_mm, correction = grid
    told = interpolated(x_mm, y_mm, _cut(correction, x_mm, y_mm, transfer), points.x_mm, points.y_mm)
    left = points.deviation_mm + told
    unit = told / max(float(np.mean(transfer.share)), 1e-9)
    frequency, area = np.array(noise.psd.frequency_per_mm), np.array(noise.psd.area_per_mm2)
    answer = transfer.at(frequency) * np.array(band.gain)  # cG
    power = repeatability_psd_mm4(config, bounds, noise.psd)
    floor = float(np.nan_to_num(noise.psd.noise_floor_mm4))
    chased = 2.0 * float(answer @ (power * area + floor * area))
    left2, unit2 = float(np.mean(left**2)), float(np.mean(unit**2))
    mean = left2 + chased + transfer.u**2 * unit2

    both = (1.0 + answer**2) * power
    rest = (1.0 - answer) ** 2 * np.array(noise.psd.psd_mm4)
    scatter2, n = float(np.nan_to_num(noise.scatter_mm)) ** 2, len(left)
    variance = (
        2.0 * float(area @ both**2) / noise.area_mm2
        + 4.0 * float(area @ (rest * both)) / noise.area_mm2
        + (2.0 * scatter2**2 + 4.0 * scatter2 * mean) / n
        + (2.0 * float(np.mean(left * unit)) * transfer.u) ** 2
        + 2.0 * (transfer.u**2 * unit2) ** 2
    )
    low, high = _interval(mean, variance)
    statistics = deviation_statistics(left, points.x_mm, points.y_mm)
    rms = mean**0.5
    pv = statistics.pv_mm * rms / max(left2**0.5, 1e-300)
    spread = float(np.hypot(0.5 * variance**0.5 / max(mean, 1e-300), PV_SCATTER))
    prediction = PassPrediction(
        rms_mm=rms,
        rms_low_mm=low,
        rms_high_mm=high,
        pv_mm=pv,
        pv_low_mm=pv * float(np.exp(-_COVERAGE * spread)),
        pv_high_mm=pv * float(np.exp(_COVERAGE * spread)),
        correctable_rms_mm=float(np.mean(told**2)) ** 0.5,
        left_rms_mm=left2**0.5,
        noise_mm=scatter2**0.5,
        repeatability_mm=config.repeatability_um / UM_PER_MM,
        transfer=transfer,
    )
    return prediction, replace(statistics, pv_mm=pv, rms_mm=rms)


def worth(before: Statistics, prediction: PassPrediction) -> tuple[bool, str]:
    """Return whether the next pass pays, and the sentence that says so with its numbers.

    It pays if the upper end of the 95 % interval is below what is measured now, and the fall is more than
    `MIN_IMPROVEMENT`.
    """
    p = prediction
    now, then = before.rms_mm * UM_PER_MM, p.rms_mm * UM_PER_MM
    half = 0.5 * (p.rms_high_mm - p.rms_low_mm) * UM_PER_MM
    numbers = (
        f"RMS {now:.2f} -> {then:.2f} +- {half:.2f} um, PV {before.pv_mm * UM_PER_MM:.1f} -> "
        f"{p.pv_mm * UM_PER_MM:.1f} um"
    )
    if p.rms_high_mm < before.rms_mm and then < (1.0 - MIN_IMPROVEMENT) * now:
        return True, f"{numbers}: worth it"
    parts = (
        f"of the RMS {p.correctable_rms_mm * UM_PER_MM:.2f} um can be corrected; the process scatters by "
        f"{p.repeatability_mm * UM_PER_MM:.2g} um and single points by {p.noise_mm * UM_PER_MM:.2g} um"
    )
    return False, f"{numbers}: not worth it, {parts}"


def _cut(correction: Array, x_mm: Array, y_mm: Array, transfer: ProcessTransfer) -> Array:
    """Return what the process makes of a correction."""
    if not transfer.wavelength_mm:
        return transfer.share[0] * correction
    steps = step_of(x_mm), step_of(y_mm)
    return gain_filtered(correction, steps, transfer.at, 2.0 * transfer.wavelength_mm[-1])


def _interval(mean: float, variance: float) -> tuple[float, float]:
    """Return the root of the 95 % interval of a gamma distribution."""
    from scipy.special import gammaincinv

    if not (variance > 0.0 and mean > 0.0):
        return mean**0.5, mean**0.5
    shape = mean**2 / variance
    low, high = (float(gammaincinv(shape, tail)) * variance / mean for tail in _TAILS)
    return low**0.5, high**0.5
