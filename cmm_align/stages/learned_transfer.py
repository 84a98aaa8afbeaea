"""The transfer of a process, learned from the passes of a ledger, and the gain that makes use of it.

The transfers c_i of a band with their uncertainties u_i are combined over passes and parts with the weights
``1 / (u_i^2 + tau^2)``. tau is the scatter between them that the u_i do not explain,

    t^2 = (Q - (k - 1)) / (sum w - sum w^2 / sum w),   Q = sum w (c_i - mean)^2,   w = 1 / u_i^2.

No process answers the same to each part, and a few passes cannot show it (t^2 comes out as 0 half of the
time): ``tau^2 = (n_0 tau_0^2 + (k - 1) t^2) / (n_0 + k - 1)`` starts from a scatter tau_0 that counts as
much as n_0 passes. For the next part

    u^2 = 1 / sum 1 / (u_i^2 + tau^2) + tau^2 nu / (nu - 2),   nu = n_0 + k - 1,

the factor being the variance of a t distribution with the freedom nu that tau has.

A gain g leaves ``1 - g c`` of a wave; its mean square over what c may be is least for
``g = c / (c^2 + u^2)``, a little less than 1/c. It also keeps ``g (c + 2 u)`` within the largest gain of a
process that does what it is told, so that the loop stays inside its limits if c is larger than thought.

Source: R. DerSimonian, N. Laird, "Meta-analysis in clinical trials", Controlled Clinical Trials 7, 1986, doi
10.1016/0197-2456(86)90046-2, equations 7 and 8.
"""

from __future__ import annotations

from dataclasses import replace
from math import isfinite, sqrt
from typing import Final

import numpy as np

from cmm_align.model import LearnedBand, LearnedTransfer, Ledger, ProcessTransfer, WaveBand
from cmm_align.surfaces.protocol import Array

USUAL_SCATTER: Final = 0.05
"""tau_0: standard deviation of the transfer between parts, before any is seen."""
USUAL_WEIGHT: Final = 4.0
"""n_0: passes that have to be seen to outweigh it."""
TELLS: Final = 0.5
"""A single pass with a larger uncertainty tells nothing."""
KNOWN: Final = 0.25
"""A band is known where its uncertainty is below this, and below half of the transfer."""
LEAST_TRANSFER: Final = 0.2
"""A process that does less than this of what it is told is not steered by a larger gain."""
LARGEST_STEP: Final = 1.2
"""Most of gain times transfer, twice the uncertainty added."""


def learned_transfer(ledger: Ledger) -> LearnedTransfer | None:
    """Return what the passes of a ledger tell of the transfer; None if they do not know any band.

    Parameters
    ----------
    ledger : Ledger

    Returns
    -------
    LearnedTransfer or None
        One entry a band. Shorter waves than the known ones take the transfer of their neighbour with twice
        its uncertainty, longer ones a transfer of 1.
    """
    found = [_combined(ledger, k) for k in range(len(ledger.bands))]
    if all(one is None for one in found):
        return None
    bands: list[LearnedBand] = []
    known: LearnedBand | None = None
    for band, one in zip(ledger.bands, found, strict=True):
        if one is not None:
            known = one
            bands.append(one)
        elif known is None:
            bands.append(LearnedBand(band, 1.0, KNOWN, 0.0, 0, 0))
        else:
            bands.append(replace(known, band=band, u=2.0 * known.u, n_passes=0, n_parts=0))
    power = _usual_power(ledger)
    u2 = np.array([band.u for band in bands]) ** 2
    return LearnedTransfer(tuple(bands), float(np.sqrt(np.average(u2, weights=power))))


def process_of(learned: LearnedTransfer) -> ProcessTransfer:
    """Return a learned transfer as a curve over the wavelength."""
    ascending = sorted(learned.bands, key=lambda one: one.band.short_mm)
    return ProcessTransfer(
        tuple(middle_mm(one.band) for one in ascending),
        tuple(one.transfer for one in ascending),
        learned.u,
        known=True,
    )


