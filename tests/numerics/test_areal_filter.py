"""Areal filters: half the amplitude at the cutoff, polynomials up to the border, limits, bands."""

from functools import partial

import numpy as np
import pytest
from scipy.special import lambertw

from cmm_align.errors import GeometryError, UsageError
from cmm_align.numerics.areal_filter import (
    band_pass,
    band_transmission,
    cutoff_limits_mm,
    gaussian_regression,
    gaussian_regression_scattered,
    gaussian_transmission,
)
from cmm_align.numerics.areal_spline_filter import spline_filter, spline_transmission

STEP_X, STEP_Y = 0.5, 0.4
X, Y = np.meshgrid(STEP_X * np.arange(-90, 91), STEP_Y * np.arange(-75, 76))
SPACING = (STEP_X, STEP_Y)
LOW_PASSES = {
    "order 0": partial(gaussian_regression, order=0),
    "order 2": gaussian_regression,
    "spline": spline_filter,
}


def quadratic(x, y):
    u, v = x / 45.0, y / 30.0
    return 0.2 + 0.3 * u - 0.4 * v + 0.5 * u**2 - 0.2 * u * v + 0.3 * v**2


def ragged(share=0.1):
    """An ellipse with a hole and missing nodes."""
    known = (np.hypot(X / 44.0, Y / 29.0) < 1.0) & (np.hypot(X - 12.0, Y + 4.0) > 4.0)
    return known & (np.random.default_rng(1).random(X.shape) > share)


def kept(filtered, wave, middle=(slice(40, -40), slice(50, -50))):
    """Share of a wave that is left in the middle, by least squares."""
    return float((filtered * wave)[middle].sum() / (wave * wave)[middle].sum())


@pytest.mark.parametrize("low_pass", LOW_PASSES.values(), ids=LOW_PASSES)
@pytest.mark.parametrize("cutoff_mm", [2.0, 5.0, 12.0])
def test_half_the_amplitude_is_kept_at_the_cutoff_along_both_axes(low_pass, cutoff_mm):
    for places in (X, Y):
        wave = np.cos(2.0 * np.pi * places / cutoff_mm + 1.0)

        assert kept(low_pass(wave, SPACING, cutoff_mm), wave) == pytest.approx(0.5, abs=0.005)


@pytest.mark.parametrize("order", [0, 2])
def test_the_gaussian_does_not_know_directions(order):
    along = X * np.cos(np.deg2rad(40.0)) + Y * np.sin(np.deg2rad(40.0))
    for cutoff_mm in (2.0, 6.0):
        wave = np.cos(2.0 * np.pi * along / cutoff_mm)

        filtered = gaussian_regression(wave, SPACING, cutoff_mm, order=order)

        assert kept(filtered, wave) == pytest.approx(0.5, abs=0.005)


@pytest.mark.parametrize("order", [0, 2])
@pytest.mark.parametrize("share", [0.5, 0.8, 1.5, 2.0])
def test_other_wavelengths_follow_the_transmission(order, share):
    wave = np.cos(2.0 * np.pi * X / (6.0 * share))

    filtered = gaussian_regression(wave, SPACING, 6.0, order=order)

    expected = float(gaussian_transmission(np.array(6.0 * share), 6.0, order))
    # a single place: the kernel ends at five deviations, where 5e-5 of it is left (order 2)
    assert filtered[75, 90] == pytest.approx(expected * wave[75, 90], abs=1e-4)


def test_the_widths_are_those_of_the_standard():
    u = float(np.real(-1.0 - lambertw(-0.5 / np.e, -1)))
    half = np.array(3.0)

    assert float(gaussian_transmission(half, 3.0, 0)) == pytest.approx(0.5, abs=1e-15)
    assert float(gaussian_transmission(half, 3.0, 2)) == pytest.approx(0.5, abs=1e-15)
    assert float(gaussian_transmission(np.array(1.5), 3.0, 0)) == pytest.approx(2.0**-4, abs=1e-15)
    assert float(gaussian_transmission(np.array(1.5), 3.0, 2)) == pytest.approx(
        (1.0 + 4.0 * u) * np.exp(-4.0 * u), abs=1e-15
    )
    assert float(spline_transmission(half, 3.0, 0.5)) == pytest.approx(0.5, abs=1e-15)


