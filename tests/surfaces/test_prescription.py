"""The TOML of a prescription: sums of terms, units, and what is refused."""

import numpy as np
import pytest

from cmm_align.errors import MalformedInputError
from cmm_align.surfaces.prescription import prescription_from_toml
from cmm_align.surfaces.terms import READERS, term_from_table

HEAD = """schema = "cmm-align/prescription/1"
{units}
[aperture]
shape = "circle"
radius = 20.0
"""
CONIC = """[[term]]
kind = "conic"
radius = 60.0
conic = -0.5
"""
ZERNIKE = """[[term]]
kind = "zernike"
convention = "fringe"
normalization_radius = 20.0
coefficients = { "5" = 0.02, "8" = 0.01 }
tilt_deg = [1.0, 0.0, 0.0]
"""


def surface(*terms, units=""):
    return prescription_from_toml(HEAD.format(units=units) + "".join(terms), "lens.toml")


def test_the_sag_is_the_sum_of_the_terms(rng):
    x, y = rng.uniform(-14, 14, (2, 100))

    both = surface(CONIC, ZERNIKE).jet(x, y)
    parts = [surface(CONIC).jet(x, y), surface(ZERNIKE).jet(x, y)]

    for total, a, b in zip(both, *parts, strict=True):
        np.testing.assert_array_equal(total, a + b)


def test_a_prescription_in_inches_is_the_same_surface_in_mm(rng):
    x, y = rng.uniform(-14, 14, (2, 100))
    one, other = surface(CONIC, units='units = "inch"'), surface(CONIC)

    inches, mm = one.jet(25.4 * x, 25.4 * y), other.jet(x, y)

    np.testing.assert_allclose(inches.z, 25.4 * mm.z, rtol=1e-14)
    np.testing.assert_allclose(inches.zx, mm.zx, rtol=1e-13)
    np.testing.assert_allclose(inches.zxx, mm.zxx / 25.4, rtol=1e-14)
    assert one.bounds.x_max == pytest.approx(25.4 * other.bounds.x_max)


CIRCLE = {"normalization_radius": 10.0}
WRONG = [
    ({"kind": "zernicke"}, "did you mean 'zernike'"),
    ({"kind": "Q_bfs"}, "did you mean 'q_bfs'"),
    ({}, "one of conic, even_asphere"),
    ({"kind": "conic", "radius": 5.0, "konic": 1.0}, "did you mean 'conic'"),
    ({"kind": "conic", "radius": 5.0, "decenter": [1.0, 2.0]}, "did you mean 'decentre'"),
    ({"kind": "conic", "radius": 5.0, "tilt": [1.0, 2.0, 3.0]}, "did you mean 'tilt_deg'"),
    ({"kind": "conic", "radius": 5.0, "tilt_deg": [1.0, 2.0]}, "a list of 3 numbers"),
    ({"kind": "conic", "radius": 5.0, "tilt_deg": [0.0, 120.0, 0.0]}, "upwards"),
    ({"kind": "conic", "radius": 5.0, "decentre": 3.0}, "a list of 2 numbers"),
    ({"kind": "conic", "radius": 5.0, "curvature": 0.2}, "one of the two"),
    ({"kind": "conic"}, "radius or curvature"),
    ({"kind": "conic", "radius": 0.0}, "not zero"),
    ({"kind": "conic", "radius": True}, "a number"),
    ({"kind": "even_asphere", "coefficients": {"5": 1.0}}, "an index of 2, 4 ... 200"),
    ({"kind": "even_asphere", "coefficients": {"A4": 1.0}}, "an index of 2, 4 ... 200"),
    ({"kind": "even_asphere", "coefficients": {"4": "x"}}, "a number"),
    ({"kind": "even_asphere", "coefficients": {"4": float("nan")}}, "a number"),
    ({"kind": "even_asphere", "coefficients": {"4": 1.0, "04": 2.0}}, "given twice"),
    ({"kind": "even_asphere", "conic": 1.0, "coefficients": {"4": 1.0}}, "radius or curvature"),
    ({"kind": "even_asphere"}, "no coefficients"),
    ({"kind": "odd_asphere", "coefficients": {"0": 1.0}}, "an index of 1, 2 ... 200"),
    ({"kind": "odd_asphere", "coefficients": {"999999999": 1.0}}, "an index of 1, 2 ... 200"),
    ({"kind": "biconic"}, "at least one"),
    ({"kind": "biconic", "radius": 1.0}, "did you mean 'radius_"),
    ({"kind": "toroid", "radius": 1.0}, "radius_of_rotation"),
    ({"kind": "toroid", "radius_of_rotation": 0.0, "radius": 1.0}, "not zero"),
    ({"kind": "xy_polynomial", "coefficients": {"1": 1.0}}, "two integers"),
    ({"kind": "xy_polynomial", "coefficients": {"1,-2": 1.0}}, "two integers"),
    ({"kind": "xy_polynomial", "coefficients": {"1,2": 1.0, "1, 2": 1.0}}, "given twice"),
    ({"kind": "chebyshev", "half_width": 1.0, "coefficients": {"1,0": 1.0}}, "half_height is missing"),
    ({"kind": "legendre", "half_width": -1.0, "half_height": 1.0, "coefficients": {"1,0": 1.0}}, "> 0"),
    ({"kind": "zernike", "coefficients": {"4": 1.0}, **CIRCLE}, '"noll" or "fringe"'),
    ({"kind": "zernike", "convention": "Nol", "coefficients": {"4": 1.0}, **CIRCLE}, "did you mean 'noll'"),
    ({"kind": "zernike", "convention": ["noll"], "coefficients": {"4": 1.0}, **CIRCLE}, "unknown convention"),
    ({"kind": "zernike", "convention": "fringe", "coefficients": {"38": 1.0}, **CIRCLE}, "1, 2 ... 37"),
    (
        {"kind": "zernike", "convention": "noll", "coefficients": {"4": 1.0}},
        "normalization_radius is missing",
    ),
    ({"kind": "q_bfs", "coefficients": {"-1": 1.0}, **CIRCLE}, "an index of 0, 1 ... 200"),
    ({"kind": "q_con", "coefficients": {}, **CIRCLE}, "no coefficients"),
    ({"kind": "q_2d", "coefficients": {"c1,0": 1.0}, **CIRCLE}, '"am,n"'),
    ({"kind": "q_2d", "coefficients": {"b0,1": 1.0}, **CIRCLE}, '"am,n"'),
    ({"kind": "q_2d", "coefficients": {"a1,0": 1.0, "a01,0": 1.0}, **CIRCLE}, "given twice"),
]


@pytest.mark.parametrize(("table", "words"), WRONG, ids=lambda v: v if isinstance(v, str) else "")
def test_what_is_wrong_is_named_with_its_place_and_remedy(table, words):
    with pytest.raises(MalformedInputError) as caught:
        term_from_table(table, where="lens.toml:term[2]")

    assert words in str(caught.value)
    assert str(caught.value).startswith("lens.toml:term[2]")


@pytest.mark.parametrize("kind", READERS)
def test_every_kind_names_the_nearest_key(kind):
    with pytest.raises(MalformedInputError, match="did you mean 'tilt_deg'"):
        term_from_table({"kind": kind, "tilt_degg": [0, 0, 0]}, where="w")


@pytest.mark.parametrize("terms", ["term = [1]\n", "term = 3\n", "term = []\n"])
def test_terms_that_are_no_tables_are_refused(terms):
    text = terms + HEAD.format(units="")

    with pytest.raises(MalformedInputError, match="term"):
        prescription_from_toml(text, "lens.toml")