def middle_mm(band: WaveBand) -> float:
    """Return the wavelength that stands for a band, mm: its middle, or twice its border if it has no end."""
    return sqrt(band.short_mm * band.long_mm) if isfinite(band.long_mm) else 2.0 * band.short_mm


def gain_of(one: LearnedBand) -> float:
    """Return what a wanted share of a wave is multiplied by, so that the part gets it."""
    c, u = one.transfer, one.u
    return min(c / (c * c + u * u), LARGEST_STEP / (c + 2.0 * u))


def gains_at(learned: LearnedTransfer, frequency_per_mm: Array) -> Array:
    """Return the same at frequencies, shape (n,), 1/mm, above 0: linear in the logarithm between bands."""
    ascending = sorted(learned.bands, key=lambda one: one.band.short_mm)
    places = np.log([middle_mm(one.band) for one in ascending])
    result: Array = np.interp(-np.log(frequency_per_mm), places, [gain_of(one) for one in ascending])
    return result


def stepped_gain(
    learned: LearnedTransfer, gain: float, low_pass_mm: float, longest_mm: float
) -> tuple[Array, Array]:
    """Return the regressions whose sum has, in each band, the gain that gives the part what is wanted.

    With the gain g_0 from the low-pass L_0 to the border L_1, g_1 from there to L_2 and so on,

        g_0 (F_0 - F_1) + g_1 (F_1 - F_2) + ... + g_m F_m = g_0 F_0 + sum (g_k - g_k-1) F_k.

    Parameters
    ----------
    learned : LearnedTransfer
    gain : float
        Share of the deviation to take off.
    low_pass_mm, longest_mm : float
        Shortest wave to correct, and the longest cutoff that the map carries.

    Returns
    -------
    cutoffs_mm, shares : ndarray, shape (k,)
    """
    ascending = sorted(learned.bands, key=lambda one: one.band.short_mm)
    within = [one for one in ascending if one.band.long_mm > low_pass_mm] or ascending[-1:]
    cutoffs, gains = [low_pass_mm], [gain * gain_of(within[0])]
    for one in within[1:]:
        if one.band.short_mm < longest_mm:
            cutoffs.append(one.band.short_mm)
            gains.append(gain * gain_of(one))
    return np.array(cutoffs), np.diff(np.array(gains), prepend=0.0)


def _combined(ledger: Ledger, k: int) -> LearnedBand | None:
    """Return the transfer of a band over all passes and parts, if it is known."""
    seen = [
        (one.transfer, one.u_transfer, p.part)
        for p in ledger.passes
        if p.came is not None and (one := p.came.bands[k]) is not None and 0.0 < one.u_transfer <= TELLS
    ]
    if not seen:
        return None
    c, u = (np.array([entry[column] for entry in seen], dtype=np.float64) for column in (0, 1))
    weight = 1.0 / u**2
    mean = float(np.average(c, weights=weight))
    spare = float(weight.sum() - (weight**2).sum() / weight.sum())
    more = float(weight @ (c - mean) ** 2) - (len(c) - 1)
    seen2 = max(more / spare, 0.0) if len(c) > 1 else 0.0
    freedom = USUAL_WEIGHT + len(c) - 1
    tau2 = (USUAL_WEIGHT * USUAL_SCATTER**2 + (len(c) - 1) * seen2) / freedom
    weight = 1.0 / (u**2 + tau2)
    mean = float(np.average(c, weights=weight))
    u_next = sqrt(1.0 / float(weight.sum()) + tau2 * freedom / (freedom - 2.0))
    if not (mean >= LEAST_TRANSFER and u_next <= min(KNOWN, 0.5 * mean)):
        return None
    return LearnedBand(ledger.bands[k], mean, u_next, sqrt(tau2), len(c), len({entry[2] for entry in seen}))


def _usual_power(ledger: Ledger) -> Array:
    """Return the mean square of all corrections in each band, shape (bands,), never all zero."""
    power = np.array([[b.correction_rms_um**2 for b in p.bands] for p in ledger.passes]).mean(axis=0)
    return np.asarray(power if power.any() else np.ones_like(power), dtype=np.float64)
