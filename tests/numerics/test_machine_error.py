"""The simulated machine just meets its statement, whatever the length, place and direction."""

import numpy as np
import pytest

from cmm_align.errors import UnitsError, UsageError
from cmm_align.numerics.machine_error import common_covariance, error_factors, machine_error
from cmm_align.numerics.rotations import rotation_from_vector
from cmm_align.units import parse_mpe

CONSTANT_MM, SLOPE = 0.7e-3, 1e-3 / 400.0


def mpe(length_mm):
    return CONSTANT_MM + SLOPE * length_mm


def directions(rng, n):
    u = rng.normal(size=(n, 3))
    return u / np.linalg.norm(u, axis=1)[:, None]


def window_touches(n, rng, size=(100.0, 60.0)):
    """Touches on a bowl of R 80 mm."""
    p = np.column_stack([rng.uniform(-s / 2, s / 2, n) for s in size])
    z = -np.sqrt(80.0**2 - np.sum(p**2, axis=1)) + 70.0
    normals = np.column_stack([-p / 80.0, -(z - 70.0) / 80.0])
    return np.column_stack([p, z]), normals


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("factor", [1.96, 2.0])
def test_every_length_has_the_standard_deviation_of_the_statement(share, factor, rng):
    error = machine_error(CONSTANT_MM, SLOPE, probe_share=share, coverage_factor=factor)
    u, start = directions(rng, 40), rng.uniform(-200.0, 200.0, (40, 3))

    for length in (0.0, 1.0, 30.0, 400.0):
        p = np.concatenate([start, start + length * u])
        common = common_covariance(error, p, np.concatenate([-u, u]), p, np.concatenate([-u, u]))
        one, other = np.arange(40), np.arange(40, 80)
        found = common[one, one] + common[other, other] + 2.0 * common[one, other] + 2.0 * error.white_mm2

        # Distances come from squares of places of 600 mm at most: sqrt(eps) 600 mm is the worst of them.
        rounding = error.drift_mm2_per_mm * 1e-5
        np.testing.assert_allclose(found, (mpe(length) / factor) ** 2, rtol=1e-11, atol=rounding)


def test_simulated_lengths_spread_as_the_statement_says(rng):
    lengths, runs = np.array([0.0, 5.0, 20.0, 60.0, 110.0]), 4000
    u = directions(rng, 6)
    start = rng.uniform(-10.0, 10.0, (6, 3))
    first = np.repeat(start, 5, axis=0)
    p = np.concatenate([first, first + (np.tile(lengths, 6)[:, None] * np.repeat(u, 5, axis=0))])
    n = np.concatenate([-np.repeat(u, 5, axis=0), np.repeat(u, 5, axis=0)])
    factors, sigma = error_factors(machine_error(CONSTANT_MM, SLOPE), p, n)

    errors = rng.normal(size=(runs, len(factors))) @ factors + sigma * rng.normal(size=(runs, len(p)))
    spread = np.std(errors[:, :30] + errors[:, 30:], axis=0).reshape(6, 5)

    # 30 standard deviations of 4000 numbers each: 4 sigma; the remainders add 1 % of the variance at most.
    np.testing.assert_allclose(
        spread, np.tile(mpe(lengths) / 2.0, (6, 1)), rtol=4.0 / np.sqrt(2 * runs) + 0.01
    )


def test_a_random_scale_matrix_and_random_harmonics_have_the_stated_covariance(rng):
    """The parts built one by one: a symmetric matrix, and waves on the sphere."""
    runs, t, s = 40_000, 2.0, 3.0
    raw = np.sqrt(t) * rng.normal(size=(runs, 3, 3))
    matrices = (raw + raw.transpose(0, 2, 1)) / np.sqrt(2.0)  # variance 2 t on and t off the diagonal
    p, n = rng.uniform(-1.0, 1.0, (4, 3)), directions(rng, 4)
    x, y, z = n.T
    second = np.sqrt([[3.0], [3.0], [3.0], [0.75], [0.25]]) * [
        x * y,
        y * z,
        z * x,
        x * x - y * y,
        3 * z * z - 1,
    ]
    third = [
        np.sqrt(5 / 8) * y * (3 * x * x - y * y),
        np.sqrt(15.0) * x * y * z,
        np.sqrt(3 / 8) * y * (5 * z * z - 1),
        0.5 * z * (5 * z * z - 3),
        np.sqrt(3 / 8) * x * (5 * z * z - 1),
        np.sqrt(15 / 4) * z * (x * x - y * y),
        np.sqrt(5 / 8) * x * (x * x - 3 * y * y),
    ]
    waves = np.concatenate(
        [np.ones((1, 4)), second, third]
    )  # of one variance on the sphere: addition theorem
    errors = np.einsum("ni,rij,nj->rn", n, matrices, p)
    scale = machine_error(0.0, 1.0)._replace(strain=t)
    lobes = machine_error(1.0, 0.0)._replace(lobe_mm2=s)

    expected = common_covariance(scale, p, n, p, n)
    variance = np.diag(expected)
    error = np.sqrt((np.outer(variance, variance) + expected**2) / runs)  # of a sample covariance
    assert np.all(np.abs(errors.T @ errors / runs - expected) < 4.0 * error)
    np.testing.assert_allclose(common_covariance(lobes, p, n, p, n), s * waves.T @ waves, atol=1e-14)


