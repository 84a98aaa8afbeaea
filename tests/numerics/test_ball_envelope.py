"""Where a ball comes to rest: closed forms, and a dilation on a fine raster as another way."""

import closed_forms as cf
import numpy as np
import pytest

from cmm_align.numerics.ball_envelope import ball_rest
from cmm_align.surfaces.protocol import Jet

TILT = np.deg2rad(40.0)
R = 1.5


def everywhere(x, y):
    return np.ones(np.shape(x), dtype=bool)


def groove(x, y):
    """z = |x| tan(tilt)."""
    zero = np.zeros(np.shape(x))
    return Jet(np.abs(x) * np.tan(TILT), np.sign(x) * np.tan(TILT), zero, zero, zero, zero)


def cone(x, y, up=1.0):
    """A hollow cone, or with up = -1 a pointed one."""
    rho = np.maximum(np.hypot(x, y), 1e-12)
    t = up * np.tan(TILT)
    return Jet(t * rho, t * x / rho, t * y / rho, t * y**2 / rho**3, -t * x * y / rho**3, t * x**2 / rho**3)


def wave(x, y, amplitude=0.4, length=4.0):
    """A wave along x whose valleys have a radius of curvature of 1.01 mm."""
    k = 2 * np.pi / length
    zero = np.zeros(np.shape(x))
    return Jet(
        amplitude * np.sin(k * x),
        amplitude * k * np.cos(k * x),
        zero,
        -amplitude * k**2 * np.sin(k * x),
        zero,
        zero,
    )


def test_in_a_groove_the_ball_rests_on_both_flanks():
    x = np.linspace(-3.0, 3.0, 41)

    rest = ball_rest(groove, everywhere, 1, R, x, 0.3 * x)

    np.testing.assert_allclose(rest.height_mm, np.abs(x) * np.tan(TILT) + R / np.cos(TILT), atol=1e-12)
    off_middle = x != 0.0
    expected = (x + np.sign(x) * R * np.sin(TILT))[off_middle]
    np.testing.assert_allclose(rest.x_mm[off_middle], expected, atol=1e-7)


def test_in_a_hollow_cone_the_ball_rests_on_a_ring():
    x = np.linspace(0.0, 2.0, 21)

    rest = ball_rest(cone, everywhere, 1, R, x, np.zeros(21))

    np.testing.assert_allclose(rest.height_mm, x * np.tan(TILT) + R / np.cos(TILT), atol=1e-9)


def test_on_a_point_the_ball_rolls_over_the_tip():
    x = np.linspace(0.0, 2.0, 21)
    on_tip = x < R * np.sin(TILT)

    rest = ball_rest(lambda u, v: cone(u, v, -1.0), everywhere, 1, R, x, np.zeros(21))

    exact = np.where(on_tip, np.sqrt(np.maximum(R**2 - x**2, 0.0)), R / np.cos(TILT) - x * np.tan(TILT))
    np.testing.assert_allclose(rest.height_mm, exact, atol=1e-6)


@pytest.mark.parametrize("side", [1, -1])
def test_a_ball_too_large_for_a_bowl_rests_on_a_circle_at_a_known_height(side):
    bowl = cf.Paraboloid(a_mm=side * 1.0, b_mm=side * 1.0)

    rest = ball_rest(bowl.jet, everywhere, side, R, np.zeros(1), np.zeros(1))

    # sqrt(r^2 - rho^2) = R at the contact, so E = (r^2 + R^2) / (2 R).
    assert side * rest.height_mm[0] == pytest.approx((R**2 + 1.0) / 2.0, abs=1e-10)
    assert np.hypot(rest.x_mm, rest.y_mm)[0] == pytest.approx(np.sqrt(R**2 - 1.0), abs=1e-4)


def test_a_ball_that_fits_touches_where_the_offset_says():
    bowl = cf.Paraboloid(a_mm=8.0, b_mm=5.0)
    rng = np.random.default_rng(1)
    u, v = rng.uniform(-4, 4, (2, 300))
    jet = bowl.jet(u, v)
    w = np.sqrt(1 + jet.zx**2 + jet.zy**2)

    rest = ball_rest(bowl.jet, everywhere, 1, R, u - R * jet.zx / w, v - R * jet.zy / w)

    np.testing.assert_allclose(rest.height_mm, jet.z + R / w, atol=1e-12)
    np.testing.assert_allclose(rest.x_mm, u, atol=1e-6)


def test_a_ball_larger_than_a_spherical_cup_rests_on_its_rim():
    cup, rim = cf.Sphere(radius_mm=1.2), 0.9

    def within(x, y):
        return np.hypot(x, y) <= rim

    x = np.array([0.0, 0.1, 0.3])
    rest = ball_rest(cup.jet, within, 1, R, x, np.zeros(3))

    edge = 1.2 - np.sqrt(1.2**2 - rim**2)
    np.testing.assert_allclose(rest.height_mm, edge + np.sqrt(R**2 - (rim - x) ** 2), atol=1e-6)


def test_past_the_border_the_ball_rolls_down_over_the_edge():
    def half(x, y):
        return x <= 0.0

    x = np.array([0.2, 0.8, 1.4, 1.6])
    rest = ball_rest(cf.Plane(a=0.0, b=0.0).jet, half, 1, R, x, np.zeros(4))

    np.testing.assert_allclose(rest.height_mm[:3], np.sqrt(R**2 - x[:3] ** 2), atol=1e-6)
    assert np.isnan(rest.height_mm[3])


def test_a_wave_with_narrow_valleys_agrees_with_a_dilation_on_a_fine_raster():
    x = np.linspace(-4.0, 4.0, 81)
    fine = np.linspace(-6.0, 6.0, 240_001)
    z = wave(fine, fine).z
    brute = np.array(
        [np.max(z + np.sqrt(np.maximum(R**2 - (fine - u) ** 2, 0.0)) - 9.0 * (abs(fine - u) > R)) for u in x]
    )

    rest = ball_rest(wave, everywhere, 1, R, x, np.zeros(81))

    # The raster misses the top by less than its step squared times the curvature: 1e-9 mm.
    np.testing.assert_allclose(rest.height_mm, brute, atol=2e-9)
    assert (rest.height_mm >= brute - 1e-12).all()


def test_a_surface_in_two_directions_agrees_with_a_dilation_on_a_raster():
    def egg_box(x, y):
        a, b = wave(x, y, 0.3), wave(y, x, 0.2, 3.0)
        return Jet(a.z + b.z, a.zx, b.zx, a.zxx, 0.0 * x, b.zxx)

    rng = np.random.default_rng(2)
    x, y = rng.uniform(-3, 3, (2, 40))
    step = 0.01
    grid = np.arange(-R, R, step)
    u, v = (a.ravel() for a in np.meshgrid(grid, grid))
    inside = np.hypot(u, v) < R
    u, v = u[inside], v[inside]
    brute = np.array(
        [np.max(egg_box(u + p, v + q).z + np.sqrt(R**2 - u**2 - v**2)) for p, q in zip(x, y, strict=True)]
    )

    rest = ball_rest(egg_box, everywhere, 1, R, x, y)

    assert (rest.height_mm >= brute - 1e-12).all()
    np.testing.assert_allclose(rest.height_mm, brute, atol=4 * step**2)
