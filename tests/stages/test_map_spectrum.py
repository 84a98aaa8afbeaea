"""The spectrum of a map: a wave in its ring and band, the floor of the points, no spectrum of a small map."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from truth_maps import PLANE, aligned, random_places

from cmm_align import io
from cmm_align.config import ErrorMapConfig
from cmm_align.stages.error_map import error_map
from cmm_align.stages.map_spectrum import map_spectrum
from cmm_align.surfaces.prescription import prescription_from_toml

STEP = 1.0
FLAT = """
schema = "cmm-align/prescription/1"
units = "mm"
[aperture]
shape = "rectangle"
width = 102.0
height = 62.0
[[term]]
kind = "xy_polynomial"
coefficients = { "1,0" = 0.0 }
"""
X, Y = np.meshgrid(np.arange(90) * STEP, np.arange(60) * STEP)


def stored(m, path):
    """The map as it comes back from its file; of the surface, a prescription, as only that can be stored."""
    nominal = replace(m.alignment.nominal, surface=prescription_from_toml(FLAT, "flat.toml"))
    io.write(replace(m, alignment=replace(m.alignment, nominal=nominal)), path, ())
    return io.read_map(path)


def test_a_wave_is_found_in_its_ring_and_band_with_its_rms():
    spectrum = map_spectrum(3e-3 * np.sin(2.0 * np.pi * (X + 0.3) / 7.0), (STEP, STEP), np.nan, X.size)
    frequency = spectrum.frequency_per_mm[int(np.argmax(spectrum.psd_um2_mm2))]
    assert 1.0 / frequency == pytest.approx(7.0, rel=0.06)  # rings are 1/60 per mm apart
    band = next(band for band in spectrum.bands if band.short_mm <= 7.0 < band.long_mm)
    assert (band.short_mm, band.long_mm) == (5.0, 10.0)
    assert band.band_rms_um == pytest.approx(3.0 / np.sqrt(2.0), rel=0.03)
    others = [other.band_rms_um for other in spectrum.bands if other is not band]
    assert max(others) < 0.05 * band.band_rms_um
    assert np.isnan(spectrum.noise_floor_um2_mm2)
    assert np.isnan(band.noise_rms_um)


def test_rings_end_at_two_spacings_and_bands_meet():
    spectrum = map_spectrum(1e-3 * np.cos(X * Y), (STEP, 1.5 * STEP), 1e-4, X.size)
    assert spectrum.shortest_mm == 3.0
    assert 1.0 / spectrum.frequency_per_mm[-1] >= 3.0
    assert list(spectrum.frequency_per_mm) == sorted(spectrum.frequency_per_mm)
    for shorter, longer in zip(spectrum.bands, spectrum.bands[1:], strict=False):
        assert shorter.long_mm == longer.short_mm
    assert spectrum.bands[0].short_mm == 3.0


def test_white_noise_of_the_points_lies_at_the_floor_whatever_their_number():
    # 4 points a node: the mean of each has s / 2; the floor is s^2 times the area of a point.
    s, levels = 4e-4, []
    for seed in range(8):
        noise = np.random.default_rng(seed).normal(0.0, 0.5 * s, X.shape)
        spectrum = map_spectrum(noise, (STEP, STEP), s, 4 * X.size)
        assert spectrum.noise_floor_um2_mm2 == pytest.approx((s * 1e3) ** 2 * STEP**2 / 4.0)
        levels.append(np.mean(np.array(spectrum.psd_um2_mm2[2:]) / spectrum.noise_floor_um2_mm2))
    freedom = 8.0 * sum(spectrum.freedom[2:])
    assert np.mean(levels) == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 * len(spectrum.freedom) / freedom))


def test_a_map_keeps_its_spectrum_in_its_file(tmp_path):
    part = aligned(PLANE, lambda x, y: 2e-3 * np.cos(2.0 * np.pi * x / 15.0), random_places(PLANE, 6000))
    m = error_map(part)
    assert m.spectrum is not None
    band = next(band for band in m.spectrum.bands if band.short_mm <= 15.0 < band.long_mm)
    # a wave of 8 spacings: the window of the map takes a few percent of it
    assert band.band_rms_um == pytest.approx(2.0 / np.sqrt(2.0), rel=0.1)
    assert stored(m, tmp_path / "a.map.h5").spectrum == m.spectrum


def test_a_map_that_is_too_small_says_why(tmp_path):
    part = aligned(PLANE, lambda x, y: 1e-5 * x * y, random_places(PLANE, 200))
    m = error_map(part, ErrorMapConfig(spacing_mm=15.0))
    assert m.spectrum is not None
    assert m.spectrum.frequency_per_mm == ()
    assert "rows and columns has no spectrum" in m.spectrum.missing
    read = stored(m, tmp_path / "a.map.h5").spectrum
    assert read is not None
    assert read.missing == m.spectrum.missing
