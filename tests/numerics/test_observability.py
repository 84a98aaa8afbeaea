"""Free motions of the surfaces whose symmetries are known."""

import closed_forms as cf
import numpy as np
import pytest

from cmm_align.numerics.observability import free_motions_in_words, solve_observable, spectrum
from cmm_align.surfaces.geometry import unit_normal

THRESHOLD = 1e-8


def words_for(surface, *, scale=1.0, reach=15.0, n=3000):
    rng = np.random.default_rng(1)
    x, y = rng.uniform(-reach, reach, (2, n))
    jet = surface.jet(x, y)
    points = scale * np.stack([x, y, jet.z], axis=1)
    normals = unit_normal(jet, 1)
    centroid = points.mean(axis=0)
    arm = points - centroid
    length = float(np.sqrt(np.mean(np.sum(arm**2, axis=1))))
    rows = np.hstack([np.cross(arm, normals) / length, normals])
    found = spectrum(rows.T @ rows / n, THRESHOLD)
    return free_motions_in_words(found, centroid, length)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize(
    ("surface", "count"),
    [
        (cf.Plane(a=0.0, b=0.0), 3),
        (cf.Plane(), 3),
        (cf.Sphere(), 3),
        (cf.Cylinder(), 2),
        (cf.Paraboloid(), 1),
        (cf.Torus(), 1),
        (cf.Paraboloid(b_mm=-90.0), 0),
    ],
    ids=["plane", "tilted plane", "sphere", "cylinder", "revolution", "torus", "biconic"],
)
def test_the_number_of_free_motions_is_that_of_the_symmetry_at_any_scale(surface, count, scale):
    assert len(words_for(surface, scale=scale)) == count


def test_a_plane_slides_and_turns():
    assert sorted(words_for(cf.Plane(a=0.0, b=0.0))[:2]) == ["translation along x", "translation along y"]
    assert words_for(cf.Plane(a=0.0, b=0.0))[2].startswith("rotation about the axis through (")
    assert words_for(cf.Plane(a=0.0, b=0.0))[2].endswith("along z")


def test_a_sphere_turns_about_its_centre():
    for sentence, axis in zip(words_for(cf.Sphere(radius_mm=50.0)), "xyz", strict=True):
        assert sentence.startswith("rotation about the axis through (")
        assert sentence.endswith(f"along {axis}")
    place = words_for(cf.Sphere(radius_mm=50.0))[2].split("(")[1].split(")")[0]
    np.testing.assert_allclose([float(v) for v in place.split(",")[:2]], [0.0, 0.0], atol=1e-3)


def test_a_paraboloid_turns_about_z_through_its_vertex():
    (sentence,) = words_for(cf.Paraboloid())

    assert sentence.startswith("rotation about the axis through (0.000, 0.000,")
    assert sentence.endswith("along z")


def test_a_cylinder_slides_along_and_turns_about_its_axis():
    sliding, turning = words_for(cf.Cylinder())

    assert sliding == "translation along y"
    assert turning.endswith("along y")
    assert "-60.000" in turning


def test_a_step_has_no_part_in_the_free_motions():
    rng = np.random.default_rng(2)
    rows = rng.normal(size=(50, 6))
    rows[:, 4] = 0.0
    found = spectrum(rows.T @ rows / 50, THRESHOLD)

    step = solve_observable(found, rng.normal(size=6))

    assert found.free.sum() == 1
    assert abs(step[4]) < 1e-12
