"""Spectral density: Parseval, sines, white noise and its floor."""

import numpy as np
import pytest
from scipy.ndimage import binary_closing

from cmm_align.errors import GeometryError, UsageError
from cmm_align.numerics.spectral_density import band_rms_mm, distance_window, radial_psd

SPACING = (0.5, 0.4)
X, Y = np.meshgrid(SPACING[0] * np.arange(160), SPACING[1] * np.arange(130))
DISC = binary_closing(
    (np.hypot(X - 40.0, Y - 26.0) < 25.0) & (np.hypot(X - 45.0, Y - 20.0) > 4.0), np.ones((3, 3))
)  # without notches, so that nothing is bridged
CELL_MM2 = SPACING[0] * SPACING[1]


def form(seed=0):
    noise = np.random.default_rng(seed).normal(size=X.shape)
    return 5e-3 * np.cos(X / 9.0) * np.sin(Y / 7.0) + 1e-3 * noise + 1e-2 + 1e-3 * X


@pytest.mark.parametrize("known", [np.ones(X.shape, dtype=bool), DISC], ids=["whole", "masked"])
def test_the_integral_over_all_frequencies_is_the_variance_of_the_windowed_map(known):
    values = np.where(known, form(), np.nan)
    psd = radial_psd(values, SPACING)
    window, width = distance_window(known, SPACING, 0.5)

    # the same plane by another route: least squares with the root of the window
    basis = np.stack([np.ones_like(X), X, Y], axis=-1)[known]
    root = np.sqrt(window[known])
    plane = basis @ np.linalg.lstsq(root[:, None] * basis, root * values[known], rcond=None)[0]
    variance = np.average((values[known] - plane) ** 2, weights=window[known] ** 2)

    assert psd.variance_mm2 == pytest.approx(variance, rel=1e-12, abs=0.0)
    assert float(np.dot(psd.psd_mm4, psd.area_per_mm2)) == pytest.approx(variance, rel=1e-12, abs=0.0)
    assert psd.taper_mm == pytest.approx(width)
    assert psd.bridged == 0


def test_bands_that_meet_add_up_to_the_variance():
    psd = radial_psd(np.where(DISC, form(), np.nan), SPACING, 1e-4)
    bands = [band_rms_mm(psd, short, long) for short, long in ((0.0, 3.3), (3.3, 17.0), (17.0, np.inf))]

    assert sum(rms**2 for rms, _ in bands) == pytest.approx(psd.variance_mm2, rel=1e-12, abs=0.0)
    # noise fills the whole plane of frequencies, 1 / (dx dy), less the mean
    assert sum(noise**2 for _, noise in bands) == pytest.approx(1e-8, rel=1e-4, abs=0.0)


@pytest.mark.parametrize("known", [np.ones(X.shape, dtype=bool), DISC], ids=["whole", "masked"])
@pytest.mark.parametrize("angle_deg", [0.0, 37.0, 90.0])
def test_a_sine_is_found_at_its_frequency_with_its_mean_square(known, angle_deg):
    along = X * np.cos(np.deg2rad(angle_deg)) + Y * np.sin(np.deg2rad(angle_deg))
    sine = 2e-3 * np.sin(2.0 * np.pi * along / 4.0)

    psd = radial_psd(np.where(known, sine, np.nan), SPACING)

    power = np.multiply(psd.psd_mm4, psd.area_per_mm2)
    assert psd.frequency_per_mm[int(np.argmax(power))] == pytest.approx(0.25, abs=0.02)
    rms, _ = band_rms_mm(psd, 3.0, 6.0)
    # over a window 25 mm wide and smooth, the mean of sin^2 is a half but for its leakage
    assert rms == pytest.approx(2e-3 / np.sqrt(2.0), rel=0.01, abs=0.0)
    assert band_rms_mm(psd, 0.0, 2.5)[0] < 0.02 * rms


