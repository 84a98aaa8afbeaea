import closed_forms as cf
import numpy as np

from cmm_align.surfaces.geometry import gaussian_curvature_per_mm2, principal_curvatures, slope, unit_normal

PLACES = np.random.default_rng(2).uniform(-18, 18, (2, 200))


def test_a_bowl_of_radius_50_is_concave_towards_a_probe_above():
    jet = cf.Sphere(radius_mm=50.0).jet(*PLACES)

    np.testing.assert_allclose(principal_curvatures(jet, +1).most, 1 / 50.0, rtol=1e-12)
    np.testing.assert_allclose(principal_curvatures(jet, +1).least, 1 / 50.0, rtol=1e-12)
    np.testing.assert_allclose(principal_curvatures(jet, -1).most, -1 / 50.0, rtol=1e-12)
    np.testing.assert_allclose(gaussian_curvature_per_mm2(jet), 1 / 2500.0, rtol=1e-12)


def test_a_torus_has_its_two_curvatures_everywhere():
    torus = cf.Torus()
    x, y = PLACES
    jet = torus.jet(x, y)
    t = np.sqrt(torus.minor_mm**2 - y**2)

    found = principal_curvatures(jet, -1)  # from below the cap is a bowl

    np.testing.assert_allclose(found.most, 1 / torus.minor_mm, rtol=1e-12)
    np.testing.assert_allclose(found.least, t / torus.minor_mm / (torus.major_mm + t), rtol=1e-12)


def test_the_normal_points_to_the_probe_and_away_from_the_centre_of_a_ball():
    ball = cf.Sphere(radius_mm=-70.0)
    jet = ball.jet(*PLACES)
    points = np.stack([*PLACES, jet.z], axis=1)

    np.testing.assert_allclose(unit_normal(jet, +1), (points - ball.centre) / 70.0, atol=1e-14)
    np.testing.assert_allclose(unit_normal(jet, -1), -unit_normal(jet, +1))


def test_slope_of_a_plane():
    np.testing.assert_allclose(slope(cf.Plane(a=0.3, b=-0.4).jet(*PLACES)), 0.5)
