"""Further points against stacked least squares: the long way round gives the same numbers."""

import numpy as np
import pytest

from cmm_align.numerics.helpful_points import Sums, helpful_places, told_elsewhere


def measured(rng, n=40):
    """Rows of a fit whose sixth motion is told badly, and a covariance of what was summed."""
    rows = rng.normal(size=(n, 6)) * [1.0, 1.0, 1.0, 1.0, 1.0, 0.02]
    return rows, rng.normal(size=(30, 6)) * [0.2, 0.1, 0.1, 0.3, 0.1, 0.4]


def stacked(rows, score, more):
    """Return the covariance of plain least squares over all rows: ``pinv cov(e) pinv^T``."""
    inverse = np.linalg.inv(rows.T @ rows + sum(count * np.outer(j, j) for j, count, _ in more))
    total = score + sum(count**2 * variance * np.outer(j, j) for j, count, variance in more)
    return inverse @ total @ inverse


def test_independent_points_give_the_covariance_of_the_stacked_rows(rng):
    rows, _ = measured(rng)
    sums = Sums(np.linalg.inv(rows.T @ rows), 0.09 * rows.T @ rows)
    row, motion = rng.normal(size=6), rng.normal(size=6)

    more = sums.with_points(row, 7, 0.09 / 7)

    again = np.vstack([rows, *[row] * 7])
    expected = 0.09 * motion @ np.linalg.inv(again.T @ again) @ motion
    np.testing.assert_allclose(more.variance(motion), expected, rtol=1e-12)


def test_points_that_err_alike_count_once(rng):
    rows, parts = measured(rng)
    score = parts.T @ parts
    sums = Sums(np.linalg.inv(rows.T @ rows), score)
    row, motion = rng.normal(size=6), rng.normal(size=6)

    more = sums.with_points(row, 5, 0.04)

    expected = motion @ stacked(rows, score, [(row, 5, 0.04)]) @ motion
    np.testing.assert_allclose(more.variance(motion), expected, rtol=1e-12)


@pytest.mark.parametrize("count", [1, 4])
def test_each_place_is_the_best_of_all_that_could_be_chosen(rng, count):
    rows, parts = measured(rng)
    score = parts.T @ parts
    candidates, places = rng.normal(size=(60, 6)), rng.uniform(-1, 1, (60, 3))

    chosen = helpful_places(
        Sums(np.linalg.inv(rows.T @ rows), score),
        np.eye(6),
        candidates,
        places,
        count=count,
        variance=0.01,
        apart_mm=0.4,
    )

    more = []
    for k, index in enumerate(chosen):
        worst = int(np.argmax(np.diag(stacked(rows, score, more))))
        far = [np.linalg.norm(places - places[i], axis=1) > 0.4 for i in chosen[:k]]
        left = np.flatnonzero(np.all([np.ones(60, dtype=bool), *far], axis=0))
        after = [stacked(rows, score, [*more, (candidates[i], count, 0.01)])[worst, worst] for i in left]
        assert left[int(np.argmin(after))] == index
        more.append((candidates[index], count, 0.01))
    assert len(chosen) == 3


def test_no_place_is_named_where_none_helps():
    rows = np.eye(6)

    chosen = helpful_places(
        Sums(np.eye(6), 1e-4 * np.eye(6)),
        np.eye(6),
        rows,
        np.zeros((6, 3)),
        count=1,
        variance=1.0,
        apart_mm=0.0,
    )

    # Points ten thousand times worse than those that are there, with the same weight, only do harm.
    assert len(chosen) == 0


def test_only_what_a_candidate_answers_is_told_elsewhere(rng):
    free = np.linalg.qr(rng.normal(size=(6, 2)))[0]
    answered = free @ [0.6, 0.8]
    rows = rng.normal(size=(20, 1)) * answered

    told = told_elsewhere(free, np.array([1e-16, 1e-16]), rows, 1e-6)

    assert told.shape == (6, 1)
    assert abs(told[:, 0] @ answered) == pytest.approx(1.0, abs=1e-12)
    assert told_elsewhere(free, np.array([1e-16, 1e-16]), 1e-4 * rows, 1e-6).shape == (6, 0)
    assert told_elsewhere(free, np.array([1e-16, 0.1]), rows, 1e-6).shape == (6, 0)
