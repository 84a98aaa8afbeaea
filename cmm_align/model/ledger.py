"""The ledger of a part family, a machine and a wheel: what each pass was told, and what came of it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class WaveBand:
    """Wavelengths from `short_mm` to `long_mm` (infinity for all longer ones)."""

    short_mm: float
    long_mm: float


@dataclass(frozen=True, slots=True)
class BandResponse:
    """What came of a correction in a band.

    Attributes
    ----------
    response_rms_um : float
        RMS of the change of the part, ``e_k - e_k+1``.
    transfer : float
        Share of the correction that reached the part.
    u_transfer : float
        Its standard uncertainty.
    """

    response_rms_um: float
    transfer: float
    u_transfer: float


@dataclass(frozen=True, slots=True)
class BandRecord:
    """RMS of the deviations and of the correction of a pass in a band."""

    deviation_rms_um: float
    correction_rms_um: float


@dataclass(frozen=True, slots=True)
class PassOutcome:
    """What the measurement after a pass found: of single points; `map_digest` tells which measurement."""

    map_digest: str
    time_utc: str
    rms_um: float
    pv_um: float
    bands: tuple[BandResponse | None, ...]


@dataclass(frozen=True, slots=True)
class LedgerPass:
    """A measured part and the correction that was made from it.

    Attributes
    ----------
    part : str
        Which part of the family.
    pass_number : int
        1 for the first compensation.
    time_utc : str
        ISO 8601, when the correction was made.
    map_digest, nominal_digest, correction_digest : str
        SHA-256 of the measured points, of the nominal, and of the correction.
    previous_map_digest : str
        Of the pass before; empty for the first.
    n, pv_um, rms_um
        Of the single points.
    map_pv_um, map_rms_um, u_rms_um, pvr_um : float
        Of the map.
    constant_um, u_constant_um : float or None
        What there is too much of everywhere along the normal, motions of the part taken out; None where
        the two cannot be told apart.
    told_constant_um : float or None
        The same of the total correction that the part was ground with.
    gain_rule, gain
        As in `Correction`.
    predicted_rms_um, predicted_rms_low_um, predicted_rms_high_um : float
        Of single points after the pass, with the 95 % interval.
    predicted_pv_um, predicted_pv_low_um, predicted_pv_high_um : float
    floor_um : float
        What noise and repeatability leave of any pass.
    bands : tuple of BandRecord
    came : PassOutcome or None
        None until the next map of the part is added.
    """

    part: str
    pass_number: int
    time_utc: str
    map_digest: str
    nominal_digest: str
    correction_digest: str
    previous_map_digest: str
    n: int
    pv_um: float
    rms_um: float
    map_pv_um: float
    map_rms_um: float
    u_rms_um: float
    pvr_um: float
    constant_um: float | None
    u_constant_um: float | None
    told_constant_um: float | None
    gain_rule: str
    gain: float
    predicted_rms_um: float
    predicted_rms_low_um: float
    predicted_rms_high_um: float
    predicted_pv_um: float
    predicted_pv_low_um: float
    predicted_pv_high_um: float
    floor_um: float
    bands: tuple[BandRecord, ...]
    came: PassOutcome | None = None

    @property
    def interval_held(self) -> bool | None:
        """Whether the 95 % interval of the RMS held what came; None if that is not known."""
        if self.came is None:
            return None
        return self.predicted_rms_low_um <= self.came.rms_um <= self.predicted_rms_high_um


@dataclass(frozen=True, slots=True)
class Dressing:
    """The wheel was dressed, or a new one mounted, after so many passes of the ledger."""

    time_utc: str
    wheel: str
    after_passes: int


@dataclass(frozen=True, slots=True)
class Ledger:
    """All passes of a part family on one machine, in the order in which they were added.

    Attributes
    ----------
    nominal_digest : str
        Of the part family.
    machine, wheel : str
        Names; empty if they were not given. `wheel` is the one the ledger began with.
    created_utc : str
    bands : tuple of WaveBand
        Spatial bands, from long to short waves, the same for all passes.
    passes : tuple of LedgerPass
    dressings : tuple of Dressing
    """

    nominal_digest: str
    machine: str
    wheel: str
    created_utc: str
    bands: tuple[WaveBand, ...]
    passes: tuple[LedgerPass, ...] = ()
    dressings: tuple[Dressing, ...] = ()


@dataclass(frozen=True, slots=True)
class LearnedBand:
    """Transfer of a band, combined over passes and parts.

    Attributes
    ----------
    band : WaveBand
    transfer : float
    u : float
        Standard uncertainty for the next part: of the mean, and of the scatter between parts.
    scatter : float
        The latter alone.
    n_passes, n_parts : int
        That it was learned from; 0 where nothing is known and a neighbour stands in.
    """

    band: WaveBand
    transfer: float
    u: float
    scatter: float
    n_passes: int
    n_parts: int


@dataclass(frozen=True, slots=True)
class LearnedTransfer:
    """What a ledger knows of the transfer, from long to short waves.

    `u` is that of a correction with the usual share of its power in each band.
    """

    bands: tuple[LearnedBand, ...]
    u: float


@dataclass(frozen=True, slots=True)
class WheelWear:
    """Growth of the constant part of the deviation while the wheel wears.

    Attributes
    ----------
    um_per_pass, u_um_per_pass : float
        With its standard uncertainty; positive = material stays on as the wheel gets smaller.
    n_passes : int
        That the slope was fitted to.
    n_dressings : int
        Times that the wheel was dressed between them: each starts with a constant of its own.
    """

    um_per_pass: float
    u_um_per_pass: float
    n_passes: int
    n_dressings: int
