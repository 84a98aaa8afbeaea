"""The orthogonal families: published polynomials, orthogonality, and the values of another program."""

import csv
from pathlib import Path

import numpy as np
import pytest

from cmm_align.surfaces.terms import term_from_table
from cmm_align.surfaces.terms.zernike import degrees

REFERENCE = Path(__file__).resolve().parents[1] / "reference"
GRID = np.random.default_rng(6).uniform(-0.7, 0.7, (2, 50))
RADIUS, ANGLE = np.hypot(*GRID), np.arctan2(GRID[1], GRID[0])


def one(kind, key, **keys):
    """A single polynomial of unit coefficient over the unit disk."""
    table = {"kind": kind, "normalization_radius": 1.0, "coefficients": {key: 1.0}, **keys}
    return term_from_table(table, where="w")


# Noll 1976, table I (see tests/reference/SOURCE.md).
NOLL = {
    1: lambda r, t: 1.0 + 0.0 * r,
    2: lambda r, t: 2.0 * r * np.cos(t),
    3: lambda r, t: 2.0 * r * np.sin(t),
    4: lambda r, t: np.sqrt(3.0) * (2 * r**2 - 1),
    5: lambda r, t: np.sqrt(6.0) * r**2 * np.sin(2 * t),
    6: lambda r, t: np.sqrt(6.0) * r**2 * np.cos(2 * t),
    7: lambda r, t: np.sqrt(8.0) * (3 * r**3 - 2 * r) * np.sin(t),
    8: lambda r, t: np.sqrt(8.0) * (3 * r**3 - 2 * r) * np.cos(t),
    9: lambda r, t: np.sqrt(8.0) * r**3 * np.sin(3 * t),
    10: lambda r, t: np.sqrt(8.0) * r**3 * np.cos(3 * t),
    11: lambda r, t: np.sqrt(5.0) * (6 * r**4 - 6 * r**2 + 1),
    12: lambda r, t: np.sqrt(10.0) * (4 * r**4 - 3 * r**2) * np.cos(2 * t),
    13: lambda r, t: np.sqrt(10.0) * (4 * r**4 - 3 * r**2) * np.sin(2 * t),
    14: lambda r, t: np.sqrt(10.0) * r**4 * np.cos(4 * t),
    15: lambda r, t: np.sqrt(10.0) * r**4 * np.sin(4 * t),
}
# Opt. Express 20, 15928 (2012), table 2.
FRINGE = {
    1: lambda r, t: 1.0 + 0.0 * r,
    2: lambda r, t: r * np.cos(t),
    3: lambda r, t: r * np.sin(t),
    4: lambda r, t: 2 * r**2 - 1,
    5: lambda r, t: r**2 * np.cos(2 * t),
    6: lambda r, t: r**2 * np.sin(2 * t),
    7: lambda r, t: (3 * r**3 - 2 * r) * np.cos(t),
    8: lambda r, t: (3 * r**3 - 2 * r) * np.sin(t),
    9: lambda r, t: 6 * r**4 - 6 * r**2 + 1,
    16: lambda r, t: 20 * r**6 - 30 * r**4 + 12 * r**2 - 1,
    25: lambda r, t: 70 * r**8 - 140 * r**6 + 90 * r**4 - 20 * r**2 + 1,
    36: lambda r, t: 252 * r**10 - 630 * r**8 + 560 * r**6 - 210 * r**4 + 30 * r**2 - 1,
    37: lambda r, t: 924 * r**12 - 2772 * r**10 + 3150 * r**8 - 1680 * r**6 + 420 * r**4 - 42 * r**2 + 1,
}
PUBLISHED_ZERNIKE = [("noll", j, f) for j, f in NOLL.items()] + [("fringe", j, f) for j, f in FRINGE.items()]


@pytest.mark.parametrize(
    ("convention", "j", "published"), PUBLISHED_ZERNIKE, ids=lambda v: str(v) if not callable(v) else ""
)
def test_zernike_polynomials_are_the_published_ones(convention, j, published):
    found = one("zernike", str(j), convention=convention).jet(*GRID).z

    np.testing.assert_allclose(found, published(RADIUS, ANGLE), atol=1e-12)


