"""The virtual grinder: each of its errors alone, against its closed form."""

from __future__ import annotations

import numpy as np
import pytest

from cmm_align.surfaces.geometry import unit_normal
from cmm_align.surfaces.prescription import prescription_from_toml
from cmm_align.virtual.grinder import Grinder, grind
from cmm_align.virtual.window import window, window_grid

X, Y = (a.ravel() for a in np.meshgrid(np.linspace(-48.0, 48.0, 49), np.linspace(-28.0, 28.0, 29)))
FLAT = prescription_from_toml(
    'schema = "cmm-align/prescription/1"\nunits = "mm"\n[aperture]\nshape = "rectangle"\nwidth = 102.0\n'
    'height = 62.0\n[[term]]\nkind = "xy_polynomial"\nnormalization_radius = 1.0\n'
    'coefficients = { "1,0" = 0.0 }\n',
    where="a plane",
)


def with_(**errors: float) -> Grinder:
    return Grinder(**{"transfer": 1.0, "repeatability_mm": 0.0, **errors})


def nothing(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return 0.0 * x


def test_a_wheel_too_large_cuts_too_deep_everywhere() -> None:
    left = grind(window(), nothing, None, with_(wheel_radius_error_mm=0.002))(X, Y)

    np.testing.assert_allclose(left, -0.002, atol=1e-15)


def test_wear_leaves_material_that_grows_along_the_path() -> None:
    left = grind(window(), nothing, None, with_(wear_mm=0.004))(X, Y).reshape(29, 49)

    assert (np.diff(left, axis=0) > 0.0).all()
    assert left[0].max() < 0.1 * 0.004 < 0.9 * 0.004 < left[-1].min()


def test_drift_is_along_z_and_dies_out() -> None:
    left = grind(window(), nothing, None, with_(drift_mm=0.003))(X, Y)
    n_z = unit_normal(window().jet(X, Y), 1)[:, 2]
    rise = (left / n_z).reshape(29, 49)[:, 24]

    assert (np.diff(rise) < 0.0).all()
    assert rise[0] - rise[7] > 5.0 * (rise[21] - rise[28])
    assert rise[-1] == pytest.approx(-0.003 * (1.0 - np.exp(-3.0)), rel=0.03)


def test_a_part_that_sits_wrongly_shows_a_rigid_motion_and_nothing_else() -> None:
    grinder = with_(decentre_mm=0.005, tilt_rad=5e-5, clocking_rad=5e-5)
    left = grind(window(), nothing, None, grinder, seed=3)(X, Y)
    jet = window().jet(X, Y)
    points, normals = np.column_stack([X, Y, jet.z]), unit_normal(jet, 1)
    rows = np.hstack([np.cross(points, normals), normals])

    assert np.ptp(left) > 0.001
    assert np.abs(left - rows @ np.linalg.lstsq(rows, left, rcond=None)[0]).max() < 1e-12


def test_the_transfer_of_a_wave_is_that_of_a_gaussian_contact() -> None:
    told = window_grid(1.0)
    told[:, 2] = 0.001 * np.cos(2.0 * np.pi * told[:, 0] / 12.0)
    inside = np.abs(X) < 25.0
    left = grind(FLAT, nothing, told, with_(transfer=0.9, contact_mm=6.0))(X, Y)
    share = 0.9 * np.exp(-((np.pi * 6.0 / 12.0) ** 2) / (4.0 * np.log(2.0)))

    expected = share * 0.001 * np.cos(2.0 * np.pi * X / 12.0)
    assert np.abs(left - expected)[inside].max() < 0.02 * 0.001


def test_chance_has_its_size_no_rigid_motion_and_is_new_in_each_pass() -> None:
    grinder = with_(repeatability_mm=0.001)
    fields = np.array([grind(window(), nothing, None, grinder, seed=s)(X, Y) for s in range(16)])
    jet = window().jet(X, Y)
    points, normals = np.column_stack([X, Y, jet.z]), unit_normal(jet, 1)
    rows, _ = np.linalg.qr(np.hstack([np.cross(points, normals), normals]))

    mean_square = np.mean(fields**2, axis=1)
    assert np.mean(mean_square) == pytest.approx(1e-6, rel=3.0 * np.std(mean_square) / 1e-6 / 4.0)
    assert np.abs(fields @ rows).max() < 0.2 * 0.001 * len(X) ** 0.5
    assert abs(np.corrcoef(fields[0], fields[1])[0, 1]) < 0.7
    np.testing.assert_array_equal(fields[0], grind(window(), nothing, None, grinder, seed=0)(X, Y))


def test_roughness_is_white() -> None:
    left = grind(window(), nothing, None, with_(roughness_mm=0.0005))(X, Y)

    assert left.std() == pytest.approx(0.0005, rel=4.0 / np.sqrt(2.0 * len(X)))
    assert abs(np.corrcoef(left[:-1], left[1:])[0, 1]) < 4.0 / np.sqrt(len(X))
