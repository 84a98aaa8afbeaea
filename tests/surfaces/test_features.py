import closed_forms as cf
import numpy as np

from cmm_align.surfaces.features import feature_mask, features_at
from cmm_align.surfaces.geometry import principal_curvatures


def test_a_sphere_has_no_features_however_small():
    x, y = np.random.default_rng(1).uniform(-2, 2, (2, 500))

    assert not features_at(cf.Sphere(radius_mm=4.0), x, y, 1e-9).any()


def test_a_cylinder_is_a_feature_where_its_curvature_exceeds_the_threshold():
    x, y = np.random.default_rng(2).uniform(-9, 9, (2, 500))

    assert features_at(cf.Cylinder(radius_mm=19.9), x, y, 0.05).all()
    assert not features_at(cf.Cylinder(radius_mm=20.1), x, y, 0.05).any()


def test_features_are_the_same_from_either_side_and_lie_inside():
    surface = cf.Paraboloid(a_mm=10.0, b_mm=-14.0)
    x, y = np.random.default_rng(3).uniform(-30, 30, (2, 2000))

    found = features_at(surface, x, y, 0.05)

    for side in (1, -1):
        k = principal_curvatures(surface.jet(x, y), side)
        inside = surface.contains(x, y)
        np.testing.assert_array_equal(found, feature_mask(k.least, k.most, 0.05) & inside)
    assert found.any()
    assert not found.all()
