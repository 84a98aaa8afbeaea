import closed_forms as cf
import numpy as np
import pytest

from cmm_align.numerics.foot_point import distance_hessian, foot_points, shifted_feet
from cmm_align.numerics.seed_table import seed_table, seeds
from cmm_align.surfaces.equidistant import limits_of
from cmm_align.surfaces.geometry import unit_normal

# Rounding: coordinates of 50 mm carry 1e-14 mm, a few operations more.
EXACT_MM = 1e-12


def lifted(surface, x, y, height, side=1):
    """Points a known distance off known feet."""
    jet = surface.jet(x, y)
    return np.stack([x, y, jet.z], axis=1) + height[:, None] * unit_normal(jet, side)


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize(
    "surface",
    [
        cf.Plane(),
        cf.Sphere(),
        cf.Sphere(radius_mm=-70.0),
        cf.Cylinder(),
        cf.Paraboloid(b_mm=-90.0),
        cf.Torus(),
    ],
    ids=lambda s: type(s).__name__,
)
def test_known_feet_and_distances_come_back(surface, side):
    rng = np.random.default_rng(3)
    x, y = rng.uniform(-18, 18, (2, 500))
    height = rng.uniform(-5.0, 5.0, 500)
    points = lifted(surface, x, y, height, side)

    feet = foot_points(surface.jet, side, points, points[:, 0], points[:, 1], limits_of(surface))

    np.testing.assert_allclose(feet.distance_mm, height, atol=EXACT_MM)
    np.testing.assert_allclose(feet.x_mm, x, atol=1e-8)
    np.testing.assert_allclose(feet.y_mm, y, atol=1e-8)
    np.testing.assert_allclose(feet.normal, unit_normal(surface.jet(x, y), side), atol=1e-9)


def test_the_foot_is_the_closest_point_found_by_brute_force():
    surface = cf.Torus()
    rng = np.random.default_rng(4)
    points = np.column_stack([rng.uniform(-15, 15, (20, 2)), rng.uniform(-8, 8, 20)])
    feet = foot_points(surface.jet, 1, points, points[:, 0], points[:, 1], limits_of(surface))
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(-20, 20, 801), np.linspace(-20, 20, 801)))
    cloud = np.stack([x, y, surface.jet(x, y).z], axis=1)

    for p, d in zip(points, feet.distance_mm, strict=True):
        nearest = np.linalg.norm(cloud - p, axis=1).min()
        # The raster is 0.05 mm: its nearest node is at most 0.0354 mm aside, so d^2 + 0.0354^2.
        assert abs(d) <= nearest + 1e-12
        assert nearest**2 <= d**2 + 2.0 * 0.036**2


def test_the_tip_radius_comes_off_exactly_where_the_equidistant_is_regular():
    torus = cf.Torus()
    rng = np.random.default_rng(5)
    points = np.column_stack([rng.uniform(-15, 15, (300, 2)), rng.uniform(0, 4, 300)])
    near = foot_points(torus.jet, 1, points, points[:, 0], points[:, 1], limits_of(torus))
    offset = torus.offset(1.5)
    lifted_down = points - [0.0, 0.0, 1.5]  # the offset torus has its vertex 1.5 mm higher

    far = foot_points(offset.jet, 1, lifted_down, points[:, 0], points[:, 1], limits_of(offset))

    np.testing.assert_allclose(near.distance_mm - 1.5, far.distance_mm, atol=EXACT_MM)


def test_a_point_past_the_border_ends_on_the_limits():
    surface = cf.Plane(a=0.0, b=0.0)
    limits = limits_of(surface)
    feet = foot_points(surface.jet, 1, np.array([[30.0, 0.0, 1.0]]), np.zeros(1), np.zeros(1), limits)

    assert feet.x_mm[0] == limits[1]
    assert not surface.contains(feet.x_mm, feet.y_mm)[0]


def test_a_place_where_the_surface_is_undefined_gives_nan_not_a_number():
    feet = foot_points(
        cf.Sphere(half_mm=80.0).jet,
        1,
        np.array([[70.0, 0.0, 1.0]]),
        np.array([70.0]),
        np.zeros(1),
        (-80, 80, -80, 80),
    )

    assert np.isnan(feet.distance_mm[0])


def test_the_hessian_of_the_distance_agrees_with_finite_differences():
    surface = cf.Torus()
    rng = np.random.default_rng(6)
    x, y = rng.uniform(-12, 12, (2, 30))
    points = lifted(surface, x, y, rng.uniform(0.5, 3.0, 30))

    def normal_at(p):
        return foot_points(surface.jet, 1, p, p[:, 0], p[:, 1], limits_of(surface)).normal

    feet = foot_points(surface.jet, 1, points, x, y, limits_of(surface))
    exact = distance_hessian(surface.jet, 1, points, feet)

    h = 1e-4
    for k in range(3):
        step = h * np.eye(3)[k]
        numeric = (normal_at(points + step) - normal_at(points - step)) / (2 * h)
        np.testing.assert_allclose(exact[:, :, k], numeric, atol=1e-7)
    np.testing.assert_allclose(exact, np.swapaxes(exact, 1, 2), atol=1e-12)


@pytest.mark.parametrize("side", [1, -1])
def test_seeds_lie_near_the_feet_of_points_on_the_offset_surface_and_off_it(side):
    surface = cf.Paraboloid(b_mm=-90.0)
    table = seed_table(surface.jet, side, 1.5, limits_of(surface))
    rng = np.random.default_rng(7)
    x, y = rng.uniform(-19, 19, (2, 500))
    off = rng.uniform(-0.02, 0.02, 500)

    sx, sy = seeds(table, lifted(surface, x, y, 1.5 + off, side))

    # Half a pitch of 0.34 mm from the nearest node the lean is off by its share of the curvature, of the off.
    pitch, curvature, steep = 0.34, 1.0 / 60.0, 0.35
    allowed = pitch**2 * curvature * steep / 8.0 * 0.1 + 0.02 * (0.5 * pitch + 1.5 * steep) * curvature
    assert np.hypot(sx - x, sy - y).max() < allowed


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("surface", [cf.Sphere(), cf.Paraboloid(b_mm=-90.0), cf.Torus()])
def test_shifted_feet_are_right_to_second_order(surface, side):
    rng = np.random.default_rng(8)
    x, y = rng.uniform(-15, 15, (2, 300))
    points = lifted(surface, x, y, rng.uniform(0.5, 2.5, 300), side)
    limits = limits_of(surface)
    feet = foot_points(surface.jet, side, points, x, y, limits)
    radius = 1.0
    errors = []
    for size in (1e-2, 5e-3):
        shift = size * rng.standard_normal((300, 3))
        exact = foot_points(surface.jet, side, points + shift, x, y, limits)
        found = shifted_feet(side, radius, feet._replace(distance_mm=feet.distance_mm - radius), shift)
        errors.append(np.abs(found.distance_mm + radius - exact.distance_mm).max())
        assert np.abs(found.normal - exact.normal).max() < 10.0 * (size / 40.0) ** 2
        assert np.hypot(found.x_mm - exact.x_mm, found.y_mm - exact.y_mm).max() < 10.0 * size**2 / 40.0

    # Third order in the shift, over the square of the radius of curvature (40 mm or more).
    assert errors[0] < 30.0 * 1e-6 / 40.0**2
    assert errors[1] < 0.5 * errors[0]
