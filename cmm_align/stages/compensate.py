"""Stage 4: the surface to command next.

Method. The control law works on what was commanded, not on the nominal: with the deviation e of pass k
along the normal n, ``P[k+1] = P[k] - g F[e] n``. The gain g is what the user says, or one for each spatial
frequency (Wiener); the filter F keeps the waves that sampling, noise and wheel allow (`correction_filter`).
Where the map is unknown the correction is bridged or continued smoothly and fades out (`correction_reach`).
On a grid over the nominal's aperture the passes add up to a total correction along n relative to the
nominal, and the commanded height is ``z = s + total / n_z`` with the normals of that surface
(`correction_grid`). Limits are kept (`correction_limits`), the pass before is held against what came of it
(`previous_pass`), and what the next measurement will find is predicted (`pass_prediction`).

Sign: excess material is a positive deviation and a negative correction. For a probe on the +z side
the commanded surface then lies lower than the nominal, on the -z side higher: n_z carries the sign.
"""

from __future__ import annotations

import hashlib
from typing import Final

import numpy as np

from cmm_align.config import CompensateConfig
from cmm_align.errors import UsageError, WrongStageError
from cmm_align.model import Correction, CorrectionStatus, DeviationMap, LearnedTransfer, frozen_array
from cmm_align.stages.correction_filter import (
    MAX_GAIN,
    correction_band,
    filtered_deviation,
    mean_gain,
)
from cmm_align.stages.correction_grid import carried_on, commanded_surface, total_so_far
from cmm_align.stages.correction_limits import checked_limits
from cmm_align.stages.correction_reach import completed, region_mask, taper_width_mm, too_few_points
from cmm_align.stages.deviation_statistics import deviation_statistics
from cmm_align.stages.learned_transfer import process_of
from cmm_align.stages.map_grid import places_of
from cmm_align.stages.map_noise import map_noise, step_of
from cmm_align.stages.pass_prediction import pass_prediction, worth
from cmm_align.stages.previous_pass import check_chain, pass_response
from cmm_align.stages.process_transfer import process_transfer
from cmm_align.surfaces.protocol import Array, Jet, Mask
from cmm_align.surfaces.region import region_from_text

DEFAULTS: Final = CompensateConfig()

UNSTABLE_GAIN: Final = 2.0
"""From here on each pass makes the part worse than the one before, even of a perfect machine."""

CONTINUED: Final = (
    CorrectionStatus.BEYOND,
    CorrectionStatus.BRIDGED,
    CorrectionStatus.FEW_POINTS,
    CorrectionStatus.CLIPPED,
)
"""Nodes without data of their own."""


