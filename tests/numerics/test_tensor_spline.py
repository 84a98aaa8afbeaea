import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from cmm_align.errors import NumericsError
from cmm_align.numerics.tensor_spline import (
    basis,
    interpolating_coefficients,
    smoothed_coefficients,
    spline_jet,
)


@pytest.mark.parametrize("degree", [3, 5])
def test_b_splines_sum_to_one_and_their_derivatives_to_zero(degree):
    value, first, second = basis(np.linspace(0, 1, 11), degree)

    np.testing.assert_allclose(sum(value), 1.0, rtol=1e-14)
    np.testing.assert_allclose(sum(first), 0.0, atol=1e-14)
    np.testing.assert_allclose(sum(second), 0.0, atol=1e-14)


@pytest.mark.parametrize("degree", [3, 5])
def test_interpolation_reproduces_polynomials_up_to_the_border(degree):
    rng = np.random.default_rng(1)
    c = rng.normal(size=(degree + 1, degree + 1))

    def poly(u, v):
        return np.polynomial.polynomial.polyval2d(*np.broadcast_arrays(u / 12.0, v / 9.0), c)

    values = poly(np.arange(13.0)[None, :], np.arange(10.0)[:, None])
    coefficients = interpolating_coefficients(values, degree)
    u, v = rng.uniform(0, 12, 300), rng.uniform(0, 9, 300)

    jet = spline_jet(coefficients, degree, u, v)

    np.testing.assert_allclose(jet.z, poly(u, v), atol=1e-12)
    h = 1e-5
    np.testing.assert_allclose(jet.zu, (poly(u + h, v) - poly(u - h, v)) / (2 * h), atol=1e-7)
    np.testing.assert_allclose(jet.zv, (poly(u, v + h) - poly(u, v - h)) / (2 * h), atol=1e-7)


def test_it_is_the_not_a_knot_spline_of_scipy():
    values = np.random.default_rng(2).normal(size=(9, 40))
    u = np.linspace(0, 39, 501)
    ours = spline_jet(interpolating_coefficients(values, 3), 3, u, np.full(501, 4.0))
    theirs = make_interp_spline(np.arange(40.0), values[4], k=3)

    np.testing.assert_allclose(ours.z, theirs(u), atol=1e-12)
    np.testing.assert_allclose(ours.zu, theirs(u, 1), atol=1e-11)
    np.testing.assert_allclose(ours.zuu, theirs(u, 2), atol=1e-10)


def test_second_derivatives_agree_with_finite_differences():
    coefficients = np.random.default_rng(3).normal(size=(14, 17))
    rng = np.random.default_rng(4)
    u, v = rng.uniform(0.1, 11.9, 100), rng.uniform(0.1, 8.9, 100)
    h = 1e-6

    def jet(du, dv):
        return spline_jet(coefficients, 5, u + du, v + dv)

    np.testing.assert_allclose(jet(0, 0).zuu, (jet(h, 0).zu - jet(-h, 0).zu) / (2 * h), atol=1e-6)
    np.testing.assert_allclose(jet(0, 0).zuv, (jet(0, h).zu - jet(0, -h).zu) / (2 * h), atol=1e-6)
    np.testing.assert_allclose(jet(0, 0).zvv, (jet(0, h).zv - jet(0, -h).zv) / (2 * h), atol=1e-6)


def test_smoothing_a_grid_reproduces_a_spline_of_fewer_cells_and_averages_noise():
    rng = np.random.default_rng(8)
    truth = rng.normal(size=(6 + 5, 9 + 5))
    v, u = (a.ravel() for a in np.meshgrid(np.linspace(0, 6, 61), np.linspace(0, 9, 91), indexing="ij"))
    values = spline_jet(truth, 5, u, v).z.reshape(61, 91)

    exact = smoothed_coefficients(values, (6, 9), 5)
    noisy = smoothed_coefficients(values + rng.normal(0, 1e-3, values.shape), (6, 9), 5)

    np.testing.assert_allclose(spline_jet(exact, 5, u, v).z, values.ravel(), atol=1e-10)
    rest = spline_jet(noisy, 5, u, v).z - values.ravel()
    # A fit of p coefficients to n values keeps sqrt(p/n) of the noise.
    assert np.sqrt(np.mean(rest**2)) == pytest.approx(1e-3 * np.sqrt(truth.size / values.size), rel=0.15)


def test_too_few_knots_are_refused():
    with pytest.raises(NumericsError, match="too few"):
        interpolating_coefficients(np.zeros((4, 30)), 3)
