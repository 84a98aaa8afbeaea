"""What a correction leaves out, refuses, and says about it."""

from dataclasses import replace

import numpy as np
import pytest
from truth_maps import PLANE, WINDOW, Quadric, aligned, form_error_mm, random_places

from cmm_align.config import CompensateConfig
from cmm_align.errors import InputError, UsageError
from cmm_align.model import CorrectionStatus
from cmm_align.stages.compensate import compensate
from cmm_align.stages.error_map import error_map


def measured(surface=WINDOW, error=form_error_mm, places=None, n=4000, noise_mm=3e-4, seed=0):
    return error_map(aligned(surface, error, places or random_places(surface, n, seed), noise_mm=noise_mm))


@pytest.fixture(scope="module")
def first():
    return measured()


def wheel_limit(first, **settings):
    return compensate(first, CompensateConfig(**settings)).band


def test_spacing_binds_where_the_form_stands_out_and_noise_where_it_does_not(first):
    c = compensate(first)
    step = max(c.x_mm[1] - c.x_mm[0], c.y_mm[1] - c.y_mm[0])
    assert c.band.bound == "sampling"
    assert c.band.low_pass_mm == pytest.approx(4.0 * step)
    assert c.band.words.endswith("set by the spacing of the map")
    noisy = compensate(measured(error=lambda x, y: 0.02 * form_error_mm(x, y)))
    assert noisy.band.bound == "noise"
    assert noisy.band.low_pass_mm > 1.5 * noisy.band.sampling_mm


def test_a_wheel_binds_by_two_pi_root_of_amplitude_times_effective_radius(first):
    band = wheel_limit(first, wheel_radius_mm=500.0)
    amplitude = np.sqrt(2.0 * np.nanmean(first.deviation_mm**2))
    x, y = (a[np.isfinite(first.deviation_mm)] for a in np.meshgrid(first.x_mm, first.y_mm))
    jet = WINDOW.jet(x, y)
    # z = 0.008 x^2 + 0.006 y^2 is concave from above; the curvature by eigenvalues of the shape
    w = np.sqrt(1 + jet.zx**2 + jet.zy**2)
    most = max(
        np.linalg.eigvals(
            np.linalg.inv([[1 + a * a, a * b], [a * b, 1 + b * b]]) @ (np.diag([0.016, 0.012]) / c)
        ).real.max()
        for a, b, c in zip(jet.zx[::7], jet.zy[::7], w[::7], strict=True)
    )
    assert most * 500.0 > 1.0  # such a wheel does not even fit: the limit is as large as the part
    assert band.low_pass_mm == pytest.approx(np.ptp(first.x_mm), rel=0.02)
    small = wheel_limit(first, wheel_radius_mm=40.0)
    assert small.wheel_mm == pytest.approx(
        2 * np.pi * np.sqrt(amplitude * 40.0 / (1 - 40.0 * most)), rel=0.02
    )


def test_what_was_asked_for_binds_and_the_filter_keeps_half_at_its_cutoff(first):
    c = compensate(first, CompensateConfig(low_pass_mm=20.0))
    assert (c.band.bound, c.band.low_pass_mm) == ("asked", 20.0)
    assert np.interp(1 / 20.0, c.band.frequency_per_mm, c.band.gain) == pytest.approx(0.5, abs=0.02)


def test_the_wiener_gain_is_near_one_for_the_form_and_nothing_in_the_noise(first):
    c = compensate(first, CompensateConfig(gain_rule="wiener", repeatability_um=0.0))
    assert c.gain == pytest.approx(1.0, abs=0.02)
    assert c.band.gain[0] > 0.98
    assert c.band.gain[-1] < 0.05
    known = compensate(first, CompensateConfig(gain_rule="wiener", transfer="0.8", repeatability_um=0.0))
    assert known.band.gain[0] == pytest.approx(1.2, abs=0.03)  # 1.25, held at 1.2
    assert max(known.band.gain) <= 1.2


def test_a_region_is_corrected_fully_inside_and_fades_out_around_it(first):
    whole = compensate(first)
    part = compensate(first, CompensateConfig(region="circle:0,0,15"))
    x, y = np.meshgrid(part.x_mm, part.y_mm)
    inside = np.hypot(x, y) <= 15.0
    np.testing.assert_allclose(part.correction_mm[inside], whole.correction_mm[inside], atol=1e-12)
    far = np.isfinite(part.correction_mm) & (np.hypot(x, y) > 15.0 + part.limits.taper_mm + 3.0)
    assert not np.any(part.correction_mm[far])
    assert part.limits.n_outside_region == int(
        np.sum((part.status == CorrectionStatus.OUTSIDE_REGION) & np.isfinite(part.correction_mm))
    )
    assert part.limits.max_slope_rad < 2e-3


def test_a_region_outside_the_map_and_one_that_is_none_are_refused(first):
    with pytest.raises(InputError, match="lies outside the map"):
        compensate(first, CompensateConfig(region="circle:200,0,15"))
    with pytest.raises(UsageError, match="is no region"):
        compensate(first, CompensateConfig(region="square:1,2"))


