import numpy as np
import pytest

from cmm_align.numerics.scattered_spline import fitted_coefficients
from cmm_align.numerics.tensor_spline import basis, spline_jet


@pytest.mark.parametrize("cells", [(6, 9), (9, 6)], ids=["wide", "tall"])
def test_a_fit_returns_the_spline_that_made_the_points(cells):
    rng = np.random.default_rng(5)
    truth = rng.normal(size=(cells[0] + 5, cells[1] + 5))
    u, v = rng.uniform(0, cells[1], 20_000), rng.uniform(0, cells[0], 20_000)
    z = spline_jet(truth, 5, u, v).z

    fitted = fitted_coefficients(u, v, z, cells, 5)

    np.testing.assert_allclose(spline_jet(fitted, 5, u, v).z, z, atol=1e-9)


def test_a_fit_is_the_least_squares_solution():
    rng = np.random.default_rng(6)
    u, v, z = rng.uniform(0, 4, 800), rng.uniform(0, 3, 800), rng.normal(size=800)
    bu, bv = basis(u - np.minimum(u.astype(int), 3), 3)[0], basis(v - np.minimum(v.astype(int), 2), 3)[0]
    rows = np.zeros((800, 6 * 7))
    for j in range(4):
        for i in range(4):
            column = (np.minimum(v.astype(int), 2) + j) * 7 + np.minimum(u.astype(int), 3) + i
            rows[np.arange(800), column] = bv[j] * bu[i]
    dense = np.linalg.lstsq(rows, z, rcond=None)[0]

    fitted = fitted_coefficients(u, v, z, (3, 4), 3)

    np.testing.assert_allclose(rows @ fitted.ravel(), rows @ dense, atol=1e-7)


def test_cells_without_points_are_carried_smoothly():
    rng = np.random.default_rng(7)
    u, v = rng.uniform(0, 20, (2, 20_000))
    away = np.hypot(u - 10, v - 10) > 3.0

    def height(a, b):
        return 0.01 * (a - 9) ** 2 - 0.02 * a * b

    fitted = fitted_coefficients(u[away], v[away], height(u, v)[away], (20, 20), 5)

    np.testing.assert_allclose(spline_jet(fitted, 5, u, v).z, height(u, v), atol=1e-6)
