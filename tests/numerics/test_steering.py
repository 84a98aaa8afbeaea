"""Weights, locks and datum terms of a fit, each against a second route."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from cmm_align.numerics.fit_steps import FitSettings, stepped
from cmm_align.numerics.linearisation import evaluate, moved
from cmm_align.numerics.rigid_fit import fit
from cmm_align.numerics.rotations import rotation_from_vector, vector_from_rotation
from cmm_align.numerics.steering import (
    DatumTerms,
    Lock,
    Placement,
    Steering,
    allowed_motions,
    datum_rows,
    held,
)
from cmm_align.surfaces.distance import smooth_measure
from cmm_align.virtual.window import window

SIZE, LENGTH = 120.0, 35.0
SETTINGS = FitSettings(SIZE, LENGTH, 1e-12, 50, 0.5, 1e-8)


@pytest.fixture(scope="module")
def case():
    rng = np.random.default_rng(5)
    surface = window()
    x, y = rng.uniform(-40, 40, 300), rng.uniform(-25, 25, 300)
    z = surface.jet(x, y).z + 2e-3 * np.sin(0.2 * x) + 1e-3 * rng.normal(size=300)
    points = np.column_stack([x, y, z])
    centroid = points.mean(axis=0)
    start = Placement(
        rotation_from_vector(np.array([1e-3, -2e-3, 1.5e-3])), centroid + np.array([0.05, -0.02, 0.03])
    )
    return smooth_measure(surface, 1, 0.0), points - centroid, start


def lock_of(start, names, axes=None):
    locked = np.array([axis in names for axis in ("rx", "ry", "rz", "tx", "ty", "tz")])
    turned = rotation_from_vector(np.array([0.2, 0.1, -0.3])) if axes is None else axes
    return Lock(start, turned, np.array([5.0, -3.0, 8.0]), locked)


def away(lock, placement):
    """Rotation vector and shift of the lock's centre, along the lock's axes: written out anew."""
    turn = placement.rotation @ lock.start.rotation.T
    centre = turn @ (lock.centre_mm - lock.start.position_mm) + placement.position_mm
    return np.concatenate([lock.axes.T @ vector_from_rotation(turn), lock.axes.T @ (centre - lock.centre_mm)])


def test_held_takes_locked_motions_back_and_leaves_the_others(case):
    start = case[2]
    lock = lock_of(start, {"rz", "ty"})
    step = 5.0 * np.array([0.3, 0.2, -0.4, 0.1, 0.3, -0.2])
    moved_away = stepped(start, step, LENGTH)
    back = held(lock, moved_away)
    before, after = away(lock, moved_away), away(lock, back)
    np.testing.assert_allclose(after[[2, 4]], 0.0, atol=1e-15 * SIZE)
    np.testing.assert_allclose(after[[0, 1, 3, 5]], before[[0, 1, 3, 5]], atol=1e-14 * SIZE)


@pytest.mark.parametrize("names", [{"rz"}, {"tx", "ty"}, {"rx", "ry", "tz"}, {"rz", "tx", "ty", "tz"}])
def test_allowed_motions_leave_the_locked_ones_alone_in_first_order(case, names):
    start = case[2]
    lock = lock_of(start, names)
    there = held(lock, stepped(start, 3.0 * np.array([0.3, 0.2, -0.4, 0.1, 0.3, -0.2]), LENGTH))
    basis = allowed_motions(lock, there, LENGTH)
    assert basis.shape == (6, 6 - len(names))
    for column in basis.T:
        h = 1e-4
        change = away(lock, stepped(there, h * column, LENGTH)) - away(
            lock, stepped(there, -h * column, LENGTH)
        )
        assert np.abs(change[lock.locked]).max() / (2 * h) < 1e-8  # cancellation: eps * size / h


@pytest.mark.parametrize("names", [{"rz"}, {"tx", "ty"}, {"rx", "ry", "tz"}])
def test_a_locked_fit_is_the_best_of_those_that_hold_the_lock(case, names):
    measure, points, start = case
    lock = lock_of(start, names)
    found = fit(measure, points, start, SETTINGS, steering=Steering(lock=lock))
    np.testing.assert_allclose(away(lock, found.placement)[lock.locked], 0.0, atol=1e-14 * SIZE)
    free = np.flatnonzero(~lock.locked)

    def cost(v):
        w, t = np.zeros(3), np.zeros(3)
        both = np.zeros(6)
        both[free] = v * np.where(free < 3, 1.0 / LENGTH, 1.0)
        w, t = lock.axes @ both[:3], lock.axes @ both[3:]
        turn = rotation_from_vector(w)
        there = Placement(
            turn @ start.rotation, turn @ (start.position_mm - lock.centre_mm) + lock.centre_mm + t
        )
        return 1e6 * evaluate(measure, points, there, LENGTH, used=np.ones(len(points), bool)).cost_mm2

    second = minimize(cost, np.zeros(len(free)), method="BFGS", options={"gtol": 1e-7})
    assert 1e6 * found.evaluation.cost_mm2 <= second.fun * (1 + 1e-9)
    assert second.fun <= 1e6 * found.evaluation.cost_mm2 * (
        1 + 1e-6
    )  # BFGS with finite differences ends there
    unlocked = fit(measure, points, start, SETTINGS)
    assert unlocked.evaluation.cost_mm2 < found.evaluation.cost_mm2


def test_a_weight_of_two_is_a_point_measured_twice(case):
    measure, points, start = case
    weights = np.where(np.arange(len(points)) < 100, 2.0, 1.0)
    once = fit(measure, points, start, SETTINGS, steering=Steering(weights=weights))
    twice = fit(measure, np.concatenate([points, points[:100]]), start, SETTINGS)
    np.testing.assert_allclose(once.placement.rotation, twice.placement.rotation, atol=1e-11)
    np.testing.assert_allclose(once.placement.position_mm, twice.placement.position_mm, atol=1e-9)
    assert once.evaluation.cost_mm2 == pytest.approx(twice.evaluation.cost_mm2, rel=1e-10)


def test_weights_of_zero_are_points_left_out(case):
    measure, points, start = case
    weights = (np.arange(len(points)) % 3 > 0).astype(float)
    zero = fit(measure, points, start, SETTINGS, steering=Steering(weights=weights))
    out = fit(measure, points[weights > 0], start, SETTINGS)
    np.testing.assert_allclose(zero.placement.position_mm, out.placement.position_mm, atol=1e-9)


def test_the_rows_of_datum_terms_are_their_derivatives(case):
    start = case[2]
    rng = np.random.default_rng(1)
    directions = rng.normal(size=(5, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    datum = DatumTerms(rng.normal(0, 30, (5, 3)), rng.normal(0, 30, (5, 3)), directions, np.ones(5))
    rows = datum_rows(datum, start, LENGTH)
    h = 1e-4
    for k, unit in enumerate(np.eye(6)):
        plus = datum_rows(datum, stepped(start, h * unit, LENGTH), LENGTH)[6]
        minus = datum_rows(datum, stepped(start, -h * unit, LENGTH), LENGTH)[6]
        np.testing.assert_allclose((plus - minus) / (2 * h), rows[k], atol=1e-8)
    where = np.einsum("ij,ij->i", directions, moved(datum.points_mm, start) - datum.targets_mm)
    np.testing.assert_allclose(rows[6], where, atol=1e-12)


def test_heavy_datum_terms_hold_the_part_where_they_say(case):
    measure, points, start = case
    places = np.array([[30.0, 0, 5], [-30, 10, 5], [0, -20, 5]])
    target = Placement(
        rotation_from_vector(np.array([0.0, 0.0, 2e-3])), start.position_mm + np.array([0.01, 0.02, 0.0])
    )
    row, axis = np.repeat(np.arange(3), 3), np.tile(np.arange(3), 3)
    heavy = DatumTerms(places[row], moved(places, target)[row], np.eye(3)[axis], np.full(9, 1e9))
    found = fit(measure, points, start, SETTINGS, steering=Steering(datum=heavy))
    np.testing.assert_allclose(moved(places, found.placement), moved(places, target), atol=1e-6)
