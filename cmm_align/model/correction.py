"""The correction of a pass: what to command, which waves it holds, what was left out, what to expect."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from cmm_align.model.gate import GateReport
from cmm_align.model.nominal import Nominal
from cmm_align.model.seat import Seat
from cmm_align.model.statistics import Statistics
from cmm_align.surfaces.protocol import Array, Mask


class CorrectionStatus(IntEnum):
    """Where the correction of a node comes from."""

    MEASURED = 0
    """From the map."""
    BEYOND = 1
    """Beyond what was measured: continued smoothly, and faded out."""
    BRIDGED = 2
    """In a hole of the map: bridged smoothly."""
    FEW_POINTS = 3
    """Too few points to a cell: not used, bridged."""
    OUTSIDE_REGION = 4
    """Outside the region to correct: faded out."""
    CLIPPED = 5
    """Continued past the largest or smallest correction with data: held there."""


@dataclass(frozen=True, slots=True)
class ProcessTransfer:
    """Share of a commanded change that reaches the part, by wavelength.

    Attributes
    ----------
    wavelength_mm : tuple of float
        Ascending; empty if the share is the same for all waves.
    share : tuple of float
        One for each wavelength; between them it is linear in the logarithm of the wavelength, past them it is
        held. A single one if it is the same for all.
    u : float
        Standard uncertainty of the shares.
    known : bool
        Whether it was given or learned; if not it is taken as 1.
    """

    wavelength_mm: tuple[float, ...] = ()
    share: tuple[float, ...] = (1.0,)
    u: float = 0.1
    known: bool = False

    def at(self, frequency_per_mm: Array) -> Array:
        """Return the share at frequencies, any shape, 1/mm; 0 is a constant."""
        if not self.wavelength_mm:
            return np.full(np.shape(frequency_per_mm), self.share[0])
        longest = 1e3 * self.wavelength_mm[-1]
        wavelength = 1.0 / np.maximum(frequency_per_mm, 1.0 / longest)
        result: Array = np.interp(np.log(wavelength), np.log(self.wavelength_mm), self.share)
        return result


@dataclass(frozen=True, slots=True)
class CorrectionBand:
    """Which waves a correction holds, and why no shorter ones.

    Attributes
    ----------
    low_pass_mm : float
        Waves of this length are corrected by half (before the gain), longer ones more.
    bound : str
        What set it: sampling, noise, wheel, map (its own filter) or asked (by the user).
    sampling_mm : float
        Shortest wave that the spacing of the map carries.
    noise_mm : float
        Shortest wave whose power is above that of the noise.
    wheel_mm : float
        Shortest wave that the wheel can cut into the surface; 0 if its radius is not known.
    frequency_per_mm, gain : tuple of float
        Gain by frequency, low-pass included.
    cutoff_mm, share : tuple of float
        Of the Gaussian regressions whose sum is the filter, gain included; a single one for a fixed gain.
    words : str
        The same as a sentence.
    """

    low_pass_mm: float
    bound: str
    sampling_mm: float
    noise_mm: float
    wheel_mm: float
    frequency_per_mm: tuple[float, ...]
    gain: tuple[float, ...]
    cutoff_mm: tuple[float, ...]
    share: tuple[float, ...]
    words: str


@dataclass(frozen=True, slots=True)
class CorrectionLimits:
    """Sizes of a correction that have limits, and what was left out, in nodes inside the aperture.

    `removal_mm` is the depth from the highest to the lowest place of the correction: as nothing can be put
    on, the least that the pass takes off where it takes off most. `total_removal_mm` sums all passes.
    """

    max_correction_mm: float
    max_slope_rad: float
    max_slope_at_mm: tuple[float, float]
    removal_mm: float
    total_removal_mm: float
    taper_mm: float
    n_beyond: int
    n_bridged: int
    n_few_points: int
    n_outside_region: int
    n_clipped: int
    region: str = ""
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class PassPrediction:
    """What the next measurement will find, of single points, with 95 % intervals.

    `correctable_rms_mm` is the RMS of what the correction takes off if the process does what it is told, and
    `left_rms_mm` that of the rest; both hold the noise of the measurement. `noise_mm` is that of a single
    point, `repeatability_mm` what differs from pass to pass.
    """

    rms_mm: float
    rms_low_mm: float
    rms_high_mm: float
    pv_mm: float
    pv_low_mm: float
    pv_high_mm: float
    correctable_rms_mm: float
    left_rms_mm: float
    noise_mm: float
    repeatability_mm: float
    transfer: ProcessTransfer


@dataclass(frozen=True, slots=True)
class PassResponse:
    """What came of the pass before: over the nodes that both maps know.

    `transfer` is ``<e_k - e_k+1, q> / <q, q>`` with q what was to be taken off, and `u_transfer` its standard
    uncertainty by noise and repeatability.
    """

    transfer: float
    u_transfer: float
    rms_before_mm: float
    rms_mm: float
    n: int
    words: str


@dataclass(frozen=True, slots=True)
class Correction:
    """The surface to command next, on a grid in frame `surface`.

    Attributes
    ----------
    nominal : Nominal
    x_mm, y_mm : ndarray, shape (nx,), (ny,), mm, frame `surface`
    correction_mm : ndarray, shape (ny, nx), mm
        Along the normal, ``-gain * filtered deviation``: negative removes material.
    total_correction_mm : ndarray, shape (ny, nx), mm
        Sum over all passes, relative to the nominal, along the normal.
    commanded_z_mm : ndarray, shape (ny, nx), mm
        Height to command in frame `surface`.
    commanded_normal : ndarray, shape (ny, nx, 3), frame `surface`
        Unit normals of the commanded surface.
    extended : ndarray of bool, shape (ny, nx)
        Nodes without data of their own, continued from their neighbours.
    gain : float
        As asked for; of a Wiener gain the mean over the power of the map.
    pass_number : int
        1 for the first compensation.
    predicted : Statistics
        Deviations of the points after the next pass, if the machine does as is known of it.
    before : Statistics
        Deviations of the points now.
    worth_another_pass : bool
    reason : str
    map_digest : str
        SHA-256 of the measured points behind the map; a map is never applied twice.
    applied_maps : tuple of str
        Digests of the maps of all earlier passes, oldest first.
    gain_rule : str
        fixed or wiener.
    deviation_mm : ndarray, shape (ny, nx), mm, or None
        The map that the correction was made from, NaN where unknown; None, as all below, in older files.
    status : ndarray of uint8, shape (ny, nx), or None
        `CorrectionStatus` of each node.
    band : CorrectionBand or None
    limits : CorrectionLimits or None
    prediction : PassPrediction or None
    response : PassResponse or None
        What came of the pass before; None for the first.
    gate : GateReport or None
        What was found in the exported files; None where none was written.
    seat : Seat or None
        How the part sits on the grinder: the exports are then in the frame of the grinder.
    """

    nominal: Nominal
    x_mm: Array
    y_mm: Array
    correction_mm: Array
    total_correction_mm: Array
    commanded_z_mm: Array
    commanded_normal: Array
    extended: Mask
    gain: float
    pass_number: int
    predicted: Statistics
    before: Statistics
    worth_another_pass: bool
    reason: str
    map_digest: str
    applied_maps: tuple[str, ...] = field(default=())
    gain_rule: str = "fixed"
    deviation_mm: Array | None = None
    status: NDArray[np.uint8] | None = None
    band: CorrectionBand | None = None
    limits: CorrectionLimits | None = None
    prediction: PassPrediction | None = None
    response: PassResponse | None = None
    gate: GateReport | None = None
    seat: Seat | None = None
