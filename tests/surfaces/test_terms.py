"""Every family of terms: against 60-digit values, finite differences, and its neighbours."""

import csv
import tomllib
from collections import defaultdict
from pathlib import Path

import closed_forms as cf
import numpy as np
import pytest

from cmm_align.surfaces.terms import READERS, term_from_table

REFERENCE = Path(__file__).resolve().parents[1] / "reference"
CASES = {
    case["name"]: case
    for case in tomllib.loads((REFERENCE / "terms.toml").read_text(encoding="utf-8"))["case"]
}
EPS = np.finfo(float).eps


def reference_values():
    values = defaultdict(list)
    with (REFERENCE / "terms.csv").open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            values[row.pop("case")].append([float(value) for value in row.values()])
    return {name: np.array(rows).T for name, rows in values.items()}


VALUES = reference_values()


def test_there_is_a_case_for_every_kind_and_values_for_every_case():
    assert {case["term"]["kind"] for case in CASES.values()} == set(READERS)
    assert set(VALUES) == set(CASES)


@pytest.mark.parametrize("name", CASES)
def test_jets_are_those_of_the_definition_in_60_digits(name):
    x, y, *wanted = VALUES[name]

    found = term_from_table(CASES[name]["term"], where=name).jet(x, y)

    # Some tens of roundings of the largest value of each order of derivative; 1e-13 is what is promised.
    orders = [[0], [1, 2], [1, 2], [3, 4, 5], [3, 4, 5], [3, 4, 5]]
    for k, order in enumerate(orders):
        size = max(np.abs(wanted[i]).max() for i in order)
        np.testing.assert_allclose(found[k], wanted[k], rtol=0.0, atol=30 * EPS * size)


@pytest.mark.parametrize("name", CASES)
def test_height_is_good_to_a_millionth_of_a_nanometre(name):
    x, y, z, *_ = VALUES[name]

    found = term_from_table(CASES[name]["term"], where=name).jet(x, y).z

    assert np.abs(found - z).max() <= 1e-12  # mm


PLACED = [
    (name, vertex)
    for name in CASES
    for vertex in (False, True)
    if (name, vertex) != ("odd_asphere_cone", True)
]
"""A cone has no normal at its tip."""


@pytest.mark.parametrize(("name", "at_the_vertex"), PLACED)
def test_gradient_and_hessian_agree_with_finite_differences(name, at_the_vertex, rng):
    term, half = term_from_table(CASES[name]["term"], where=name), CASES[name]["half"]
    x, y = (np.zeros(1), np.zeros(1)) if at_the_vertex else rng.uniform(-half, half, (2, 60))

    exact, numeric = term.jet(x, y), cf.finite_difference_jet(term, x, y)

    # Truncation h^2/6 f''' and rounding eps |f| / h, h = 1e-4.
    np.testing.assert_allclose(exact.zx, numeric.zx, atol=1e-9)
    np.testing.assert_allclose(exact.zy, numeric.zy, atol=1e-9)
    # A third power has a Hessian with a kink at its vertex: there the difference is off by 3 h A_3.
    atol = 2e-8 if at_the_vertex and name == "odd_asphere" else 1e-9
    for a, b in zip(exact[3:], numeric[3:], strict=True):
        np.testing.assert_allclose(a, b, atol=atol)


@pytest.mark.parametrize("name", CASES)
def test_a_term_does_not_mind_how_many_places_there_are(name, rng):
    term, half = term_from_table(CASES[name]["term"], where=name), CASES[name]["half"]
    x, y = rng.uniform(-half, half, (2, 40))

    together = np.array(term.jet(x, y))
    single = np.array([np.array(term.jet(x[k : k + 1], y[k : k + 1]))[:, 0] for k in range(40)]).T

    # The same operations; vectorised loops may fuse a product and a sum.
    np.testing.assert_allclose(together, single, rtol=1e-12, atol=1e-15)
    assert np.shape(term.jet(x[:0], y[:0]).z) == (0,)


@pytest.mark.parametrize(
    ("kind", "keys"),
    [("conic", {}), ("q_bfs", {"normalization_radius": 1e3, "coefficients": {"0": 1.0}})],
)
def test_beyond_the_rim_of_a_sphere_there_is_no_height(kind, keys):
    term = term_from_table({"kind": kind, "radius": 10.0, **keys}, where="w")

    z = term.jet(np.array([9.9, 10.1]), np.zeros(2)).z

    assert np.isfinite(z[0])
    assert np.isnan(z[1])


def test_a_cone_is_not_defined_at_its_tip_only():
    term = term_from_table({"kind": "odd_asphere", "coefficients": {"1": 0.1}}, where="w")

    jet = term.jet(np.array([0.0, 1e-9]), np.zeros(2))

    assert np.isnan(jet.z[0])
    np.testing.assert_allclose([jet.z[1], jet.zx[1]], [1e-10, 0.1], rtol=1e-15)


def same(one, other, half=12.0, size=1e-3):
    x, y = np.random.default_rng(5).uniform(-half, half, (2, 100))
    for a, b in zip(one.jet(x, y), other.jet(x, y), strict=True):
        np.testing.assert_allclose(a, b, rtol=0.0, atol=20 * EPS * max(np.abs(b).max(), size))


def term(**table):
    return term_from_table(table, where="w")


def test_a_biconic_with_equal_sections_is_the_conic():
    same(
        term(kind="biconic", radius_x=-70.0, radius_y=-70.0, conic_x=0.3, conic_y=0.3),
        term(kind="conic", radius=-70.0, conic=0.3),
    )


def test_a_toroid_turned_about_its_centre_of_curvature_is_the_sphere():
    same(term(kind="toroid", radius_of_rotation=40.0, radius=40.0), term(kind="conic", radius=40.0))


def test_a_toroid_is_the_closed_form_torus():
    same(
        term(kind="toroid", radius_of_rotation=-120.0, radius=-40.0),
        cf.Torus(major_mm=80.0, minor_mm=40.0),
        size=120.0,  # the closed form subtracts its radius
    )


def test_a_toroid_swept_along_a_line_is_the_biconic_without_radius_x():
    same(
        term(kind="toroid", curvature_of_rotation=0.0, radius=30.0, conic=-2.0),
        term(kind="biconic", radius_y=30.0, conic_y=-2.0),
    )


def test_an_odd_asphere_of_even_powers_is_the_even_asphere():
    powers = {"4": 1e-5, "8": -1e-10}
    same(
        term(kind="odd_asphere", radius=50.0, conic=-1.0, coefficients=powers),
        term(kind="even_asphere", radius=50.0, conic=-1.0, coefficients=powers),
    )


def test_even_powers_are_those_of_the_xy_polynomial():
    same(
        term(kind="even_asphere", coefficients={"4": 1e-4}),
        term(kind="xy_polynomial", coefficients={"4,0": 1e-4, "2,2": 2e-4, "0,4": 1e-4}),
    )


def test_a_conic_base_of_curvature_zero_is_a_plane():
    same(
        term(kind="q_con", curvature=0.0, conic=-1.0, normalization_radius=20.0, coefficients={"1": 0.1}),
        term(kind="q_con", normalization_radius=20.0, coefficients={"1": 0.1}),
    )
