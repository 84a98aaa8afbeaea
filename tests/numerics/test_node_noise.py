"""The noise of nodes against brute force, and how many tests stand out by chance."""

import numpy as np
import pytest

from cmm_align.numerics.local_regression import local_regression
from cmm_align.numerics.node_noise import (
    discoveries,
    effective_number,
    node_correlation,
    noise_power,
    without_longest,
)


@pytest.mark.parametrize("half_width", [1.5, 2.5])
def test_correlation_is_that_of_local_quadratics_over_a_dense_lattice(half_width):
    per_step, reach = 12, int(half_width)
    width = (2 * reach + 1) * per_step
    u = (np.arange(width) + 0.5) / per_step - (reach + 0.5)
    x, y = (a.ravel() for a in np.meshgrid(u, u))
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y])
    kernel = np.linalg.pinv(terms.T)[0].reshape(width, width)  # the value at the node
    lags = np.arange(2 * reach + 2)
    table = np.zeros((len(lags), len(lags)))
    for j in lags:
        for i in lags:
            dy, dx = j * per_step, i * per_step
            high, wide = max(width - dy, 0), max(width - dx, 0)
            table[j, i] = np.sum(kernel[dy:, dx:] * kernel[:high, :wide])
    table /= table[0, 0]
    found = node_correlation(lags.astype(float), lags.astype(float), half_width=half_width)
    np.testing.assert_allclose(found, table, atol=0.02)  # the lattice has 12 points a step
    assert found[0, 0] == pytest.approx(1.0, rel=1e-14)
    assert np.abs(found[-1]).max() == 0.0


def test_mean_square_and_freedom_of_a_map_of_noise_are_those_predicted(rng):
    nodes_x, nodes_y = np.arange(40.0), np.arange(30.0)
    squares = []
    for _ in range(60):
        x, y = rng.uniform(-0.5, 39.5, 6000), rng.uniform(-0.5, 29.5, 6000)
        fit = local_regression(x, y, rng.standard_normal(6000), nodes_x, nodes_y)
        squares.append(np.mean((fit.value / fit.sigma)[2:-2, 2:-2] ** 2))
    nu = effective_number(noise_power((26, 36)), 26 * 36)
    assert np.mean(squares) == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / nu / 60) + 0.02)
    assert np.std(squares) == pytest.approx(np.sqrt(2.0 / nu), rel=4.0 / np.sqrt(2 * 60))


def test_power_is_of_mean_one_and_loses_its_longest_waves_first():
    power = noise_power((20, 30))
    assert power.mean() == pytest.approx(1.0)
    assert power[0, 0] == pytest.approx(power.max(), rel=0.3)
    rest = without_longest(power, 9)
    gone = np.argwhere((rest == 0.0) & (power > 0.0))
    assert {(int(j), int(i)) for j, i in gone} == {(j % 20, i % 30) for j in (-1, 0, 1) for i in (-1, 0, 1)}


def test_discoveries_of_independent_tests_are_false_at_the_rate_that_was_asked_for(rng):
    any_found = [discoveries(rng.uniform(size=500), 0.05).any() for _ in range(2000)]
    assert np.mean(any_found) == pytest.approx(0.05, abs=4.0 * np.sqrt(0.05 * 0.95 / 2000))
    p = np.concatenate([np.full(50, 1e-9), rng.uniform(0.2, 1.0, 450)])
    found = discoveries(p, 0.05)
    assert found[:50].all()
    assert not found[50:].any()
