"""What came of a pass in each spatial band: the transfer of the process, with its standard uncertainty.

Over the nodes that both measurements know, with the motions of the part taken out of both fields (how it
sat on the table is no answer to a correction), and in band b

    c = <D_b, q_b> / <q_b, q_b> - beta,   D = e_k - e_k+1,   q = -correction_k = G F e_k.

The map e_k holds noise n_k and what was chance in its pass, v_k. Both are in D and in q, so the quotient
alone is too large, and near the floor far too large: ``<v + n, G F (v + n)>`` is expected in the numerator
whatever the process does. With the spectrum S = C + S_rep of noise and chance, the transmission H_b of the
band and the gain G of the pass (low-pass included)

    beta = integral G H_b^2 S df / mean(q_b^2),

in the longest band less what was taken out with the motions, G times the sum of ``<m, S m> / n`` over an
orthonormal basis m of them.

The uncertainty is the larger of what noise and chance of both measurements hand it and of what is seen,

    u^2 = 2 S_b / (dA <q_b, q_b>)   or   mean(r_b^2) / (nu mean(q_b^2)),

r what is left of D_b by the straight line, nu the independent values of the band,
``A (integral H^2)^2 / integral H^4``; half of beta is added for what is not known of S. The second holds what
differs from place to place too.

Source: learned transfer as in iterative learning control, D. A. Bristow, M. Tharayil, A. G. Alleyne, IEEE
Control Systems 26, 2006, doi 10.1109/MCS.2006.1636313; the bias is that of errors in the variables, W. A.
Fuller, "Measurement error models", 1987, with common errors in both sides.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from cmm_align.config import CompensateConfig
from cmm_align.model import BandResponse, Correction, DeviationMap, WaveBand
from cmm_align.numerics.areal_filter import cutoff_limits_mm
from cmm_align.stages.correction_grid import on_grid
from cmm_align.stages.map_nodes import pose_rows
from cmm_align.stages.map_noise import MapNoise, step_of
from cmm_align.stages.repeatability import repeatability_length_mm
from cmm_align.stages.spatial_bands import band_transmissions, banded, thinned, thinning
from cmm_align.surfaces.protocol import Array, Mask
from cmm_align.units import UM_PER_MM

MIN_NODES: Final = 64
"""Fewer common nodes tell nothing of bands."""
BETA_KNOWN_TO: Final = 0.5
"""Share of the bias that is not known, as noise and repeatability are known roughly."""
LEAST_SHARE: Final = 1e-3
"""A band with less than this share of the RMS of the correction was not corrected."""

_FREQUENCIES: Final = 400


def band_response(
    previous: Correction,
    deviation_map: DeviationMap,
    noise: MapNoise,
    bands: tuple[WaveBand, ...],
    config: CompensateConfig,
) -> tuple[BandResponse | None, ...]:
    """Return what came of the pass before in each band; None where nothing was corrected.

    Parameters
    ----------
    previous : Correction
        What the part was ground with.
    deviation_map : DeviationMap
        Measured afterwards.
    noise : MapNoise
        Of that measurement; the one before is taken to be as noisy.
    bands : tuple of WaveBand
        From long to short waves.
    config : CompensateConfig
        Repeatability and its length.

    Notes
    -----
    Recovers the transfer of each band of a process that is known within 2 u in 95 % of passes (tested).
    """
    nothing: tuple[BandResponse | None, ...] = (None,) * len(bands)
    if previous.deviation_mm is None:
        return nothing
    m = deviation_map
    before = on_grid(previous, previous.deviation_mm, m.x_mm, m.y_mm)
    told = -on_grid(previous, previous.correction_mm, m.x_mm, m.y_mm)
    block = thinning(bands, max(step_of(m.x_mm), step_of(m.y_mm)))
    x, y = (thinned(axis[None], 1, block)[0] for axis in (m.x_mm, m.y_mm))
    change, q = (thinned(field, block, block) for field in (before - m.deviation_mm, told))
    known = np.isfinite(change) & np.isfinite(q)
    if known.sum() < MIN_NODES:
        return nothing
    steps = step_of(x), step_of(y)
    rows = _motions(m, x, y, known)
    change, q = (_without(field, known, rows) for field in (change, q))
    area = float(known.sum()) * steps[0] * steps[1]
    weights = _BandIntegrals(previous, noise, bands, config, cutoff_limits_mm(q, steps))
    weights.leave_out(_power_in_motions(steps, known, rows, weights), rows.shape[1] / area)
    least = LEAST_SHARE * float(np.sqrt(np.mean(q[known] ** 2)))
    return tuple(
        _response(d[known], t[known], area, weights, k, least)
        for k, (d, t) in enumerate(zip(banded(change, steps, bands), banded(q, steps, bands), strict=True))
    )


def _response(
    change: Array, told: Array, area: float, weights: _BandIntegrals, k: int, least: float
) -> BandResponse | None:
    """Return what came of one band; change and told of shape (n,), mm."""
    seen = np.isfinite(change) & np.isfinite(told)
    change, told = change[seen], told[seen]
    power = float(np.mean(told**2)) if len(told) else 0.0
    if power <= least**2 or weights.freedom[k] <= 0.0:
        return None
    quotient = float(np.mean(change * told)) / power
    beta = float(weights.chased_mm2[k]) / power
    rest = float(np.mean((change - quotient * told) ** 2))
    values = max(area * float(weights.freedom[k]), 1.0)
    expected = 2.0 * float(weights.noise_mm4[k]) / (area * power)
    u = np.sqrt(max(expected, rest / (values * power)) + (BETA_KNOWN_TO * beta) ** 2)
    rms_um = float(np.sqrt(np.mean(change**2))) * UM_PER_MM
    return BandResponse(response_rms_um=rms_um, transfer=quotient - beta, u_transfer=float(u))


class _BandIntegrals:
    """Integrals over the frequency plane, one entry a band.

    `chased_mm2` is that of G H^2 S, `noise_mm4` the mean of S in the band, `freedom` the number of
    independent values to a unit of area, 1/mm^2.
    """

    def __init__(
        self,
        previous: Correction,
        noise: MapNoise,
        bands: tuple[WaveBand, ...],
        config: CompensateConfig,
        limits_mm: tuple[float, float],
    ) -> None:
        bounds = previous.nominal.surface.bounds
        floor = float(np.nan_to_num(noise.psd.noise_floor_mm4))
        length, scatter = repeatability_length_mm(config, bounds), config.repeatability_um / UM_PER_MM

        def spectrum(f: Array) -> Array:
            """Return S at frequencies, mm^4."""
            return floor + 2.0 * np.pi * (length * scatter) ** 2 * np.exp(-2.0 * (np.pi * length * f) ** 2)

        def gain(f: Array) -> Array:
            """Return G at frequencies."""
            band = previous.band
            if band is None:
                return np.full(f.shape, previous.gain)
            return np.asarray(np.interp(f, band.frequency_per_mm, band.gain))

        highest = 2.0 / max(bands[-1].short_mm, limits_mm[0])
        f = highest * (np.arange(_FREQUENCIES) + 0.5) / _FREQUENCIES
        plane = 2.0 * np.pi * f * highest / _FREQUENCIES
        passed = band_transmissions(f, bands, limits_mm) ** 2
        total = passed @ plane
        self.chased_mm2 = passed @ (plane * spectrum(f) * gain(f))
        self.noise_mm4 = (passed @ (plane * spectrum(f))) / np.maximum(total, 1e-300)
        self.freedom = np.where(total > 0.0, total**2 / np.maximum(passed**2 @ plane, 1e-300), 0.0)
        longest = np.array([1.0 / bounds.diagonal_mm])
        self.floor_mm4, self.chance_mm2, self.length_mm = floor, scatter**2, length
        self.longest_gain = float(gain(longest)[0])

    def leave_out(self, power_mm2: float, per_area: float) -> None:
        """Take the power of noise and chance in the motions, and their number, out of the longest band."""
        self.chased_mm2[0] = max(self.chased_mm2[0] - self.longest_gain * power_mm2, 0.0)
        self.freedom[0] = max(self.freedom[0] - per_area, per_area / 6.0)


def _motions(deviation_map: DeviationMap, x_mm: Array, y_mm: Array, known: Mask) -> Array:
    """Return an orthonormal basis of the motions of the part at the known nodes, shape (n, up to 6)."""
    x, y = (a[known] for a in np.meshgrid(x_mm, y_mm))
    alignment = deviation_map.alignment
    rows = pose_rows(alignment.nominal, alignment.centroid_mm, x, y)
    basis, strengths, _ = np.linalg.svd(rows / np.linalg.norm(rows, axis=0).clip(1e-300), full_matrices=False)
    return np.asarray(basis[:, strengths > 1e-6 * strengths[0]], dtype=np.float64)


def _power_in_motions(
    steps: tuple[float, float], known: Mask, basis: Array, weights: _BandIntegrals
) -> float:
    """Return the mean square of noise and chance that looks like motions of the part, mm^2."""
    from scipy.ndimage import gaussian_filter

    cell = steps[0] * steps[1]
    widths = [weights.length_mm / step for step in reversed(steps)]
    scale = 2.0 * np.pi * weights.length_mm**2 * weights.chance_mm2 / cell
    power = weights.floor_mm4 / cell * basis.shape[1]
    for column in basis.T:
        field = np.zeros(known.shape)
        field[known] = column
        power += scale * float(column @ gaussian_filter(field, widths, mode="constant")[known])
    return float(power) / len(basis)


def _without(field: Array, known: Mask, basis: Array) -> Array:
    """Return a field, shape (ny, nx), without its part in a basis, NaN where not known."""
    values = field[known]
    result = np.full(field.shape, np.nan)
    result[known] = values - basis @ (basis.T @ values)
    return result
