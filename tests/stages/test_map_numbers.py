"""All numbers of a map against what was put in."""

from dataclasses import replace

import numpy as np
import pytest
from truth_maps import PLANE, WINDOW, Quadric, aligned, form_error_mm, random_places

from cmm_align.config import ErrorMapConfig
from cmm_align.model import frozen_array
from cmm_align.stages.error_map import error_map

DISC = Quadric(half_x=40.0, half_y=40.0, round=True)


def numbers(surface, error, n=20_000, noise_mm=0.3e-3, seed=0, config=None):
    places = random_places(surface, n, seed)
    return error_map(
        aligned(surface, error, places, noise_mm=noise_mm, seed=seed + 90), config or ErrorMapConfig()
    ).numbers


def over_area(surface, error):
    """Mean square and the like over the aperture: the midpoint rule on 800 x 500 cells."""
    x = surface.half_x * ((2 * np.arange(800) + 1) / 800 - 1)
    y = surface.half_y * ((2 * np.arange(500) + 1) / 500 - 1)
    xg, yg = np.meshgrid(x, y)
    return error(xg, yg)[surface.contains(xg, yg)]


@pytest.mark.parametrize("seed", range(3))
def test_rms_mean_and_percentiles_of_20000_noisy_points_are_those_of_the_form(seed):
    n = numbers(WINDOW, form_error_mm, seed=seed)
    truth = over_area(WINDOW, form_error_mm) * 1e3
    assert n.rms_um == pytest.approx(np.sqrt(np.mean(truth**2)), rel=0.01)
    assert n.rms_without_noise_um == pytest.approx(np.sqrt(np.mean(truth**2)), abs=4 * n.u_rms_um)
    assert n.mean_um == pytest.approx(np.mean(truth), abs=4 * n.u_mean_um + 0.01)
    assert n.noise_um == pytest.approx(0.3, rel=0.06)
    for q in ("2.5", "16", "50", "84", "97.5"):
        assert n.percentiles_um[q] == pytest.approx(np.percentile(truth, float(q)), abs=0.1)
    assert n.width_99_6_um < n.pv_um
    assert n.pv_without_noise_um == pytest.approx(np.ptp(truth), abs=4 * n.u_pv_um)


def test_noise_alone_has_next_to_no_form():
    n = numbers(PLANE, lambda x, y: 0.0 * x, noise_mm=1e-3)
    assert n.points_rms_um == pytest.approx(1.0, rel=0.03)
    assert n.rms_without_noise_um < 0.1 < n.rms_um
    assert n.pv_without_noise_um < 0.5 * n.pv_um < 0.3 * n.points_pv_um
    assert n.slope.rms_mrad < 0.3 * n.slope.noise_mrad


def test_waves_that_the_grid_does_not_carry_stay_in_the_rms_while_noise_goes():
    def ripple(x, y):
        return 2e-3 * np.sin(x / 8.0) + 1e-3 * np.sin(2 * np.pi * y / 1.2)

    n = numbers(PLANE, ripple)  # nodes are 1 mm apart, neighbouring points 0.2
    truth = np.sqrt(np.mean((over_area(PLANE, ripple) * 1e3) ** 2))
    assert n.scatter_um > 0.7
    assert n.rms_um < 0.93 * truth
    assert n.rms_without_noise_um == pytest.approx(truth, rel=0.06)  # neighbours see a part of the ripple