def test_past_the_data_the_correction_fades_over_the_contact_of_the_wheel():
    x, y = random_places(WINDOW, 4000)
    keep = np.abs(x) < 35.0
    config = CompensateConfig(edge_taper_mm=10.0, max_slope_mrad=10.0)
    c = compensate(measured(places=(x[keep], y[keep])), config)
    past = np.isfinite(c.correction_mm) & (np.abs(c.x_mm) > 47.0)
    assert not np.any(c.correction_mm[past])
    assert (c.status[past] == CorrectionStatus.BEYOND).all()


def test_a_hole_is_bridged_marked_and_near_the_truth():
    x, y = random_places(WINDOW, 6000)
    keep = np.hypot(x - 10.0, y) > 7.0
    c = compensate(measured(places=(x[keep], y[keep]), noise_mm=0.0))
    xg, yg = np.meshgrid(c.x_mm, c.y_mm)
    hole = np.hypot(xg - 10.0, yg) < 5.0
    assert (c.status[hole] == CorrectionStatus.BRIDGED).all()
    assert c.limits.n_bridged >= hole.sum()
    assert np.abs(c.correction_mm + form_error_mm(xg, yg))[hole].max() < 1e-3


def test_nodes_by_too_few_points_are_not_used(first):
    c = compensate(first, CompensateConfig(min_points_per_cell=9))
    assert 0 < c.limits.n_few_points < c.status.size
    few = np.isfinite(c.correction_mm) & (c.status == CorrectionStatus.FEW_POINTS)
    assert c.extended[few].all()
    assert compensate(first).limits.n_few_points <= 4  # cells in a corner lie outside by three quarters


def steep(x, y):
    return 0.01 * np.tanh(x / 2.0)


def test_a_steep_correction_is_warned_of_and_a_steeper_one_refused():
    mild = compensate(measured(PLANE, lambda x, y: 0.6 * steep(x, y), n=8000, noise_mm=0.0))
    assert 2e-3 < mild.limits.max_slope_rad < 5e-3
    assert "mrad" in mild.limits.warnings[0]
    with pytest.raises(InputError, match=r"slope of \d+\.\d mrad at \([-+]?\d"):
        compensate(measured(PLANE, lambda x, y: 3.0 * steep(x, y), n=8000, noise_mm=0.0))


def test_slopes_are_taken_along_the_surface():
    ramp = Quadric(half_x=20.0, half_y=20.0, a=1.0)
    c = compensate(measured(ramp, lambda x, y: 1e-3 * x, n=2000, noise_mm=0.0))
    with_data = c.limits.max_slope_rad
    assert with_data == pytest.approx(1e-3 / np.sqrt(2.0), rel=0.02)


def test_thickness_adds_up_over_the_passes_and_has_a_budget(first):
    one = compensate(first)
    assert one.limits.removal_mm == pytest.approx(np.nanmax(one.correction_mm) - np.nanmin(one.correction_mm))
    rest = measured(error=lambda x, y: 0.1 * form_error_mm(x, y), seed=5)
    two = compensate(rest, previous=one)
    assert two.limits.total_removal_mm == one.limits.removal_mm + two.limits.removal_mm
    budget = CompensateConfig(thickness_budget_um=1e3 * two.limits.total_removal_mm - 0.1)
    with pytest.raises(InputError, match="to take off in all passes"):
        compensate(rest, budget, previous=one)
    compensate(first, budget)


@pytest.mark.parametrize("text", ["x", "0", "-1", "3", "0.9@30mm, 0.8", "0.9@30mm, 0.8@30mm", "0.9@3kg"])
def test_a_transfer_that_is_none_is_refused(first, text):
    with pytest.raises(UsageError, match="transfer"):
        compensate(first, CompensateConfig(transfer=text))


def test_a_transfer_by_wavelength_is_linear_in_its_logarithm(first):
    t = compensate(first, CompensateConfig(transfer="0.4@3mm, 0.8@12mm")).prediction.transfer
    assert t.known
    np.testing.assert_allclose(t.at(np.array([0.0, 1 / 12, 1 / 6, 1 / 3, 1.0])), [0.8, 0.8, 0.6, 0.4, 0.4])


def test_forced_gains_end_where_the_loop_diverges(first):
    assert compensate(first, CompensateConfig(gain=1.5, force_gain=True)).gain == 1.5
    for gain in (2.0, -0.5, 0.0):
        with pytest.raises(UsageError, match="gain"):
            compensate(first, CompensateConfig(gain=gain, force_gain=True))
    with pytest.raises(UsageError, match="--force-gain"):
        compensate(first, CompensateConfig(gain=1.5))


def test_files_of_older_versions_can_still_be_a_previous_pass(first):
    one = replace(compensate(first), deviation_mm=None, status=None, limits=None, band=None, prediction=None)
    rest = measured(error=lambda x, y: 0.1 * form_error_mm(x, y), seed=5)
    two = compensate(rest, previous=one)
    assert two.response is None
    assert two.limits.total_removal_mm > two.limits.removal_mm
