import numpy as np

from cmm_align.numerics.outliers import outlier_rule, outliers


def cloud(n=6000, seed=1):
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-50, 50, n), rng.uniform(-30, 30, n)
    return x, y, 0.004 * np.sin(x / 15.0) + rng.normal(0.0, 3e-4, n)


def test_clean_points_have_no_outliers():
    x, y, e = cloud()

    assert not outliers(outlier_rule(x, y, e, 1e-9), x, y, e).any()


def test_a_high_bump_is_form_and_a_single_spike_is_not():
    x, y, e = cloud()
    bump = 0.05 * np.exp(-((x - 10) ** 2 + y**2) / 30.0)
    spike = np.zeros(len(x))
    spike[::500] = 0.05
    rule = outlier_rule(x, y, e + bump, 1e-9)

    assert not outliers(rule, x, y, e + bump).any()
    np.testing.assert_array_equal(outliers(rule, x, y, e + bump + spike), spike > 0)


def test_a_third_of_gross_errors_is_found_whole():
    x, y, e = cloud()
    wrong = np.random.default_rng(2).permutation(len(x)) < 0.3 * len(x)
    e = e + np.where(wrong, np.random.default_rng(3).uniform(0.1, 5.0, len(x)), 0.0)

    found = outliers(outlier_rule(x, y, e, 1e-9), x, y, e)

    assert not found[~wrong].any()
    assert found[wrong].mean() > 0.995  # one may hide in a cell that is mostly wrong


def test_touches_of_a_fixture_are_gross_in_any_company():
    x, y, e = cloud()
    fixture = (x > 40) & (y > 20)
    e = e + np.where(fixture, 2.0, 0.0)

    np.testing.assert_array_equal(outliers(outlier_rule(x, y, e, 1e-9), x, y, e), fixture)


def test_equal_deviations_do_not_divide_by_zero():
    x, y, _ = cloud(50)

    assert not outliers(outlier_rule(x, y, np.zeros(50), 1e-9), x, y, np.zeros(50)).any()
