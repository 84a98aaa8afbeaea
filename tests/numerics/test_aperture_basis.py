"""The basis of low orders: shape of the mask, orthonormal on any mask, nested, the right polynomials."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.polynomial import polynomial

from cmm_align.numerics.aperture_basis import (
    KINDS,
    low_order_shapes,
    node_widths,
    orthonormalised,
    outline_of,
    zernike,
)
from cmm_align.numerics.handed_noise import handed_noise
from cmm_align.numerics.local_regression import local_regression

X = np.linspace(-40.0, 40.0, 81)
XG, YG = np.meshgrid(X, X)
R = np.hypot(XG, YG)
MASKS = {
    "round": R <= 40.0,
    "annular": (R <= 40.0) & (R >= 15.0),
    "rectangular": np.abs(YG) <= 25.0,
    "irregular": (XG < 10.0) | (YG < 5.0),
}


@pytest.mark.parametrize("shape", MASKS)
def test_the_shape_of_the_mask_chooses_the_polynomials(shape):
    outline = outline_of(X, X, MASKS[shape])
    family = low_order_shapes(outline, XG[MASKS[shape]], YG[MASKS[shape]]).family
    assert outline.shape == shape
    assert ("Zernike" in family) == (shape in {"round", "annular"})
    assert outline.half[0] == 40.0


def test_a_hole_that_was_not_measured_leaves_the_shape_as_it_is():
    hole = np.hypot(XG - 15.0, YG) > 8.0
    assert outline_of(X, X, MASKS["round"] & hole).shape == "round"
    assert outline_of(X, X, MASKS["rectangular"] & hole).shape == "rectangular"
    assert outline_of(X, X, (XG / 40.0) ** 2 + (YG / 20.0) ** 2 <= 1.0).shape == "irregular"


@pytest.mark.parametrize("shape", MASKS)
def test_36_columns_are_orthonormal_on_any_mask(shape):
    known = MASKS[shape]
    x, y = XG[known], YG[known]
    shapes = low_order_shapes(outline_of(X, X, known), x, y)
    q, fresh = orthonormalised(shapes.columns)
    assert len(set(shapes.names)) == 36
    assert fresh.all()
    np.testing.assert_allclose(q.T @ q / len(x), np.eye(36), atol=1e-13)


@pytest.mark.parametrize("shape", ["rectangular", "irregular"])
def test_legendre_with_kinds_spans_all_polynomials_to_degree_7(shape):
    known = MASKS[shape]
    x, y = XG[known] / 40.0, YG[known] / 40.0
    q, _ = orthonormalised(low_order_shapes(outline_of(X, X, known), XG[known], YG[known]).columns)
    for i in range(8):
        for j in range(8 - i):
            monomial = x**i * y**j
            rest = monomial - q @ (q.T @ monomial) / len(x)
            assert np.abs(rest).max() < 1e-11


def test_zernike_polynomials_are_those_of_the_books():
    u, v = np.random.default_rng(1).uniform(-0.7, 0.7, (2, 50))
    r, t = np.hypot(u, v), np.arctan2(v, u)
    radial = {  # Born & Wolf, table 9.1: powers of r from 0
        (4, 0): [1, 0, -6, 0, 6],
        (3, 1): [0, -2, 0, 3],
        (5, -1): [0, 3, 0, -12, 0, 10],
        (6, 4): [0, 0, 0, 0, -5, 0, 6],
        (5, -5): [0, 0, 0, 0, 0, 1],
        (8, 0): [1, 0, -20, 0, 90, 0, -140, 0, 70],
    }
    for (n, m), powers in radial.items():
        around = np.sin(-m * t) if m < 0 else np.cos(m * t)
        np.testing.assert_allclose(zernike(n, m, u, v), polynomial.polyval(r, powers) * around, atol=1e-13)


def test_on_a_full_disk_zernike_has_its_textbook_rms_and_is_all_but_orthogonal():
    x = np.linspace(-1.0, 1.0, 801)
    u, v = (a.ravel() for a in np.meshgrid(x, x))
    inside = u**2 + v**2 <= 1.0
    u, v = u[inside], v[inside]
    pairs = [pair for _, members in KINDS for pair in members]
    columns = np.stack([zernike(n, m, u, v) for n, m in pairs], axis=1)
    gram = columns.T @ columns / len(u)
    expected = [1.0 / ((n + 1) * (2 if m else 1)) for n, m in pairs]  # Noll 1976, eq. 1
    np.testing.assert_allclose(gram, np.diag(expected), atol=2e-3)  # of the order of a step, 1/400


def test_dependent_columns_become_zero_and_cost_the_others_nothing():
    rng = np.random.default_rng(2)
    a, b, c = rng.normal(size=(3, 200))
    q, fresh = orthonormalised(np.stack([a, 0 * a, 2 * a, b, a - b, a + 1e-6 * c, c], axis=1))
    assert fresh.tolist() == [True, False, False, True, False, False, True]
    assert not q[:, ~fresh].any()
    for field in (a, b, c):
        np.testing.assert_allclose(field, q @ (q.T @ field) / 200, atol=1e-12)


def test_it_is_a_qr_in_the_order_given():
    columns = np.random.default_rng(3).normal(size=(300, 8)) + 5.0
    expected, triangle = np.linalg.qr(columns)
    q, _ = orthonormalised(columns)
    np.testing.assert_allclose(q, expected * np.sign(np.diag(triangle)) * np.sqrt(300), atol=1e-12)


def test_outer_nodes_stand_for_what_lies_between_them_and_the_end_of_the_data():
    nodes = np.linspace(1.0, 9.0, 5)
    np.testing.assert_allclose(node_widths(nodes, 0.5, 9.5), [0.75, 1, 1, 1, 0.75])
    np.testing.assert_allclose(node_widths(nodes, 1.0, 12.0), [0.5, 1, 1, 1, 1])
    assert 2.0 * node_widths(nodes, 0.5, 9.5).sum() == pytest.approx(9.0)


@pytest.mark.parametrize("lines", [False, True], ids=["at random", "on lines"])
def test_handed_noise_is_the_variance_that_unit_errors_of_single_points_give(lines):
    rng = np.random.default_rng(4)
    x, y = rng.uniform(0.0, 10.0, (2, 260))
    if lines:
        y = np.round(y * 1.2) / 1.2
    nodes = np.linspace(0.3, 9.7, 9)
    base = local_regression(x, y, np.zeros(260), nodes, nodes)
    known = np.isfinite(base.value) & (np.hypot(*np.meshgrid(nodes - 5.0, nodes - 5.0)) < 5.2)
    fit = replace(base, sigma=np.sqrt(np.maximum(base.leverage, 0.0)))  # points of variance 1
    influence = np.stack([local_regression(x, y, e, nodes, nodes).value[known] for e in np.eye(260)])
    found = handed_noise(fit, known)[known]
    assert np.count_nonzero(~known) > 0
    assert found.sum() == pytest.approx(np.sum(influence.sum(axis=1) ** 2), rel=1e-9)
    slow = (np.meshgrid(nodes, nodes)[0][known] - 5.0) / 5.0  # changes by a third within a window
    assert slow**2 @ found == pytest.approx(np.sum((influence @ slow) ** 2), rel=0.05)
