"""Form error, CMM and grinder: what they promise, the rest of the tests stand on."""

from __future__ import annotations

import numpy as np
import pytest
from truth import measured_window

from cmm_align.surfaces.geometry import unit_normal
from cmm_align.units import DEG_PER_RAD
from cmm_align.virtual.cmm import machine_from_part, scan_lines, tip_centres
from cmm_align.virtual.form_error import form_error
from cmm_align.virtual.grinder import Grinder, grind
from cmm_align.virtual.window import TIP_RADIUS_MM, window, window_grid

EPS_MM = 1e-12
"""A few ulp at 100 mm."""


def dense() -> tuple[np.ndarray, np.ndarray]:
    x, y = np.meshgrid(np.linspace(-51.0, 51.0, 301), np.linspace(-31.0, 31.0, 201))
    return x.ravel(), y.ravel()


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_form_error_has_the_pv_that_was_asked_for(seed: int) -> None:
    error = form_error(window(), pv_mm=0.027, seed=seed).at(*dense())

    assert np.ptp(error) == pytest.approx(0.027, rel=1e-12)


def test_form_error_holds_no_rigid_motion() -> None:
    x, y = dense()
    surface = window()
    jet = surface.jet(x, y)
    normals = unit_normal(jet, 1)
    points = np.column_stack([x, y, jet.z])
    error = form_error(surface).at(x, y)

    motion = np.linalg.lstsq(np.hstack([np.cross(points, normals), normals]), error, rcond=None)[0]

    assert np.abs(motion).max() < 1e-12


def test_scan_lines_stay_on_the_part_and_are_uneven() -> None:
    x, y = scan_lines(window().bounds, lines=5, per_line=11)
    steps = np.abs(np.diff(x[:11]))

    assert 55 == len(x) == len(y)
    assert np.abs(x).max() < 51.0
    assert np.abs(y).max() < 31.0
    assert steps.max() > 1.2 * steps.min()


def test_a_tip_centre_is_one_radius_and_the_deviation_above_its_foot() -> None:
    truth = measured_window()
    centres = truth.machine_from_part.inverse().apply(truth.tip_centre_machine_mm)

    height = ((centres - truth.foot_mm) * truth.normals).sum(axis=1)

    np.testing.assert_allclose(height, TIP_RADIUS_MM + truth.deviation_mm, rtol=0.0, atol=100 * EPS_MM)


def test_noise_is_as_large_as_it_says(rng: np.random.Generator) -> None:
    surface = window()
    x, y = rng.uniform(-30.0, 30.0, size=(2, 20_000))
    seed = int(rng.integers(1_000))
    flat = tip_centres(surface, lambda x, _y: np.zeros_like(x), x, y, 1.5, noise_mm=0.0)
    noisy = tip_centres(surface, lambda x, _y: np.zeros_like(x), x, y, 1.5, noise_mm=0.0003, seed=seed)
    size = np.linalg.norm(noisy - flat, axis=1)

    assert np.sqrt(np.mean(size**2)) == pytest.approx(0.0003, rel=4.0 / np.sqrt(2.0 * 20_000))


def test_drift_is_slow() -> None:
    surface = window()
    x, y = scan_lines(surface.bounds)
    zero = lambda x, _y: np.zeros_like(x)  # noqa: E731
    still = tip_centres(surface, zero, x, y, 1.5, noise_mm=0.0)
    moved = tip_centres(surface, zero, x, y, 1.5, noise_mm=0.0, drift_mm=0.001)
    drift = np.linalg.norm(moved - still, axis=1)

    assert np.sqrt(np.mean(drift**2)) == pytest.approx(0.001, rel=1e-9)
    assert np.abs(np.diff(drift)).max() < 0.01 * drift.max()


def test_the_machine_frame_is_far_off() -> None:
    pose = machine_from_part()

    assert pose.translation_mm.tolist() == [20.0, 10.0, 20.0]
    assert 25.0 < np.linalg.norm(pose.rotation_vector_rad()) * DEG_PER_RAD < 35.0


def test_same_seed_same_points() -> None:
    first, second = measured_window(noise_mm=0.0003), measured_window(noise_mm=0.0003)

    np.testing.assert_array_equal(first.tip_centre_machine_mm, second.tip_centre_machine_mm)


def test_an_ideal_grinder_told_the_nominal_repeats_its_error() -> None:
    surface, error = window(), form_error(window())
    x, y = scan_lines(surface.bounds, lines=7, per_line=9)
    again = grind(surface, error.at, window_grid(2.0), Grinder(repeatability_mm=0.0))(x, y)

    np.testing.assert_allclose(again, error.at(x, y), rtol=0.0, atol=1e-9)


def test_an_ideal_grinder_told_the_opposite_makes_the_nominal() -> None:
    surface, error = window(), form_error(window())
    told = window_grid(1.0)
    nz = unit_normal(surface.jet(told[:, 0], told[:, 1]), 1)[:, 2]
    told[:, 2] -= error.at(told[:, 0], told[:, 1]) / nz
    x, y = scan_lines(surface.bounds, lines=7, per_line=9)

    left = grind(surface, error.at, told, Grinder(transfer=1.0, repeatability_mm=0.0))(x, y)

    assert np.abs(left).max() < 0.02 * 0.027  # what a 1 mm grid cannot carry of the ripple