@pytest.mark.parametrize("convention", ["noll", "fringe"])
def test_an_index_names_one_polynomial_each(convention):
    named = [degrees(convention, j) for j in range(1, 38)]

    assert len(set(named)) == 37
    assert all(n >= m and (n - m) % 2 == 0 and (m > 0 or not sine) for n, m, sine in named)


def disk_quadrature(radial, angular):
    """Nodes and weights of mean values over the unit disk: Gauss in r^2, equal steps in angle."""
    nodes, weights = np.polynomial.legendre.leggauss(radial)
    r = np.sqrt(0.5 * (nodes + 1.0))
    t = np.arange(angular) * (2.0 * np.pi / angular)
    r, t = (a.ravel() for a in np.meshgrid(r, t))
    return r * np.cos(t), r * np.sin(t), np.tile(0.5 * weights, angular) / angular


def test_noll_polynomials_are_orthonormal_over_the_disk():
    x, y, weight = disk_quadrature(20, 48)
    rows = np.array([one("zernike", str(j), convention="noll").jet(x, y).z for j in range(1, 67)])

    np.testing.assert_allclose((rows * weight) @ rows.T, np.eye(66), atol=1e-13)


def test_high_orders_keep_their_digits():
    x, y, weight = disk_quadrature(60, 128)
    highest = range(1276, 1327)  # radial degree 50, every azimuthal order
    rows = np.array([one("zernike", str(j), convention="noll").jet(x, y).z for j in highest])

    np.testing.assert_allclose((rows * weight) @ rows.T, np.eye(51), atol=1e-12)


def test_fringe_polynomials_are_orthogonal_with_amplitude_1_at_the_rim():
    x, y, weight = disk_quadrature(20, 48)
    rim = np.linspace(0.0, 2.0 * np.pi, 721)
    terms = [one("zernike", str(j), convention="fringe") for j in range(1, 38)]
    rows = np.array([t.jet(x, y).z for t in terms])
    gram = (rows * weight) @ rows.T

    np.testing.assert_allclose(gram - np.diag(np.diag(gram)), 0.0, atol=1e-14)
    for t in terms:
        assert np.abs(t.jet(np.cos(rim), np.sin(rim)).z).max() == pytest.approx(1.0, abs=1e-4)


# Forbes 2007: Q_bfs and Q_con of low order, x = u^2.
Q_BFS = [
    lambda x: 1.0 + 0.0 * x,
    lambda x: (13 - 16 * x) / np.sqrt(19),
    lambda x: np.sqrt(2 / 95) * (29 - 4 * x * (25 - 19 * x)),
    lambda x: np.sqrt(2 / 2545) * (207 - 4 * x * (315 - x * (577 - 320 * x))),
    lambda x: (7737 - 16 * x * (4653 - 2 * x * (7381 - 8 * x * (1168 - 509 * x)))) / (3 * np.sqrt(131831)),
]
Q_CON = [
    lambda x: 1.0 + 0.0 * x,
    lambda x: -(5 - 6 * x),
    lambda x: 15 - 14 * x * (3 - 2 * x),
    lambda x: -(35 - 12 * x * (14 - x * (21 - 10 * x))),
    lambda x: 70 - 3 * x * (168 - 5 * x * (84 - 11 * x * (8 - 3 * x))),
]


@pytest.mark.parametrize("n", range(5))
def test_q_polynomials_are_those_of_forbes(n):
    v = RADIUS**2

    np.testing.assert_allclose(one("q_bfs", str(n)).jet(*GRID).z, v * (1 - v) * Q_BFS[n](v), atol=1e-13)
    np.testing.assert_allclose(one("q_con", str(n)).jet(*GRID).z, v * v * Q_CON[n](v), atol=1e-13)


