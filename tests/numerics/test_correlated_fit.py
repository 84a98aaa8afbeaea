"""The averaged fit against a dense computation from the formula, and against simulated fields."""

import numpy as np
import pytest
from scipy.special import gammaln, logsumexp

from cmm_align.numerics.correlated_fit import NOISE, ROUGH, SMOOTH, fit, tables


def places(n=60, seed=1):
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (n, 2))


def shapes(p):
    always = np.column_stack([np.ones(len(p)), p])
    return always, np.column_stack([p[:, 0] ** 2, p[:, 0] * p[:, 1], np.cos(3.0 * p[:, 1])])


def dense(p, counts, always, columns, values):
    """(1) node by node with full matrices, for scaled columns."""
    n, q = columns.shape
    d = np.linalg.norm(p[:, None] - p, axis=2) / np.linalg.norm(np.ptp(p, axis=0))
    fields = [(1.0 + np.sqrt(3.0) * d / v) * np.exp(-np.sqrt(3.0) * d / v) for v in ROUGH]
    longer = [np.exp(-0.5 * (d / v) ** 2) for v in sorted(SMOOTH, reverse=True)]
    fields += [sum(longer[: k + 1]) / (k + 1) for k in range(len(longer))]
    white = np.diag(counts.mean() / counts)
    nodes = [(white, 1.0 / (len(NOISE) + 1))]
    nodes += [(f + s * white, 1.0 / (len(fields) * (len(NOISE) + 1))) for f in fields for s in NOISE]
    base = np.linalg.qr(always * np.sqrt(counts)[:, None])[0] / np.sqrt(counts / counts.mean())[:, None]
    logs, found = [], []
    for k, prior in nodes:
        inverse = np.linalg.inv(k)
        g0 = base.T @ inverse @ base
        without = inverse - inverse @ base @ np.linalg.solve(g0, base.T @ inverse)
        g, b, e = columns.T @ without @ columns, columns.T @ without @ values, values @ without @ values
        c = np.linalg.solve(g, b)
        s2 = (e - b @ c) / (n - always.shape[1] - q)
        held = g + s2 * np.eye(q)
        half = 0.5 * (n - always.shape[1])
        logs.append(
            np.log(prior)
            - 0.5 * np.linalg.slogdet(k @ np.linalg.inv(white))[1]
            - 0.5 * np.linalg.slogdet(g0)[1]
            + 0.5 * q * np.log(s2)
            - 0.5 * np.linalg.slogdet(held)[1]
            + gammaln(half)
            - half * np.log(0.5 * (e - b @ np.linalg.solve(held, b)))
        )
        found.append((c, s2 * np.linalg.inv(g)))
    total = logsumexp(logs)
    w = np.exp(np.array(logs) - total)
    mean = sum(a * c for a, (c, _) in zip(w, found, strict=True))
    spread = sum(a * (v + np.outer(c - mean, c - mean)) for a, (c, v) in zip(w, found, strict=True))
    return total, mean, spread


def test_evidence_coefficients_and_covariance_are_those_of_full_matrices():
    p = places()
    rng = np.random.default_rng(2)
    counts = rng.integers(1, 9, len(p)).astype(float)
    always, columns = shapes(p)
    values = columns @ [1.0, -0.5, 0.2] + 0.1 * np.sin(4.0 * p[:, 0]) + 0.05 * rng.standard_normal(len(p))
    found = tables(p, counts, always, columns, values)
    pick = [0, 2]
    got = fit(found, pick)
    # the same with columns and values of mean square 1 beyond `always`
    root = np.sqrt(counts / counts.mean())[:, None]
    q0 = np.linalg.qr(always * root)[0]
    rest = root * np.column_stack([columns[:, pick], values])
    rms = np.sqrt(np.mean((rest - q0 @ (q0.T @ rest)) ** 2, axis=0))
    total, mean, spread = dense(p, counts, always, columns[:, pick] / rms[:-1], values / rms[-1])
    units = rms[-1] / rms[:-1]
    assert got.log_evidence == pytest.approx(total, abs=1e-5)
    np.testing.assert_allclose(got.coefficients, mean * units, rtol=1e-6)
    np.testing.assert_allclose(got.covariance, spread * np.outer(units, units), rtol=1e-5, atol=1e-12)


def test_units_of_columns_and_values_change_nothing_but_units():
    p = places()
    always, columns = shapes(p)
    values = columns[:, 0] + 0.1 * np.random.default_rng(3).standard_normal(len(p))
    one = np.ones(len(p))
    a = fit(tables(p, one, always, columns, values), [0, 1])
    b = fit(tables(100.0 * p, 7.0 * one, always, 1e6 * columns, 1e-3 * values), [0, 1])
    assert b.log_evidence == pytest.approx(a.log_evidence, abs=1e-6)
    np.testing.assert_allclose(b.coefficients, 1e-9 * a.coefficients, rtol=1e-7)
    assert b.length == pytest.approx(100.0 * a.length)


def test_a_column_that_is_always_there_is_not_told():
    p = places()
    always, columns = shapes(p)
    both = np.column_stack([columns[:, 0], always @ [1.0, 2.0, 3.0]])
    found = tables(p, np.ones(len(p)), always, both, columns[:, 1])
    assert found.told.tolist() == [True, False]


def test_intervals_hold_the_truth_beside_noise_and_beside_a_field():
    p = places()
    always, columns = shapes(p)
    d = np.linalg.norm(p[:, None] - p, axis=2)
    r = np.sqrt(3.0) * d / 0.5
    root = np.linalg.cholesky((1.0 + r) * np.exp(-r) + 1e-9 * np.eye(len(p)))
    rng = np.random.default_rng(4)
    for field in (0.0, 1.0):
        z = []
        for _ in range(40):
            errors = field * root @ rng.standard_normal(len(p)) + 0.1 * rng.standard_normal(len(p))
            got = fit(tables(p, np.ones(len(p)), always, columns, columns @ [2.0, 0.0, 0.0] + errors), [0])
            z.append((got.coefficients[0] - 2.0) / np.sqrt(got.covariance[0, 0]))
        z = np.array(z)
        assert np.mean(np.abs(z) <= 1.96) >= 0.95 - 3.0 * np.sqrt(0.05 * 0.95 / 40)
        assert 0.6 < np.sqrt(np.mean(z**2)) < 1.0 + 3.0 / np.sqrt(2 * 40)  # 40 draws tell it to 11 %


def test_a_column_that_is_chance_lowers_the_evidence_and_one_that_is_there_raises_it():
    p = places(100)
    always, columns = shapes(p)
    noise = 0.1 * np.random.default_rng(5).standard_normal(len(p))
    chance = tables(p, np.ones(len(p)), always, columns, noise)
    there = tables(p, np.ones(len(p)), always, columns, noise + columns[:, 1])
    assert fit(chance, [1]).log_evidence < fit(chance, []).log_evidence
    assert fit(there, [1]).log_evidence > fit(there, []).log_evidence + 5.0
