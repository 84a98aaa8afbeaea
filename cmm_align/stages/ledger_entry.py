"""What a pass leaves in a ledger: numbers of the map, of its correction, and what came of the pass before."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from math import hypot

import numpy as np

from cmm_align.config import CompensateConfig
from cmm_align.errors import InputError
from cmm_align.model import (
    BandRecord,
    Correction,
    DeviationMap,
    Ledger,
    LedgerPass,
    PassOutcome,
    WaveBand,
)
from cmm_align.stages.band_response import band_response
from cmm_align.stages.compensate import map_digest
from cmm_align.stages.deviation_statistics import deviation_statistics
from cmm_align.stages.map_grid import places_of
from cmm_align.stages.map_noise import map_noise, step_of
from cmm_align.stages.spatial_bands import banded, thinned, thinning
from cmm_align.stages.wheel_wear import constant_part
from cmm_align.surfaces.protocol import Array
from cmm_align.units import UM_PER_MM


def ledger_entry(
    part: str,
    deviation_map: DeviationMap,
    correction: Correction,
    previous: Correction | None,
    bands: tuple[WaveBand, ...],
    config: CompensateConfig,
    time_utc: str,
) -> LedgerPass:
    """Return the row of a pass.

    Parameters
    ----------
    part : str
        Which part of the family.
    deviation_map : DeviationMap
    correction : Correction
        Made from the map.
    previous : Correction or None
        What the part was ground with.
    bands : tuple of WaveBand
        Of the ledger.
    config : CompensateConfig
    time_utc : str

    Raises
    ------
    InputError
        If the correction does not tell what it predicts.
    """
    m, p = deviation_map, correction.prediction
    if p is None:
        raise InputError("a correction without a prediction has no place in a ledger")
    noise = map_noise(m, places_of(m.alignment))
    constant = constant_part(m, noise, previous, config)
    before = correction.before
    return LedgerPass(
        part=part,
        pass_number=correction.pass_number,
        time_utc=time_utc,
        map_digest=correction.map_digest,
        nominal_digest=correction.nominal.digest,
        correction_digest=correction_digest(correction),
        previous_map_digest="" if previous is None else previous.map_digest,
        n=before.n,
        pv_um=before.pv_mm * UM_PER_MM,
        rms_um=before.rms_mm * UM_PER_MM,
        map_pv_um=m.statistics.pv_mm * UM_PER_MM,
        map_rms_um=m.statistics.rms_mm * UM_PER_MM,
        u_rms_um=m.u_rms_mm * UM_PER_MM,
        pvr_um=m.pvr_mm * UM_PER_MM,
        constant_um=constant.um,
        u_constant_um=constant.u_um,
        told_constant_um=constant.told_um,
        gain_rule=correction.gain_rule,
        gain=correction.gain,
        predicted_rms_um=p.rms_mm * UM_PER_MM,
        predicted_rms_low_um=p.rms_low_mm * UM_PER_MM,
        predicted_rms_high_um=p.rms_high_mm * UM_PER_MM,
        predicted_pv_um=p.pv_mm * UM_PER_MM,
        predicted_pv_low_um=p.pv_low_mm * UM_PER_MM,
        predicted_pv_high_um=p.pv_high_mm * UM_PER_MM,
        floor_um=hypot(p.noise_mm, p.repeatability_mm) * UM_PER_MM,
        bands=_records(correction, bands),
    )


def pass_outcome(
    deviation_map: DeviationMap,
    previous: Correction,
    bands: tuple[WaveBand, ...],
    config: CompensateConfig,
    time_utc: str,
) -> PassOutcome:
    """Return what came of a pass.

    Parameters
    ----------
    deviation_map : DeviationMap
        Measured after it.
    previous : Correction
        What the part was ground with.
    bands : tuple of WaveBand
        Of the ledger.
    config : CompensateConfig
    time_utc : str
    """
    m = deviation_map
    points = places_of(m.alignment)
    noise = map_noise(m, points)
    now = deviation_statistics(points.deviation_mm, points.x_mm, points.y_mm)
    return PassOutcome(
        map_digest=map_digest(m),
        time_utc=time_utc,
        rms_um=now.rms_mm * UM_PER_MM,
        pv_um=now.pv_mm * UM_PER_MM,
        bands=band_response(previous, m, noise, bands, config),
    )


def with_outcome(ledger: Ledger, digest: str, came: PassOutcome) -> Ledger:
    """Return a ledger in which it is known what came of the pass that was made from a map.

    Parameters
    ----------
    ledger : Ledger
    digest : str
        Of the map of that pass; a ledger that does not know it stays as it is.
    came : PassOutcome
    """
    passes = (replace(one, came=came) if one.map_digest == digest else one for one in ledger.passes)
    return replace(ledger, passes=tuple(passes))


def correction_digest(correction: Correction) -> str:
    """Return the SHA-256 (hex) of what is commanded: the grid and the total correction on it."""
    digest = hashlib.sha256()
    for array in (correction.x_mm, correction.y_mm, correction.total_correction_mm):
        digest.update(np.ascontiguousarray(array, dtype="<f8").tobytes())
    return digest.hexdigest()


def _records(correction: Correction, bands: tuple[WaveBand, ...]) -> tuple[BandRecord, ...]:
    """Return the RMS of map and correction in each band, over the nodes of the map."""
    deviation = correction.deviation_mm
    if deviation is None:
        return ()
    known = np.isfinite(deviation)
    told = np.where(known, correction.correction_mm, np.nan)
    step_x, step_y = step_of(correction.x_mm), step_of(correction.y_mm)
    block = thinning(bands, max(step_x, step_y))
    steps = step_x * block, step_y * block
    fields = (banded(thinned(field, block, block), steps, bands) for field in (deviation, told))
    return tuple(BandRecord(_rms_um(e), _rms_um(q)) for e, q in zip(*fields, strict=True))


def _rms_um(field: Array) -> float:
    """Return the RMS of what is known of a field in mm, um."""
    known = field[np.isfinite(field)]
    return float(np.sqrt(np.mean(known**2))) * UM_PER_MM if len(known) else 0.0