def test_the_direction_of_the_axes_does_not_matter(rng):
    error = machine_error(CONSTANT_MM, SLOPE)
    p, n = window_touches(50, rng)
    turn = rotation_from_vector(np.array([0.7, -1.1, 0.4]))

    there = common_covariance(error, p @ turn.T, n @ turn.T, p @ turn.T, n @ turn.T)

    here = common_covariance(error, p, n, p, n)
    np.testing.assert_allclose(there, here, rtol=0, atol=1e-12 * here.max() + error.drift_mm2_per_mm * 1e-5)


def test_close_touches_with_like_normals_err_alike(rng):
    error = machine_error(CONSTANT_MM, SLOPE)
    p = np.array([[10.0, 0.0, 0.0], [10.1, 0.0, 0.0], [-50.0, 0.0, 0.0]])
    n = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [0.6, 0.0, 0.8]])

    covariance = common_covariance(error, p, n, p, n) + error.white_mm2 * np.eye(3)
    root = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(root, root)

    lobing = 3.0 * error.lobe_mm2 / (3.0 * error.lobe_mm2 + error.white_mm2)
    assert lobing == pytest.approx(3.0 / 7.0, rel=1e-12)  # of half the constant part: 3/64 beside 1/16
    assert correlation[0, 1] > lobing  # what places share comes on top
    assert correlation[0, 2] < 0.5 * correlation[0, 1]


def test_factors_leave_out_no_variance_and_little_covariance(rng):
    error = machine_error(CONSTANT_MM, SLOPE)
    p, n = window_touches(4500, rng)  # more than the candidates

    factors, sigma = error_factors(error, p, n)

    few = rng.choice(4500, 500, replace=False)
    exact = common_covariance(error, p[few], n[few], p[few], n[few])
    got = factors[:, few].T @ factors[:, few]
    left = sigma[few] ** 2 - error.white_mm2
    rounding = 1e-12 * exact.max() + error.drift_mm2_per_mm * 1e-5
    np.testing.assert_allclose(np.diag(got) + left, np.diag(exact), atol=rounding)
    assert np.all(np.abs(got - exact) <= np.sqrt(np.outer(left, left)) + rounding)
    assert left.max() < 0.03 * (mpe(0.0) / 2.0) ** 2  # 300 factors on a window of 100 x 60 mm


def test_few_touches_are_taken_exactly(rng):
    error = machine_error(CONSTANT_MM, 0.0)  # no place in it: lobes only
    p, n = window_touches(400, rng)

    factors, sigma = error_factors(error, p, n)

    assert len(factors) <= 13  # harmonics of degrees 0, 2 and 3
    assert np.all(sigma**2 < 1.0001 * error.white_mm2 + 0.01 * (mpe(0.0) / 2.0) ** 2)


@pytest.mark.parametrize(
    ("numbers", "choices"),
    [
        ((-1e-3, 0.0), {}),
        ((1e-3, np.nan), {}),
        ((1e-3, 0.0), {"probe_share": 1.5}),
        ((1e-3, 0.0), {"coverage_factor": 0.0}),
    ],
)
def test_numbers_out_of_range_are_refused(numbers, choices):
    with pytest.raises(UsageError, match="expected"):
        machine_error(*numbers, **choices)


@pytest.mark.parametrize(
    ("text", "constant", "divisor"),
    [
        ("0.7+L/400", 0.7, 400.0),
        ("0.7um + L/400", 0.7, 400.0),
        ("0,7 + L/400", 0.7, 400.0),
        ("1.5+3L/1000", 1.5, 1000.0 / 3.0),
        ("0.7+0.0025*L", 0.7, 400.0),
        ("(0.7+L/400) um", 0.7, 400.0),
        ("± ( 1.9 + 3·L/1000 mm ) µm", 1.9, 1000.0 / 3.0),
        ("0+L/250", 0.0, 250.0),
        ("1.2", 1.2, np.inf),
        ("1,2 + l/333,3", 1.2, 333.3),
    ],
)
def test_statements_are_read_as_they_are_printed(text, constant, divisor):
    assert parse_mpe(text) == pytest.approx((constant, divisor), rel=1e-15)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "L/400",
        "0.7+L/0",
        "0",
        "0+0L",
        "0.7mm+L/400",
        "0.7 5+L/400",
        "-1+L/400",
        "0.7-L/400",
        "0.7+L/1,000",
        "(0.7+L/400",
        "9" * 400,
    ],
)
def test_what_is_no_statement_says_what_one_looks_like(text):
    with pytest.raises(UnitsError, match=r"0\.7\+L/400"):
        parse_mpe(text)