def test_q_con_heights_are_orthogonal():
    # Departures u^4 Q_n over the disk: the mean of their squares is 1 / (2 n + 5).
    x, y, weight = disk_quadrature(30, 1)
    rows = np.array([one("q_con", str(n)).jet(x, y).z for n in range(12)])

    np.testing.assert_allclose((rows * weight) @ rows.T, np.diag(1.0 / (2 * np.arange(12) + 5)), atol=1e-14)


def test_slopes_of_q_2d_are_orthonormal():
    # Mean of grad . grad with weight 1 / (u sqrt(1 - u^2)): with u = cos(a) all angles weigh the same, and
    # sin and cosine share the slope of one.
    half = (np.arange(40) + 0.5) * (np.pi / 80)
    angle = (np.arange(48) + 0.3) * (2.0 * np.pi / 48)
    u, t = (a.ravel() for a in np.meshgrid(np.cos(half), angle))
    keys = [f"{letter}{m},{n}" for m in range(7) for n in range(6) for letter in ("ab" if m else "a")]
    jets = [one("q_2d", key).jet(u * np.cos(t), u * np.sin(t)) for key in keys]
    slopes = np.array([np.concatenate([jet.zx, jet.zy]) for jet in jets])

    gram = slopes @ slopes.T / len(u)

    np.testing.assert_allclose(gram, np.eye(len(keys)), atol=1e-12)


def test_q_2d_of_order_zero_is_q_bfs():
    coefficients = {"0": 0.1, "3": 0.2}
    disk = {"normalization_radius": 2.0, "radius": 4.0}
    round_one = term_from_table({"kind": "q_bfs", "coefficients": coefficients, **disk}, where="w")
    free = {"kind": "q_2d", "coefficients": {f"a0,{n}": value for n, value in coefficients.items()}, **disk}

    for a, b in zip(round_one.jet(*GRID), term_from_table(free, where="w").jet(*GRID), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-14)


def test_a_departure_is_along_the_normal_of_the_sphere():
    # To first order in the coefficient, the distance from the sphere is the departure itself.
    disk = {"normalization_radius": 1.0, "radius": 1.5}
    sphere = term_from_table({"kind": "conic", "radius": 1.5}, where="w")
    bent = term_from_table({"kind": "q_bfs", "coefficients": {"2": 1e-7}, **disk}, where="w")
    flat = one("q_bfs", "2").jet(*GRID).z * 1e-7

    z = bent.jet(*GRID).z
    distance = 1.5 - np.sqrt(RADIUS**2 + (1.5 - z) ** 2)

    assert np.abs(z - sphere.jet(*GRID).z).max() > 1e-8
    np.testing.assert_allclose(distance, flat, atol=1e-13)


def test_single_polynomials_are_those_of_prysm():
    with (REFERENCE / "prysm.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    noll = {degrees("noll", j): j for j in range(1, 100)}

    for row in rows:
        n, m, u, t = int(row["n"]), int(row["m"]), float(row["u"]), float(row["t"])
        x, y = np.array([u * np.cos(t)]), np.array([u * np.sin(t)])
        if row["family"] == "zernike_norm":
            term = one("zernike", str(noll[n, abs(m), m < 0]), convention="noll")
        elif row["family"] == "q_2d":
            term = one("q_2d", f"{'b' if m < 0 else 'a'}{abs(m)},{n}")
        else:
            term = one(row["family"], row["n"])
        np.testing.assert_allclose(term.jet(x, y).z[0], float(row["value"]), atol=1e-11, err_msg=str(row))


@pytest.mark.parametrize("family", ["chebyshev", "legendre"])
def test_product_series_are_numpys(family):
    module = {"chebyshev": np.polynomial.chebyshev.chebval2d, "legendre": np.polynomial.legendre.legval2d}
    coefficients = np.random.default_rng(7).normal(size=(9, 7))
    table = {f"{i},{j}": float(c) for (i, j), c in np.ndenumerate(coefficients)}
    term = term_from_table(
        {"kind": family, "half_width": 2.0, "half_height": 0.5, "coefficients": table}, where="w"
    )

    found = term.jet(2.0 * GRID[0], 0.5 * GRID[1]).z

    np.testing.assert_allclose(found, module[family](*GRID, coefficients), atol=1e-13)
