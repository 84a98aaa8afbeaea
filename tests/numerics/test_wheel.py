"""Wheels against closed forms and against brute force: where they touch, and whether they fit."""

import numpy as np
import pytest

from cmm_align.errors import GeometryError
from cmm_align.numerics.wheel import Wheel, centre_from_contact, distance_to_wheel, fill_of_wheel

SPHERE = Wheel(50.0)
TORUS = Wheel(50.0, 8.0, (0.0, 0.6, 0.8))
WHEELS = pytest.mark.parametrize("wheel", [SPHERE, TORUS], ids=["sphere", "torus"])


def directions(n=400, seed=1):
    v = np.random.default_rng(seed).standard_normal((n, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def away_from_the_flat_face(wheel, normals):
    return normals[np.abs(normals @ np.array(wheel.axis)) < 0.95]


def torus_points(wheel, n=700):
    """The skin of a torus about its centre, from its two angles."""
    a = np.array(wheel.axis)
    e = np.linalg.svd(a[None, :])[2][1:]
    ring, tube = np.meshgrid(np.linspace(0, 2 * np.pi, n), np.linspace(-np.pi / 2, np.pi / 2, n // 3))
    m = np.cos(ring)[..., None] * e[0] + np.sin(ring)[..., None] * e[1]
    r, big = wheel.tip_radius_mm, wheel.radius_mm - wheel.tip_radius_mm
    return ((big + r * np.cos(tube))[..., None] * m + (r * np.sin(tube))[..., None] * a).reshape(-1, 3)


def test_a_spherical_wheel_on_a_sphere_stands_on_a_sphere():
    n = directions()
    centres = 90.0 * n + centre_from_contact(SPHERE, n)
    np.testing.assert_allclose(np.linalg.norm(centres, axis=1), 140.0, rtol=1e-15)


@pytest.mark.parametrize("wheel", [Wheel(50.0, 8.0), TORUS], ids=["axis y", "tilted"])
def test_a_torus_touches_the_tangent_plane_and_nothing_beyond(wheel):
    """Brute force: the lowest point of the skin along n is the contact, on the plane through it."""
    skin = torus_points(wheel)
    for n in away_from_the_flat_face(wheel, directions(60)):
        centre = centre_from_contact(wheel, n[None, :])[0]
        height = (centre + skin) @ n
        # the skin is sampled: half a step of 1/110 rad on a circle of 50 mm sags 50 (1/220)^2 / 2
        assert 0.0 <= height.min() + 1e-12 <= 2 * 5.2e-4
        lowest = centre + skin[np.argmin(height)]
        assert np.linalg.norm(lowest) < 0.4


@WHEELS
def test_the_contact_lies_on_the_wheel(wheel):
    n = away_from_the_flat_face(wheel, directions())
    np.testing.assert_allclose(distance_to_wheel(wheel, -centre_from_contact(wheel, n)), 0.0, atol=1e-13)
    deeper = distance_to_wheel(wheel, -centre_from_contact(wheel, n) + 0.5 * n)
    np.testing.assert_allclose(deeper, -0.5, atol=1e-12)


@WHEELS
def test_the_surface_of_the_tool_centres_has_the_normal_of_the_contact(wheel):
    """By differences over a paraboloid: what lets a reader take the wheel off again."""

    def centre(x, y):
        n = np.stack([-0.01 * x, 0.01 * y, np.ones_like(x)], axis=1)
        n /= np.linalg.norm(n, axis=1, keepdims=True)
        return np.stack([x, y, 0.005 * x**2 - 0.005 * y**2], axis=1) + centre_from_contact(wheel, n), n

    x, y = np.random.default_rng(2).uniform(-10, 10, (2, 50))
    h = 1e-4
    du, dv = centre(x + h, y)[0] - centre(x - h, y)[0], centre(x, y + h)[0] - centre(x, y - h)[0]
    found = np.cross(du, dv)
    found /= np.linalg.norm(found, axis=1, keepdims=True)
    np.testing.assert_allclose(found, centre(x, y)[1], atol=1e-8)


@WHEELS
def test_the_fill_tells_whether_a_bowl_takes_the_wheel(wheel):
    """Brute force: with the fill below 1 no point near the contact is inside the wheel, above 1 some are."""
    n = np.array([[0.0, 0.0, 1.0]])
    for radius in (5.0, 7.5, 9.0, 45.0, 60.0):
        for turn in (0.0, 0.7):
            c, s = np.cos(turn), np.sin(turn)
            turn_xy = np.array([[c, -s], [s, c]])
            form = turn_xy @ np.diag([1 / radius, 0.5 / radius]) @ turn_xy.T
            x, y = np.meshgrid(np.linspace(-0.3, 0.3, 81), np.linspace(-0.3, 0.3, 81))
            xy = np.stack([x.ravel(), y.ravel()], axis=1)
            z = 0.5 * np.einsum("ni,ij,nj->n", xy, form, xy)
            rest = distance_to_wheel(wheel, np.column_stack([xy, z]) - centre_from_contact(wheel, n))
            fill = fill_of_wheel(wheel, n, (form[0, :1], form[0, 1:], form[1, 1:]))[0]
            assert (rest.min() < -1e-9) == (fill > 1.0), (radius, turn, fill)


def test_keeping_the_old_normals_costs_the_radius_times_half_the_square_of_the_tilt():
    """The relation: on a tilted plane the wheel of the old path comes this much too deep."""
    for tilt in (1e-3, 5e-3):
        new = np.array([[np.sin(tilt), 0.0, np.cos(tilt)]])
        old = np.array([[0.0, 0.0, 1.0]])
        too_deep = 50.0 - float((centre_from_contact(SPHERE, old) @ new.T)[0, 0])
        assert too_deep == pytest.approx(50.0 * tilt**2 / 2, rel=1e-5)
    assert too_deep == pytest.approx(0.625e-3, rel=1e-3)  # 5 mrad and 50 mm: 0.63 um


def test_a_torus_on_its_flat_face_is_refused():
    with pytest.raises(GeometryError, match="flat face"):
        centre_from_contact(Wheel(50.0, 8.0, (0.0, 0.0, 1.0)), np.array([[0.0, 0.0, 1.0]]))
