"""The transfer of each spatial band: against processes whose transfer is known, and near the floor."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from truth_maps import WINDOW, aligned, form_error_mm, random_places

from cmm_align.config import CompensateConfig
from cmm_align.model import WaveBand
from cmm_align.numerics.areal_filter import gaussian_regression
from cmm_align.stages.band_response import band_response
from cmm_align.stages.compensate import compensate
from cmm_align.stages.error_map import error_map
from cmm_align.stages.map_grid import places_of
from cmm_align.stages.map_noise import map_noise, step_of
from cmm_align.stages.spatial_bands import banded, thinned, wave_bands
from cmm_align.surfaces.geometry import unit_normal

SCATTER_MM, LENGTH_MM, NODE_NOISE_MM = 5e-4, 10.0, 1e-4
CONFIG = CompensateConfig(repeatability_um=0.5, repeatability_length_mm=LENGTH_MM)
BANDS = wave_bands(WINDOW.bounds)


@pytest.fixture(scope="module")
def measured():
    """A map with the noise of its nodes, and the correction made from it."""
    m = error_map(aligned(WINDOW, form_error_mm, random_places(WINDOW, 3000, 0), noise_mm=2e-4))
    noise = map_noise(m, places_of(m.alignment))
    cell = step_of(m.x_mm) * step_of(m.y_mm)
    noise = replace(noise, psd=replace(noise.psd, noise_floor_mm4=NODE_NOISE_MM**2 * cell))
    return m, noise, compensate(m, CONFIG)


def one_pass(measured, form, transfer: float, seed: int, gain: float = 1.0):
    """Return what the ledger makes of a pass over a form, with chance and noise in both maps."""
    m, noise, correction = measured
    rng = np.random.default_rng(seed)
    steps = step_of(m.x_mm), step_of(m.y_mm)

    def chance():
        widths = [LENGTH_MM / math.sqrt(2.0) / step for step in reversed(steps)]
        wide = [n + 8 * int(w) for n, w in zip(m.deviation_mm.shape, widths, strict=True)]
        smooth = gaussian_filter(rng.standard_normal(wide), widths, mode="wrap")
        ny, nx = m.deviation_mm.shape
        smooth = smooth[:ny, :nx] * math.sqrt(4.0 * math.pi * widths[0] * widths[1])
        return SCATTER_MM * smooth + NODE_NOISE_MM * rng.standard_normal((ny, nx))

    before = np.where(np.isfinite(m.deviation_mm), form + chance(), np.nan)
    told = gain * gaussian_regression(before, steps, correction.band.low_pass_mm)
    previous = replace(
        correction,
        x_mm=m.x_mm,
        y_mm=m.y_mm,
        deviation_mm=before,
        correction_mm=-told,
        band=replace(correction.band, gain=tuple(gain * g for g in correction.band.gain)),
    )
    after = form - transfer * told + chance()
    return band_response(previous, replace(m, deviation_mm=after), noise, BANDS, CONFIG)


def test_a_known_transfer_comes_out_within_its_uncertainty(measured):
    m = measured[0]
    form = form_error_mm(*np.meshgrid(m.x_mm, m.y_mm))
    pulls = [
        (one.transfer - 0.5) / one.u_transfer
        for seed in range(20)
        for one in one_pass(measured, form, 0.5, seed)[:3]
        if one is not None
    ]
    assert len(pulls) == 60
    # 95 % are expected within 2; the number within has a deviation of 3 %, and u is on the safe side
    assert np.mean(np.abs(pulls) < 2.0) > 0.90
    assert abs(np.mean(pulls)) < 0.5
    assert np.std(pulls) > 0.4  # an uncertainty that is far too large would be no help either


def test_at_the_floor_where_all_that_is_corrected_is_chance_the_estimate_keeps_its_centre(measured):
    """Without the bias taken out it would be 1.5, the process doing half of what it is told."""
    found = [one_pass(measured, 0.0 * measured[0].deviation_mm, 0.5, seed)[0] for seed in range(16)]
    values = np.array([one.transfer for one in found])
    assert abs(values.mean() - 0.5) < 0.25
    assert min(one.u_transfer for one in found) > 0.35  # and it says that it hardly knows


def test_a_gain_of_two_does_not_change_the_transfer(measured):
    form = form_error_mm(*np.meshgrid(measured[0].x_mm, measured[0].y_mm))
    first = one_pass(measured, form, 0.5, 3, gain=2.0)[0]
    assert first.transfer == pytest.approx(0.5, abs=2.0 * first.u_transfer)


def test_how_the_part_sat_on_the_table_is_no_answer_to_a_correction(measured):
    m, noise, correction = measured
    x, y = np.meshgrid(m.x_mm, m.y_mm)
    n = unit_normal(WINDOW.jet(x.ravel(), y.ravel()), 1).reshape(*x.shape, 3)
    moved = 0.003 * n[..., 0] - 0.002 * n[..., 2]  # 3 um along x, 2 um along -z
    half = m.deviation_mm + 0.5 * correction.correction_mm[: len(m.y_mm), : len(m.x_mm)]
    still = band_response(correction, replace(m, deviation_mm=half), noise, BANDS, CONFIG)
    shifted = band_response(correction, replace(m, deviation_mm=half + moved), noise, BANDS, CONFIG)
    assert shifted[0].transfer == pytest.approx(still[0].transfer, abs=1e-9)


def test_bands_that_were_not_corrected_and_old_files_tell_nothing(measured):
    m, noise, correction = measured
    assert band_response(correction, m, noise, (*BANDS, WaveBand(0.5, 1.0)), CONFIG)[-1] is None
    assert band_response(replace(correction, deviation_mm=None), m, noise, BANDS, CONFIG) == (None,) * 4


def test_bands_add_up_to_the_low_pass_of_the_shortest_and_a_quadratic_is_in_the_longest():
    y, x = np.mgrid[-31.0:31.5:1.0, -51.0:51.5:1.0]
    field = 1.0 + 0.1 * x + 0.01 * x * y
    parts = banded(field, (1.0, 1.0), BANDS)
    np.testing.assert_allclose(parts[0], field, atol=1e-10)
    wavy = np.sin(x) + np.cos(0.3 * y)
    total = np.sum(banded(wavy, (1.0, 1.0), BANDS), axis=0)
    np.testing.assert_allclose(total, gaussian_regression(wavy, (1.0, 1.0), 4.0), atol=1e-12)


def test_blocks_are_averaged_whole_or_not_at_all():
    field = np.arange(20.0).reshape(4, 5)
    field[0, 0] = np.nan
    np.testing.assert_allclose(thinned(field, 2, 2), [[np.nan, 5.0], [13.0, 15.0]])
