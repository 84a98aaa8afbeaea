"""The gain by frequency: what it is for known spectra, and the filter made of it."""

import numpy as np
import pytest

from cmm_align.numerics.areal_filter import gaussian_transmission
from cmm_align.numerics.spectral_density import RadialPsd, radial_psd
from cmm_align.numerics.wiener_gain import (
    averaged_psd_mm4,
    gain_filtered,
    noise_wavelength_mm,
    regression_mixture,
    wiener_share,
)


def made_psd(power, floor, freedom=100.0):
    f = np.arange(1, len(power) + 1) / 100.0
    edges = np.concatenate([[0.0], f + 0.005])
    area = np.pi * np.diff(edges**2)
    values = (tuple(a.tolist()) for a in (f, np.asarray(power), area, edges, np.full(len(f), freedom)))
    return RadialPsd(*values, floor, 1.0, 0.5, 10.0, 0)


def test_the_share_is_signal_over_signal_and_noise():
    psd = made_psd(np.array([100.0, 10.0, 4.0, 2.0, 1.05, 1.0]), 1.0)
    np.testing.assert_allclose(wiener_share(psd), [0.99, 0.9, 0.75, 0.5, 0.0, 0.0], atol=1e-2)
    np.testing.assert_allclose(wiener_share(made_psd(np.ones(4), 0.0)), 1.0)
    with_chance = wiener_share(psd, np.array([49.0, 4.0, 1.0, 0.0, 0.0, 0.0]))
    np.testing.assert_allclose(with_chance[:4], [0.5, 0.5, 0.5, 0.5], atol=1e-2)


def test_averaging_keeps_a_power_law():
    f = np.arange(1, 40)
    psd = made_psd(1.0 / f**4, 1e-12, freedom=2e3)
    np.testing.assert_allclose(averaged_psd_mm4(psd), psd.psd_mm4, rtol=1e-3)


def test_the_shortest_wave_above_the_noise():
    assert noise_wavelength_mm(made_psd(np.array([100.0, 10.0, 4.0, 1.5, 1.0]), 1.0)) == pytest.approx(
        1 / 0.035
    )
    assert noise_wavelength_mm(made_psd(np.full(5, 9.0), 1.0)) == 0.0
    assert noise_wavelength_mm(made_psd(np.ones(5), 1.0)) == np.inf


def test_the_spectrum_of_noise_alone_has_no_share():
    rng = np.random.default_rng(3)
    psd = radial_psd(1e-3 * rng.standard_normal((60, 90)), 1.0, 1e-3)
    area = np.array(psd.area_per_mm2)
    assert area @ wiener_share(psd) / area.sum() < 0.02


def test_a_mixture_of_regressions_follows_a_curve_that_is_one():
    psd = made_psd(np.full(40, 2.0), 1.0)
    cutoffs = np.array([5.0, 8.0, 13.0, 20.0])
    wanted = 0.8 * gaussian_transmission(1.0 / np.array(psd.frequency_per_mm), 13.0)
    np.testing.assert_allclose(regression_mixture(psd, wanted, cutoffs), [0.0, 0.0, 0.8, 0.0], atol=0.02)


def test_a_wave_is_multiplied_by_its_gain_inside_and_a_quadratic_by_that_of_the_mean():
    x, y = np.meshgrid(np.arange(120.0), np.arange(80.0))
    wave = np.cos(2 * np.pi * x / 12.0)

    def gain(f):
        return np.exp(-((f / 0.1) ** 2))

    result = gain_filtered(wave + 5.0 + 0.01 * y**2, 1.0, gain, 30.0)
    inner = (slice(30, -30), slice(30, -30))
    assert np.abs(result - 5.0 - 0.01 * y**2 - gain(1.0 / 12.0) * wave)[inner].max() < 0.02
