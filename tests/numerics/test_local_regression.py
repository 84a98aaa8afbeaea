"""Local regression: exact where it can be exact, honest where it cannot, silent where it must be."""

import numpy as np
import pytest

from cmm_align.numerics.local_regression import local_regression
from cmm_align.numerics.point_density import fill, filled_box

NODES_X, NODES_Y = np.linspace(0.0, 10.0, 21), np.linspace(-2.0, 4.0, 13)


def places(n, seed=0):
    rng = np.random.default_rng(seed)
    return rng.uniform(0.0, 10.0, n), rng.uniform(-2.0, 4.0, n)


@pytest.mark.parametrize(
    "field",
    [
        lambda x, y: 3.0 + 0 * x,
        lambda x, y: 1.0 - 0.2 * x + 0.3 * y,
        lambda x, y: 1.0 - 0.2 * x + 0.3 * y + 0.05 * x**2 - 0.04 * x * y + 0.03 * y**2,
    ],
    ids=["constant", "plane", "quadratic"],
)
def test_a_quadratic_is_reproduced_to_rounding_at_every_node_and_at_the_border(field):
    x, y = places(9600)
    fit = local_regression(x, y, field(x, y), NODES_X, NODES_Y)
    assert np.isfinite(fit.value).all()
    assert np.abs(fit.value - field(*np.meshgrid(NODES_X, NODES_Y))).max() < 1e-12


@pytest.mark.parametrize("half_width", [1.5, 2.5])
def test_value_and_leverage_are_those_of_a_plain_least_squares_fit_in_the_window(half_width):
    x, y = places(2400, seed=3)
    z = np.sin(x) + np.cos(2 * y)
    fit = local_regression(x, y, z, NODES_X, NODES_Y, half_width=half_width)
    for iy, ix in [(0, 0), (5, 9), (12, 20), (7, 0)]:
        u, v = (x - NODES_X[ix]) / 0.5, (y - NODES_Y[iy]) / 0.5
        near = (np.abs(u) < half_width) & (np.abs(v) < half_width)
        u, v = u[near], v[near]
        a = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=1)
        assert fit.count[iy, ix] == near.sum()
        if fit.quadratic[iy, ix]:
            assert fit.value[iy, ix] == pytest.approx(np.linalg.lstsq(a, z[near])[0][0], abs=1e-11)
            assert fit.leverage[iy, ix] == pytest.approx(np.linalg.inv(a.T @ a)[0, 0], rel=1e-9)


def test_noise_falls_with_the_leverage_and_the_stated_sigma_is_honest():
    z2, rms = [], []
    for seed in range(30):
        x, y = places(6000, seed)
        noise = np.random.default_rng(100 + seed).normal(0.0, 0.3, len(x))
        fit = local_regression(x, y, noise, NODES_X, NODES_Y)
        z2.append(np.mean((fit.value / fit.sigma) ** 2))
        inner = fit.value[2:-2, 2:-2]
        rms.append(np.sqrt(np.mean(inner**2)))
        assert fit.scatter == pytest.approx(0.3, rel=0.05)
    # 30 x 273 nodes, about nine to a window: 900 independent values, so 1 +- 3 sqrt(2 / 900)
    assert np.mean(z2) == pytest.approx(1.0, abs=3.0 * np.sqrt(2.0 / 900.0))
    # uniform square window, N = 225 points, value of a quadratic at its centre: sigma^2 3.5 / N
    assert np.mean(rms) == pytest.approx(0.3 * np.sqrt(3.5 / 225.0), rel=0.1)


def test_a_hole_and_the_outside_stay_unknown_and_a_missing_point_does_not_make_a_hole():
    x, y = places(24_000)
    hole = np.hypot(x - 5.0, y - 1.0) < 1.3
    outside = x > 8.0
    keep = ~hole & ~outside
    fit = local_regression(x[keep], y[keep], x[keep], NODES_X, NODES_Y)
    xg, yg = np.meshgrid(NODES_X, NODES_Y)
    assert np.isnan(fit.value[np.hypot(xg - 5.0, yg - 1.0) < 0.9]).all()
    assert np.isnan(fit.value[xg > 8.3]).all()
    assert np.isfinite(fit.value[(xg < 7.9) & (np.hypot(xg - 5.0, yg - 1.0) > 1.7)]).all()


def test_dense_points_do_not_license_extrapolation():
    x, y = places(300_000)
    keep = x < 6.0
    fit = local_regression(x[keep], y[keep], x[keep] ** 3, NODES_X, NODES_Y)
    assert np.isnan(fit.value[:, NODES_X > 6.25]).all()


def test_too_few_or_collinear_or_no_points_leave_everything_unknown():
    x = np.linspace(0.0, 10.0, 500)
    for px, py in ((x[:3], x[:3]), (x, 0.3 * x - 2.0), (x[:0], x[:0])):
        fit = local_regression(px, py, np.ones_like(px), NODES_X, NODES_Y)
        assert np.isnan(fit.value).all()


def test_repeated_hits_on_few_places_are_not_taken_for_many_places():
    x, y = np.repeat([4.9, 5.0, 5.1], 40), np.repeat([1.0, 1.1, 1.2], 40)
    fit = local_regression(x, y, np.ones(120), NODES_X, NODES_Y)
    assert np.isnan(fit.value).all()


def test_the_order_of_the_points_changes_nothing_but_rounding():
    x, y = places(5000)
    z = np.cos(x) * y
    shuffle = np.random.default_rng(5).permutation(len(x))
    one = local_regression(x, y, z, NODES_X, NODES_Y)
    two = local_regression(x[shuffle], y[shuffle], z[shuffle], NODES_X, NODES_Y)
    np.testing.assert_allclose(one.value, two.value, atol=1e-12)


def test_the_filled_box_is_the_pitch_of_scan_lines_and_counts_repeated_hits_once():
    along, across = np.meshgrid(np.arange(0.0, 100.0, 0.1), np.arange(0.0, 60.0, 2.0))
    assert filled_box(along.ravel(), across.ravel(), 0.05, 20.0) == pytest.approx(2.0, rel=0.15)
    x, y = places(1000)
    once = filled_box(x, y, 0.01, 3.0)
    assert filled_box(np.tile(x, 3), np.tile(y, 3), 0.01, 3.0) == once
    # random points: 1 - exp(-rho c^2) = 0.9
    assert once == pytest.approx(np.sqrt(-np.log(0.1) * 60.0 / 1000.0), rel=0.15)
    assert fill(x, y, 0.8) > 0.999  # 11 points to a box