def test_the_spline_follows_its_transmission_and_the_dense_equations():
    wave = np.cos(2.0 * np.pi * X / 9.0)
    filtered = spline_filter(wave, SPACING, 6.0)
    # the border's influence decays with exp(-sqrt(2) pi x / cutoff): nothing is left after five cutoffs
    assert filtered[75, 90] == pytest.approx(float(spline_transmission(np.array(9.0), 6.0, STEP_X)), abs=1e-5)

    rng = np.random.default_rng(3)
    values = rng.normal(size=(9, 11))
    values[:3, :2] = np.nan
    known = np.isfinite(values)
    number = np.cumsum(known).reshape(known.shape) - 1
    c = 0.25 / np.sin(np.pi / 5.0) ** 2
    rows = []
    for steps, factors in (
        (((0, 0), (0, 1), (0, 2)), c * np.array([1.0, -2.0, 1.0])),
        (((0, 0), (1, 0), (2, 0)), c * np.array([1.0, -2.0, 1.0])),
        (((0, 0), (0, 1), (1, 0), (1, 1)), np.sqrt(2.0) * c * np.array([1.0, -1.0, -1.0, 1.0])),
    ):
        for iy in range(9):
            for ix in range(11):
                nodes = [(iy + a, ix + b) for a, b in steps]
                if all(a < 9 and b < 11 and known[a, b] for a, b in nodes):
                    row = np.zeros(known.sum())
                    row[[number[node] for node in nodes]] = factors
                    rows.append(row)
    d = np.array(rows)
    dense = np.linalg.solve(np.eye(d.shape[1]) + d.T @ d, values[known])

    np.testing.assert_allclose(spline_filter(values, 1.0, 5.0)[known], dense, atol=1e-9)


@pytest.mark.parametrize("cutoff_mm", [2.0, 20.0])
def test_constant_plane_and_quadratic_pass_unchanged_at_the_border_and_beside_holes(cutoff_mm):
    known = ragged()
    for low_pass, field in (
        (LOW_PASSES["order 0"], np.full(X.shape, 0.7)),
        (LOW_PASSES["order 2"], quadratic(X, Y)),
        (LOW_PASSES["spline"], 0.2 + 0.01 * X - 0.02 * Y),
    ):
        filtered = low_pass(np.where(known, field, np.nan), SPACING, cutoff_mm)

        np.testing.assert_array_equal(np.isfinite(filtered), known)
        np.testing.assert_allclose(filtered[known], field[known], rtol=0.0, atol=1e-12)


def test_a_whole_grid_keeps_its_corners_at_the_shortest_cutoff_and_lone_nodes_stay_unknown():
    values = np.full((60, 80), np.nan)
    values[10:50, 10:50] = quadratic(*np.meshgrid(np.arange(40.0), np.arange(40.0)))
    values[30, 70] = values[31, 70] = 1.0

    for low_pass in (gaussian_regression, spline_filter):
        filtered = low_pass(values, 1.0, 4.0)

        assert np.isfinite(filtered[10:50, 10:50]).all()
        assert np.count_nonzero(np.isfinite(filtered)) == 1600
    assert np.isfinite(LOW_PASSES["order 0"](values, 1.0, 4.0)[10:50, 10:50]).all()


def test_every_node_is_the_weighted_least_squares_fit_around_it():
    rng = np.random.default_rng(4)
    known = rng.random((21, 25)) > 0.3
    values = np.where(known, rng.normal(size=known.shape), np.nan)
    iy, ix = np.indices(known.shape)
    filtered = gaussian_regression(values, (1.0, 1.5), 8.0)
    for jy, jx in ((0, 0), (10, 12), (20, 3), (7, 24)):
        u, v = (ix - jx) * 1.0, (iy - jy) * 1.5
        root = np.where(known, np.exp(-(u**2 + v**2) / (4.0 * (0.2915922698 * 8.0) ** 2)), 0.0)[known]
        basis = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v])[:, known].T
        fit = np.linalg.lstsq(root[:, None] * basis, root * values[known], rcond=None)[0]
        if known[jy, jx]:
            # past five deviations lie 4e-5 of the kernel; a one-sided fit takes up to five times that
            assert filtered[jy, jx] == pytest.approx(fit[0], abs=2e-4)


def test_outliers_leave_the_robust_filter_alone():
    rng = np.random.default_rng(5)
    truth = quadratic(X, Y)
    noise = 1e-3 * rng.normal(size=X.shape)
    spikes = rng.random(X.shape) < 0.05

    clean = gaussian_regression(truth + noise, SPACING, 10.0)
    plain = gaussian_regression(truth + noise + 0.5 * spikes, SPACING, 10.0)
    robust = gaussian_regression(truth + noise + 0.5 * spikes, SPACING, 10.0, robust=True)

    inner = (slice(20, -20), slice(20, -20))
    assert np.abs(plain - truth)[inner].max() > 0.02
    # a biweight that ends at three deviations is 77 % efficient, and a twentieth of the nodes is lost
    assert np.std((robust - truth)[inner]) < np.std((clean - truth)[inner]) / np.sqrt(0.77 * 0.95)
    # the means differ by the noise of what is lost: sqrt(1 / (0.77 * 0.95) - 1) = 0.6 of 1e-3 a node
    n = clean[inner].size
    assert np.mean((robust - clean)[inner]) == pytest.approx(0.0, abs=3.0 * 0.6e-3 / n**0.5)


def test_the_robust_filter_without_noise_is_the_plain_one():
    field = quadratic(X, Y)

    np.testing.assert_allclose(
        gaussian_regression(field, SPACING, 10.0, robust=True), field, rtol=0.0, atol=1e-12
    )


