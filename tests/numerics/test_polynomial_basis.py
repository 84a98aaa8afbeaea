"""The basis of the ladder: orthonormal on any mask, nested, power in true curvature."""

import numpy as np
import pytest

from cmm_align.numerics.polynomial_basis import n_terms, orthonormalised, rectangle_polynomials


def masked_places():
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(-51, 51, 61), np.linspace(-31, 31, 37)))
    keep = ((x / 51) ** 2 + (y / 31) ** 2 < 1.0) & (np.hypot(x - 10, y) > 8)
    return x[keep], y[keep]


def test_there_are_36_terms_up_to_degree_7():
    assert [n_terms(d) for d in (0, 1, 2, 3, 7)] == [1, 3, 6, 10, 36]


def test_columns_are_orthonormal_on_an_irregular_mask():
    x, y = masked_places()
    q = orthonormalised(rectangle_polynomials(x, y, 7))
    np.testing.assert_allclose(q.T @ q / len(x), np.eye(36), atol=1e-13)


def test_every_polynomial_of_degree_7_is_removed_and_lower_spaces_are_nested():
    x, y = masked_places()
    q = orthonormalised(rectangle_polynomials(x, y, 7))
    for degree, term in ((7, x**3 * y**4 / 1e9), (3, x * y**2 / 1e4), (2, x * y / 1e3), (1, x + 2 * y)):
        part = q[:, : n_terms(degree)]
        rest = term - part @ (part.T @ term) / len(x)
        assert np.abs(rest).max() < 1e-12 * np.abs(term).max()


def test_power_is_the_fourth_column_whatever_the_shape_of_the_rectangle():
    x, y = masked_places()
    q = orthonormalised(rectangle_polynomials(x, y, 2))[:, :4]
    power = (x**2 + y**2) / 1000.0
    assert np.abs(power - q @ (q.T @ power) / len(x)).max() < 1e-12 * power.max()
    astigmatism = (x**2 - y**2) / 1000.0
    assert np.abs(astigmatism - q @ (q.T @ astigmatism) / len(x)).max() > 0.1


def test_a_shape_that_the_places_cannot_tell_becomes_zero():
    x = np.linspace(-1.0, 1.0, 50)
    q = orthonormalised(rectangle_polynomials(x, np.zeros(50), 2))
    lengths = (q**2).mean(axis=0)
    assert lengths[[0, 1, 3]] == pytest.approx(1.0)
    assert lengths[[2, 4, 5]] == pytest.approx(0.0)
