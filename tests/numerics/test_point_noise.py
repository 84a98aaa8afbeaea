"""The noise of points, told by neighbours: white noise in full, waves and scratches not at all."""

import numpy as np
import pytest

from cmm_align.numerics.point_noise import near_sample, neighbour_noise


@pytest.mark.parametrize("n", [2000, 20_000, 100_000])
def test_white_noise_is_found_within_three_times_its_uncertainty(n):
    rng = np.random.default_rng(3)
    x, y = rng.uniform(0, 100, n), rng.uniform(0, 60, n)
    noise = 0.3 * rng.standard_normal(n)
    near = near_sample(x, y)
    assert len(near) <= 30_000
    found = neighbour_noise(x[near], y[near], noise[near])
    assert found.sd**2 == pytest.approx(0.09, rel=3 * found.relative_u)
    assert found.relative_u < 0.08


def test_a_wave_much_longer_than_the_distance_of_neighbours_is_no_noise_nor_is_a_scratch():
    rng = np.random.default_rng(4)
    x, y = rng.uniform(0, 100, 20_000), rng.uniform(0, 60, 20_000)
    noise = 0.1 * rng.standard_normal(20_000)
    scratch = 5.0 * (np.abs(y - 30.0) < 0.3)
    waves = np.sin(x / 6.0)  # 38 long, neighbours are 0.27 apart: the wave differs by 0.03 between them
    assert neighbour_noise(x, y, noise + waves + scratch).sd == pytest.approx(0.1, rel=0.1)
    assert np.std(waves) > 0.65


def test_places_that_coincide_are_pairs_and_too_few_points_tell_nothing():
    x = np.repeat(np.arange(50.0), 2)
    r = np.tile([0.1, -0.1], 50)
    assert neighbour_noise(x, np.zeros(100), r).sd == pytest.approx(0.2 / np.sqrt(2 * 0.4549), rel=1e-3)
    assert np.isnan(neighbour_noise(x[:20], np.zeros(20), r[:20]).sd)