def test_bands_add_up_and_keep_what_their_transmission_says():
    wave = np.cos(2.0 * np.pi * X / 6.0)
    for low_pass, transmission in (
        (gaussian_regression, gaussian_transmission),
        (spline_filter, partial(spline_transmission, spacing_mm=STEP_X)),
    ):
        bands = [
            band_pass(wave, SPACING, short, long, low_pass=low_pass)
            for short, long in ((None, 4.0), (4.0, 10.0), (10.0, None))
        ]
        share = band_transmission(np.array([6.0]), 4.0, 10.0, transmission=transmission)

        np.testing.assert_allclose(sum(bands), wave, rtol=0.0, atol=1e-12)
        assert kept(bands[1], wave) == pytest.approx(float(share[0]), abs=0.005)
    np.testing.assert_array_equal(band_transmission(np.array([1.0, 9.0]), None, None), 1.0)


def scattered(n=6000):
    rng = np.random.default_rng(6)
    return rng.uniform(-20.0, 20.0, n), rng.uniform(-15.0, 15.0, n)


@pytest.mark.parametrize("order", [0, 2])
def test_scattered_points_keep_half_at_the_cutoff(order):
    x, y = scattered()
    at_x, at_y = (a.ravel() for a in np.meshgrid(np.linspace(-9.0, 9.0, 25), np.linspace(-5.0, 5.0, 11)))
    wave = np.cos(2.0 * np.pi * x / 6.0)

    filtered = gaussian_regression_scattered(x, y, wave, at_x, at_y, 6.0, order=order)

    expected = np.cos(2.0 * np.pi * at_x / 6.0)
    # 1500 points in the middle, each missing half a wave by chance: 0.35 / sqrt(1500) = 0.009
    assert float(filtered @ expected / (expected @ expected)) == pytest.approx(0.5, abs=0.02)


def test_points_on_a_grid_give_what_the_grid_gives():
    x, y = np.meshgrid(np.arange(0.0, 20.0, 0.5), np.arange(0.0, 15.0, 0.5))
    values = np.random.default_rng(7).normal(size=x.shape)
    for order in (0, 2):
        on_grid = gaussian_regression(values, 0.5, 4.0, order=order)
        at_points = gaussian_regression_scattered(
            x.ravel(), y.ravel(), values.ravel(), x.ravel(), y.ravel(), 4.0, order=order
        )

        # a square of weights against a circle: between them lie 0.22 x 544 nodes of weight under 3.7e-6,
        # times |2 - 12.5| over the sum of weights, 34; a one-sided fit takes up to five times that
        np.testing.assert_allclose(at_points.reshape(x.shape), on_grid, rtol=0.0, atol=7e-4)


def test_scattered_points_carry_a_quadratic_to_their_border_and_nothing_past_it():
    x, y = scattered()
    keep = np.hypot(x, y) > 4.0
    x, y = x[keep], y[keep]
    at_x, at_y = np.append(x[:500], [0.0, 25.0]), np.append(y[:500], [0.0, 0.0])
    values = quadratic(x, y)
    filtered = gaussian_regression_scattered(x, y, values, at_x, at_y, 6.0)

    np.testing.assert_allclose(filtered[:500], values[:500], rtol=0.0, atol=1e-12)
    assert np.isnan(filtered[500:]).all()


@pytest.mark.parametrize("low_pass", LOW_PASSES.values(), ids=LOW_PASSES)
@pytest.mark.parametrize("cutoff_mm", [0.0, -1.0, 1.9, 91.0, np.inf, np.nan])
def test_a_cutoff_under_the_sampling_or_over_the_part_is_refused_with_the_limits(low_pass, cutoff_mm):
    assert cutoff_limits_mm(X, SPACING) == pytest.approx((2.0, 90.0))
    with pytest.raises(UsageError, match=r"2 mm \(sampling: 4 spacings\) to 90 mm \(the part\)"):
        low_pass(X, SPACING, cutoff_mm)


def test_what_cannot_be_filtered_is_refused():
    with pytest.raises(GeometryError, match="without a single value"):
        gaussian_regression(np.full((5, 5), np.nan), 1.0, 4.0)
    with pytest.raises(UsageError, match="measure more densely"):
        gaussian_regression(np.ones((3, 3)), 1.0, 4.0)
    with pytest.raises(UsageError, match="the shorter wavelength first"):
        band_pass(X, SPACING, 8.0, 4.0)
    line = np.linspace(0.0, 10.0, 50)
    for places in (line, line[:0]):
        with pytest.raises(GeometryError, match="span no area"):
            gaussian_regression_scattered(places, 0.0 * places, places, places, places, 4.0)
    x, y = scattered(400)
    with pytest.raises(UsageError, match="sampling"):
        gaussian_regression_scattered(x, y, x, x, y, 2.0)
