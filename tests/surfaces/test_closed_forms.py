"""The closed forms that other tests rest on are right themselves."""

import closed_forms as cf
import numpy as np
import pytest

FORMS = [
    cf.Plane(),
    cf.Sphere(),
    cf.Sphere(radius_mm=-70.0),
    cf.Cylinder(),
    cf.Paraboloid(b_mm=-90.0),
    cf.Torus(),
]


@pytest.mark.parametrize("surface", FORMS, ids=lambda s: type(s).__name__)
def test_jets_agree_with_finite_differences(surface):
    rng = np.random.default_rng(1)
    x, y = rng.uniform(-18, 18, (2, 50))

    exact, numeric = surface.jet(x, y), cf.finite_difference_jet(surface, x, y)

    for a, b in zip(exact, numeric, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-9)