def test_power_astigmatism_and_spherical_are_told_as_iso_10110_5_says():
    def wave(x, y):
        r2 = (x**2 + y**2) / 1600.0
        return 1e-3 * (
            2.0 * r2 + 0.5 + 0.01 * x + 0.8 * (x**2 - y**2) / 1600.0 + 1.5 * (6 * r2**2 - 6 * r2 + 1)
        )

    i = numbers(DISC, wave).irregularity
    r2 = (np.arange(4000) + 0.5) / 4000  # area goes with r^2
    spherical = 1.5 * (6 * r2**2 - 6 * r2 + 1)
    assert i.a_um == pytest.approx(2.0, abs=0.03)
    assert i.c_um == pytest.approx(np.ptp(spherical), rel=0.03)
    rms_a = 0.8 / np.sqrt(6.0)
    rms_i = np.hypot(rms_a, np.std(spherical))
    assert i.rms_a_um == pytest.approx(rms_a, abs=0.01)
    assert i.rms_i_um == pytest.approx(rms_i, abs=0.01)
    assert i.rms_t_um == pytest.approx(np.hypot(rms_i, 2.0 / np.sqrt(12.0)), abs=0.01)
    left = over_area(DISC, lambda x, y: wave(x, y) - 1e-3 * (2.0 * (x**2 + y**2) / 1600.0 + 0.01 * x))
    assert i.b_um == pytest.approx(np.ptp(left) * 1e3, abs=3 * i.u_b_um)
    assert 0.0 < i.u_a_um < 0.05


@pytest.mark.parametrize("noise_mm", [0.0, 0.3e-3])
def test_slopes_on_a_steep_surface_are_those_along_the_surface(noise_mm):
    steep = Quadric(a=1.0)  # 45 degrees along x

    def ramp(x, y):
        return 1e-3 * x + 0.5e-3 * y

    s = numbers(steep, ramp, noise_mm=noise_mm).slope
    truth = np.hypot(1.0 / np.sqrt(2.0), 0.5)  # the way along x is longer by the root of two
    assert s.rms_mrad == pytest.approx(truth, abs=1e-9 if noise_mm == 0.0 else 4 * s.u_rms_mrad)
    assert s.max_without_noise_mrad == pytest.approx(truth, abs=1e-5 + 4 * s.u_max_mrad)
    assert s.base_mm == pytest.approx(3.0, rel=0.1)


def test_the_share_in_tolerance_counts_points_and_area():
    config = ErrorMapConfig(tolerance_band_lower_um=-5.0, tolerance_band_upper_um=2.5)
    n = numbers(PLANE, lambda x, y: 1e-4 * x, noise_mm=0.0, config=config)
    assert n.band_um == (-5.0, 2.5)
    assert n.area_in_tolerance == pytest.approx(7.5 / 10.2, abs=0.01)
    assert n.points_in_tolerance == pytest.approx(7.5 / 10.2, abs=0.015)


def test_uncertainties_stated_larger_than_the_scatter_are_in_every_number():
    a = aligned(PLANE, form_error_mm, random_places(PLANE, 4000), noise_mm=0.3e-3)
    stated = replace(a, sigma_mm=frozen_array(np.full(4000, 1.5e-3)))
    seen, told = error_map(a).numbers, error_map(stated).numbers
    kept = replace(a, sigma_mm=frozen_array(np.full(4000, 0.1e-3)))
    assert error_map(kept).numbers == seen  # smaller ones than the scatter are not believed
    assert told.rms_um == seen.rms_um
    assert told.u_rms_um > 3.0 * seen.u_rms_um
    for name in ("u_pv_um", "u_profile_um", "u_mean_um", "u_max_um", "u_min_um"):
        assert getattr(told, name) > 1.2 * getattr(seen, name), name


def test_the_numbers_tell_what_made_them():
    a = aligned(WINDOW, form_error_mm, random_places(WINDOW, 2000))
    report = replace(a.report, locked=("rz",), weights="area", criterion="minimum-zone", n_outliers=3)
    m = error_map(replace(a, report=report), ErrorMapConfig(low_pass_mm=15.0))
    made = m.numbers.made_by
    assert (made.criterion, made.weights, made.locked, made.n_outliers) == (
        "minimum-zone",
        "area",
        ("rz",),
        3,
    )
    assert made.filter == "gaussian, low pass 15 mm"
    assert "Monte" not in made.not_in_u
    assert m.numbers.slope.method.startswith("central difference")