@pytest.mark.parametrize("known", [np.ones(X.shape, dtype=bool), DISC], ids=["whole", "masked"])
def test_white_noise_is_flat_at_the_floor_and_scatters_as_stated(known):
    u = 3e-4
    noises = np.random.default_rng(8).normal(0.0, u, (24, *X.shape))
    psds = [radial_psd(np.where(known, noise, np.nan), SPACING, u) for noise in noises]
    floor = u * u * CELL_MM2
    levels = np.array([p.psd_mm4 for p in psds]) / floor
    freedom = np.array(psds[0].freedom)

    assert psds[0].noise_floor_mm4 == pytest.approx(floor, rel=1e-12, abs=0.0)
    inner = slice(2, None)  # the plane takes a part of the lowest rings
    # the mean of 24 chi-squares over their freedom scatters by sqrt(2 / (24 freedom)); four of them
    assert (np.abs(levels.mean(axis=0) - 1.0) < 4.0 * np.sqrt(2.0 / (24.0 * freedom)))[inner].all()
    spread = levels[:, inner].var(axis=0) * freedom[inner] / 2.0
    # a variance of 24 scatters by sqrt(2 / 23) = 0.3, the median of 90 rings by 1.25 x 0.3 / sqrt(90), and
    # lies (1 - 2 / (9 x 23))^3 = 0.97 of the mean
    assert np.median(spread) / 0.97 == pytest.approx(1.0, abs=3.0 * 1.25 * 0.3 / 90.0**0.5)


def test_the_floor_of_a_grid_of_uncertainties_is_its_mean_square_where_the_window_looks():
    sigma = np.where(X < 40.0, 1e-4, 3e-4)
    sigma[:, 100] = np.nan
    values = np.where(DISC, form(), np.nan)
    window, _ = distance_window(DISC, SPACING, 0.5)
    heard = np.isfinite(sigma)

    expected = CELL_MM2 * np.average(sigma[heard] ** 2, weights=window[heard] ** 2)
    assert radial_psd(values, SPACING, sigma).noise_floor_mm4 == pytest.approx(expected, rel=1e-12, abs=0.0)
    assert np.isnan(radial_psd(values, SPACING, np.nan).noise_floor_mm4)


def test_small_gaps_are_bridged_and_the_rings_fill_the_plane():
    smooth = 5e-3 * np.cos(X / 9.0) * np.sin(Y / 7.0)
    gaps = np.random.default_rng(9).random(X.shape) < 0.02
    gaps[[0, -1]] = gaps[:, [0, -1]] = False
    whole, holed = radial_psd(smooth, SPACING), radial_psd(np.where(gaps, np.nan, smooth), SPACING)

    assert whole.bridged == 0
    assert holed.bridged == np.count_nonzero(gaps)
    assert holed.variance_mm2 == pytest.approx(whole.variance_mm2, rel=1e-3, abs=0.0)
    assert sum(whole.area_per_mm2) == pytest.approx(1.0 / CELL_MM2, rel=1e-4, abs=0.0)
    assert whole.nyquist_per_mm == 1.0


def test_the_window_rises_from_the_border_and_is_one_inside():
    known = np.ones((41, 41), dtype=bool)
    window, width = distance_window(known, 1.0, 0.5)

    assert width == 10.5
    assert window[0, 20] == pytest.approx(np.sin(0.5 * np.pi / 10.5) ** 2)
    assert (window[10:-10, 10:-10] > 0.99).all()
    assert distance_window(DISC, SPACING, 1.0)[0][~DISC].max() == 0.0


def test_what_has_no_spectrum_is_refused():
    with pytest.raises(GeometryError, match="has no spectrum"):
        radial_psd(np.full((50, 50), np.nan), 1.0)
    with pytest.raises(GeometryError, match="at least 8 each"):
        radial_psd(np.ones((7, 50)), 1.0)
    with pytest.raises(UsageError, match="taper"):
        radial_psd(form(), SPACING, taper=0.0)
    with pytest.raises(UsageError, match="the shorter wavelength first"):
        band_rms_mm(radial_psd(form(), SPACING), 5.0, 2.0)