def compensate(
    deviation_map: DeviationMap,
    config: CompensateConfig = DEFAULTS,
    previous: Correction | None = None,
    learned: LearnedTransfer | None = None,
) -> Correction:
    """Return the correction of a map and the surface to command next.

    Parameters
    ----------
    deviation_map : DeviationMap
        Measured after the last pass.
    config : CompensateConfig
        Gain, filter, region, limits, and what is known of the process.
    previous : Correction, optional
        What was commanded in the last pass; without it, the nominal was.
    learned : LearnedTransfer, optional
        What a ledger knows of the process: the gain of each band is divided by it. A transfer in `config`
        goes before it.

    Returns
    -------
    Correction
        Complete over the nominal's aperture, NaN outside; grid as the map's, carried on to the
        bounds of the nominal.

    Raises
    ------
    UsageError
        If gain, transfer or region cannot be.
    WrongStageError
        If the long waves were filtered out of the map, or `previous` belongs to another nominal, has
        applied this map already, misses a pass, or was never ground.
    InputError
        If the correction is over a limit, or the map knows nothing in the region.
    NumericsError
        If the last pass made the part worse outside noise and repeatability.
    """
    m, nominal = deviation_map, deviation_map.alignment.nominal
    _check_gain(config)
    _check_map(m)
    digest = map_digest(m)
    check_chain(m, digest, previous)
    transfer = process_transfer(config.transfer, config.u_transfer)
    learned = None if transfer.known else learned
    transfer = transfer if learned is None else process_of(learned)
    region = region_from_text(config.region, nominal.surface, "--region") if config.region else None

    points = places_of(m.alignment)
    noise = map_noise(m, points)
    band = correction_band(m, noise, config, transfer, learned)
    x_mm, y_mm, here = carried_on(m)
    deviation = _placed(m.deviation_mm, here, (len(y_mm), len(x_mm)))
    response = pass_response(deviation, x_mm, y_mm, noise, config, previous)

    few = too_few_points(m, points, band.low_pass_mm, config.min_points_per_cell)
    usable = np.where(few, np.nan, m.deviation_mm)
    wanted = _placed(-filtered_deviation(m, band, usable), here, deviation.shape)
    jet, inside = _nominal_on(m, x_mm, y_mm)
    chosen = region_mask(region, x_mm, y_mm, np.isfinite(wanted))
    taper_mm = taper_width_mm(config, band.low_pass_mm, float(np.nanmax(np.abs(wanted))))
    few_here = _placed(few.astype(np.float64), here, deviation.shape) == 1.0
    steps = step_of(x_mm), step_of(y_mm)
    correction, status, _ = completed(wanted, few_here, inside, chosen, steps, taper_mm)
    words = "" if region is None else region.words
    limits = checked_limits(correction, status, inside, x_mm, y_mm, jet, config, previous, taper_mm, words)

    total = correction + total_so_far(previous, x_mm, y_mm)
    height, normal = commanded_surface(jet, nominal.side, total, x_mm, y_mm)
    grid = x_mm, y_mm, correction
    prediction, predicted = pass_prediction(
        points, grid, noise, band, transfer, config, nominal.surface.bounds
    )
    before = deviation_statistics(points.deviation_mm, points.x_mm, points.y_mm)
    pays, reason = worth(before, prediction)
    return Correction(
        nominal=nominal,
        x_mm=frozen_array(x_mm),
        y_mm=frozen_array(y_mm),
        correction_mm=_masked(correction, inside),
        total_correction_mm=_masked(total, inside),
        commanded_z_mm=_masked(height, inside),
        commanded_normal=_masked(normal, inside[..., None]),
        extended=frozen_array(inside & np.isin(status, CONTINUED), np.bool_),
        gain=config.gain if config.gain_rule == "fixed" else mean_gain(noise.psd, band),
        pass_number=1 if previous is None else previous.pass_number + 1,
        predicted=predicted,
        before=before,
        worth_another_pass=pays,
        reason=reason,
        map_digest=digest,
        applied_maps=() if previous is None else (*previous.applied_maps, previous.map_digest),
        gain_rule=config.gain_rule,
        deviation_mm=frozen_array(deviation),
        status=frozen_array(status, np.uint8),
        band=band,
        limits=limits,
        prediction=prediction,
        response=response,
    )


def map_digest(deviation_map: DeviationMap) -> str:
    """Return the SHA-256 (hex) of the measured points behind a map.

    Another spacing, filter or alignment of the same measurement is still the same measurement: it must
    not be ground away twice.
    """
    points = deviation_map.alignment.tip_centre_machine_mm
    return hashlib.sha256(np.ascontiguousarray(points, dtype="<f8").tobytes()).hexdigest()


def _check_gain(config: CompensateConfig) -> None:
    """Refuse a gain that makes things worse, or one that is not safe unless it is forced."""
    most = UNSTABLE_GAIN if config.force_gain else MAX_GAIN
    if not 0.0 < config.gain <= most or config.gain == UNSTABLE_GAIN:
        raise UsageError(
            f"gain = {config.gain:g}",
            expected=f"more than 0 and {'less than' if config.force_gain else 'at most'} {most:g}",
            remedy=""
            if config.force_gain
            else f"up to {UNSTABLE_GAIN:g} with --force-gain, at your own risk",
        )


def _check_map(deviation_map: DeviationMap) -> None:
    """Refuse a map that its form was filtered out of."""
    if deviation_map.filter is not None and deviation_map.filter.high_pass_mm > 0.0:
        raise WrongStageError(
            f"the map is filtered ({deviation_map.filter.words}): its form is not in it",
            expected="a map with all long waves",
            remedy="make it anew without --high-pass",
        )


def _nominal_on(deviation_map: DeviationMap, x_mm: Array, y_mm: Array) -> tuple[Jet, Mask]:
    """Return the nominal on a grid, each of shape (ny, nx), and which nodes lie in its aperture."""
    surface = deviation_map.alignment.nominal.surface
    x, y = np.meshgrid(x_mm, y_mm)
    jet = Jet(*(a.reshape(x.shape) for a in surface.jet(x.ravel(), y.ravel())))
    return jet, surface.contains(x.ravel(), y.ravel()).reshape(x.shape)


def _placed(field: Array, here: tuple[slice, slice], shape: tuple[int, int]) -> Array:
    """Return a field of the map on the wider grid, NaN around it."""
    wide = np.full(shape, np.nan)
    wide[here] = field
    return wide


def _masked(field: Array, inside: Mask) -> Array:
    """Return a read-only field with NaN outside the aperture."""
    result: Array = frozen_array(np.where(inside, field, np.nan))
    return result
