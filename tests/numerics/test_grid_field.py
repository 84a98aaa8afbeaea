"""Fields on a grid: interpolation of third order, continuation that stays in range."""

import numpy as np
import pytest

from cmm_align.numerics.grid_field import continued, interpolated

X, Y = np.linspace(-3.0, 5.0, 33), np.linspace(0.0, 4.0, 17)
GRID = np.meshgrid(X, Y)


def quadratic(x, y):
    return 1.0 + 0.3 * x - y + 0.2 * x**2 + 0.1 * x * y - 0.3 * y**2


def test_a_quadratic_is_read_back_between_the_nodes_and_at_the_border():
    rng = np.random.default_rng(0)
    x, y = rng.uniform(-3.0, 5.0, 500), rng.uniform(0.0, 4.0, 500)
    np.testing.assert_allclose(interpolated(X, Y, quadratic(*GRID), x, y), quadratic(x, y), atol=1e-12)


def test_the_error_falls_with_the_third_power_of_the_step():
    rng = np.random.default_rng(1)
    x, y = rng.uniform(-2.0, 4.0, 500), rng.uniform(0.5, 3.5, 500)
    errors = []
    for n in (33, 65):
        xs, ys = np.linspace(-3.0, 5.0, n), np.linspace(0.0, 4.0, n // 2 + 1)
        xg, yg = np.meshgrid(xs, ys)
        errors.append(
            np.abs(interpolated(xs, ys, np.sin(xg) * np.cos(yg), x, y) - np.sin(x) * np.cos(y)).max()
        )
    assert errors[0] / errors[1] > 6.5


def test_unknown_nodes_spoil_only_what_they_touch():
    field = quadratic(*GRID)
    field[8, 16] = np.nan
    near = interpolated(X, Y, field, X[16:17] + 0.1, Y[8:9] + 0.1)
    beside = interpolated(X, Y, field, X[17:18] + 0.1, Y[8:9] + 0.1)
    assert np.isnan(near).all()
    assert beside == pytest.approx(quadratic(X[17] + 0.1, Y[8] + 0.1), abs=0.02)  # linear: h^2 k / 8
    far = interpolated(X, Y, field, np.array([7.0, np.nan]), np.array([1.0, 1.0]))
    assert np.isnan(far).all()


def test_continuation_keeps_known_nodes_and_never_leaves_their_range():
    field = np.where(np.hypot(GRID[0] - 1.0, GRID[1] - 2.0) < 1.5, quadratic(*GRID), np.nan)
    field[8, 16] = np.nan
    full = continued(field)
    known = np.isfinite(field)
    np.testing.assert_array_equal(full[known], field[known])
    assert full.min() >= field[known].min()
    assert full.max() <= field[known].max()


def test_a_hole_in_a_slope_is_bridged_by_the_slope():
    field = 0.5 * GRID[0] + 0.25 * GRID[1]
    hole = np.hypot(GRID[0] - 1.0, GRID[1] - 2.0) < 1.0
    full = continued(np.where(hole, np.nan, field))
    assert np.abs(full - field).max() < 0.01  # a linear field is harmonic; the range over the hole is 1.1


def test_a_complete_field_is_returned_as_a_copy():
    field = quadratic(*GRID)
    full = continued(field)
    np.testing.assert_array_equal(full, field)
    assert full is not field
