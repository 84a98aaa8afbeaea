"""What noise adds to a largest value, against simulation and against closed forms."""

import numpy as np
import pytest

from cmm_align.numerics.extreme_value import largest_excess


def simulated(field, sigma, lower, upper, n=4000):
    e = field + sigma * np.random.default_rng(5).standard_normal((n, len(field)))
    top = np.maximum(e - upper, lower - e).max(axis=1)
    return top.mean(), top.std()


@pytest.mark.parametrize(
    ("lower", "upper"), [(-np.inf, 0.0), (0.0, 0.0), (-1.0, 0.5)], ids=["largest", "profile", "band"]
)
@pytest.mark.parametrize("spread", [0.0, 0.5, 3.0])
def test_mean_and_spread_are_those_of_many_repetitions(lower, upper, spread):
    rng = np.random.default_rng(1)
    field, sigma = spread * rng.standard_normal(400), rng.uniform(0.2, 0.4, 400)
    mean, sd = simulated(field, sigma, lower, upper)
    found = largest_excess(field, sigma, lower, upper)
    assert found.bare == np.maximum(field - upper, lower - field).max()
    assert found.mean == pytest.approx(mean, abs=4 * sd / np.sqrt(4000) + 0.004)
    assert found.sd == pytest.approx(sd, rel=0.06)  # 4000 repetitions tell it to 1 %, the grid of t to 3 %


def test_the_largest_of_many_alike_is_that_of_order_statistics():
    # E of the largest of 10^5 standard normals: 4.384 (Gumbel's second approximation, tables of Tippett)
    found = largest_excess(np.zeros(100_000), 1.0)
    assert found.mean == pytest.approx(4.384, abs=0.02)
    few = largest_excess(np.zeros(1000), 1.0, alike=1 / 100)
    assert few.mean == pytest.approx(found.mean, abs=0.01)


def test_no_noise_adds_nothing_and_limits_may_differ_from_value_to_value():
    field = np.array([1.0, -4.0, 2.0])
    assert largest_excess(field, 0.0) == (2.0, 2.0, 0.0)
    found = largest_excess(field, 1e-6, np.array([-9.0, -3.0, -9.0]), np.array([2.0, 9.0, np.inf]))
    assert found.bare == 1.0
    assert found.added == pytest.approx(0.0, abs=1e-6)
