"""Rational patches against the closed forms they are exact for."""

from __future__ import annotations

import closed_forms as cf
import numpy as np
import pytest

from cmm_align.errors import GeometryError
from cmm_align.numerics.knot_basis import knot_basis
from cmm_align.numerics.polygons import inside_polygons
from cmm_align.surfaces.nurbs import NurbsSurface

BEZIER2 = [0.0, 0.0, 0.0, 1.0, 1.0, 1.0]


def arc(start, end):
    """Rational quadratic arc of the unit circle: points (3, 2) and weights (3,)."""
    half = 0.5 * (end - start)
    middle = 0.5 * (start + end)
    points = [
        [np.cos(start), np.sin(start)],
        [np.cos(middle) / np.cos(half), np.sin(middle) / np.cos(half)],
        [np.cos(end), np.sin(end)],
    ]
    return np.array(points), np.array([1.0, np.cos(half), 1.0])


def circle(quarters=4):
    """Arcs of 90 degrees one after the other: points, weights and knots."""
    parts = [arc(0.5 * np.pi * k, 0.5 * np.pi * (k + 1)) for k in range(quarters)]
    points = np.concatenate([parts[0][0], *(p[0][1:] for p in parts[1:])])
    weights = np.concatenate([parts[0][1], *(p[1][1:] for p in parts[1:])])
    knots = np.concatenate([[0.0], np.repeat(np.arange(quarters + 1.0), 2), [quarters]])
    return points, weights, knots


def revolved(profile, profile_weights, around, around_weights):
    """Control points (nu, nv, 3) and weights of a profile (rho, h) turned about the axis h = z."""
    xy = around[:, None, :] * profile[None, :, :1]
    z = np.broadcast_to(profile[None, :, 1:], (*xy.shape[:2], 1))
    return np.concatenate([xy, z], axis=2), around_weights[:, None] * profile_weights[None, :]


def sphere_patch(radius=50.0, latitude=0.4, longitude=0.45):
    """A patch around the x axis of a ball, laid down so that x becomes z; vertex at the origin."""
    profile, pw = arc(-latitude, latitude)
    around, aw = arc(-longitude, longitude)
    control, weights = revolved(radius * profile, pw, around, aw)
    turned = control[..., [1, 2, 0]] - [0.0, 0.0, radius]
    return NurbsSurface.of((2, 2), BEZIER2, BEZIER2, turned, weights)


def cap_with_pole(radius=50.0, angle=0.6):
    """A whole cap of a ball about z: its pole is in the middle, vertex at the origin."""
    points, weights, knots = circle()
    profile, pw = arc(0.5 * np.pi - angle, 0.5 * np.pi)
    control, w = revolved(radius * profile, pw, points, weights)
    return NurbsSurface.of((2, 2), knots, BEZIER2, control - [0.0, 0.0, radius], w)


def torus_patch(major=80.0, minor=40.0, minor_angle=0.4, major_angle=0.2):
    """The outer top of a torus as in `closed_forms.Torus`."""
    profile, pw = arc(-minor_angle, minor_angle)
    around, aw = arc(-major_angle, major_angle)
    control, weights = revolved(minor * profile + [major, 0.0], pw, around, aw)
    turned = control[..., [1, 2, 0]] - [0.0, 0.0, major + minor]
    return NurbsSurface.of((2, 2), BEZIER2, BEZIER2, turned, weights)


def worst(patch, truth, x, y):
    """Largest errors of height, gradient and Hessian."""
    jet, exact = patch.jet(x, y), truth.jet(x, y)
    away = [float(np.abs(a - b).max()) for a, b in zip(jet, exact, strict=True)]
    return away[0], max(away[1:3]), max(away[3:])


@pytest.mark.parametrize(
    ("patch", "truth", "half"),
    [
        (sphere_patch(), cf.Sphere(radius_mm=-50.0), (18.0, 17.0)),
        (cap_with_pole(), cf.Sphere(radius_mm=-50.0), (19.0, 19.0)),
        (torus_patch(), cf.Torus(), (15.0, 14.0)),
    ],
    ids=["sphere", "sphere about its pole", "torus"],
)
def test_rational_patches_are_the_surfaces_they_stand_for(patch, truth, half, rng):
    x, y = rng.uniform(-1.0, 1.0, (2, 4000)) * np.array(half)[:, None]
    height, gradient, hessian = worst(patch, truth, x, y)
    assert height <= 1e-12
    assert gradient <= 1e-12
    assert hessian <= 1e-11
    assert patch.contains(x, y).all()


def test_a_cap_is_smooth_through_its_pole(rng):
    patch, truth = cap_with_pole(), cf.Sphere(radius_mm=-50.0)
    r, angle = 10.0 ** rng.uniform(-12.0, 0.0, 2000), rng.uniform(0.0, 2.0 * np.pi, 2000)
    x, y = np.append(r * np.cos(angle), 0.0), np.append(r * np.sin(angle), 0.0)
    height, gradient, hessian = worst(patch, truth, x, y)
    assert height <= 1e-12
    assert gradient <= 1e-12
    assert hessian <= 1e-9


def test_a_biquintic_graph_over_skew_parameters_is_exact(rng):
    """z = a polynomial of degree 5 in a sheared (x, y): its net comes from the Bernstein values."""
    coefficients = rng.normal(size=(6, 6)) / 30.0
    u, v = np.meshgrid(np.linspace(0.0, 1.0, 6), np.linspace(0.0, 1.0, 6), indexing="ij")
    knots = [0.0] * 6 + [1.0] * 6
    shear = np.array([[30.0, 4.0], [-3.0, 20.0]])
    xy = np.stack([u, v], axis=2) @ shear.T
    _, bernstein = knot_basis(np.array(knots), 5, np.linspace(0.0, 1.0, 6), 0)
    inverse = np.linalg.inv(bernstein[:, 0])
    values = np.polynomial.polynomial.polyval2d(u, v, coefficients)
    patch = NurbsSurface.of((5, 5), knots, knots, np.dstack([xy, inverse @ values @ inverse.T]))

    st = rng.uniform(0.02, 0.98, (2, 2000))
    x, y = shear @ st
    jet = patch.jet(x, y)

    def p(i, j):
        c = np.polynomial.polynomial.polyder(coefficients, i, axis=0)
        return np.polynomial.polynomial.polyval2d(*st, np.polynomial.polynomial.polyder(c, j, axis=1))

    back = np.linalg.inv(shear)
    gradient = back.T @ np.stack([p(1, 0), p(0, 1)])
    second = np.array([[p(2, 0), p(1, 1)], [p(1, 1), p(0, 2)]])
    hessian = np.einsum("ai,abn,bj->ijn", back, second, back)
    np.testing.assert_allclose(jet.z, p(0, 0), atol=1e-12)
    np.testing.assert_allclose([jet.zx, jet.zy], gradient, atol=1e-12)
    np.testing.assert_allclose(
        [jet.zxx, jet.zxy, jet.zyy], [hessian[0, 0], hessian[0, 1], hessian[1, 1]], atol=1e-12
    )


def test_derivatives_of_the_basis_agree_with_differences():
    knots = np.array([0.0, 0, 0, 0, 1, 1, 2.5, 4, 4, 4, 4])
    t = np.array([0.0, 0.3, 1.7, 2.5, 3.9, 4.0, 4.2, -0.1])
    first, values = knot_basis(knots, 3, t, 2)
    np.testing.assert_allclose(values[:, 0].sum(axis=1), 1.0, atol=1e-14)
    np.testing.assert_allclose(values[:, 1:].sum(axis=2), 0.0, atol=1e-12)
    h, inner = 1e-5, np.array([1, 2, 4])
    for sign_order in (1, 2):
        before, low = knot_basis(knots, 3, t[inner] - h, 2)
        after, high = knot_basis(knots, 3, t[inner] + h, 2)
        assert (before == after).all()
        slope = (high[:, sign_order - 1] - low[:, sign_order - 1]) / (2 * h)
        np.testing.assert_allclose(values[inner, sign_order], slope, atol=1e-8)
    assert (first >= 0).all()


def test_past_the_border_a_patch_continues_and_far_away_it_is_nan():
    patch, truth = sphere_patch(), cf.Sphere(radius_mm=-50.0)
    b = patch.bounds
    x = np.array([b.x_max + 0.3, 1000.0, np.nan])
    jet = patch.jet(x, np.zeros(3))
    assert abs(jet.z[0] - truth.jet(x[:1], np.zeros(1)).z[0]) <= 1e-12
    assert np.isnan(jet.z[1:]).all()
    assert not patch.contains(x, np.zeros(3)).any()


def test_an_outline_with_a_hole_is_followed():
    angle = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    net = np.array([[[-20.0, -20, 0], [-20, 20, 0]], [[20, -20, 0], [20, 20, 0]]])
    flat = NurbsSurface.of(
        (1, 1), [0, 0, 1, 1], [0, 0, 1, 1], net, loops_uv=[0.5 + 0.4 * ring, 0.5 + 0.1 * ring[::-1]]
    )
    r = np.array([0.0, 3.9, 4.1, 15.9, 16.1])
    assert flat.contains(r, 0.0 * r).tolist() == [False, False, True, True, False]
    np.testing.assert_allclose(flat.bounds, (-16, 16, -16, 16), atol=1e-3)


def test_places_are_sorted_into_many_bands_without_loss(rng):
    angle = np.linspace(0.0, 2.0 * np.pi, 5000, endpoint=False)
    star = (1.0 + 0.4 * np.cos(7 * angle))[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    x, y = rng.uniform(-1.5, 1.5, (2, 20000))
    r, phi = np.hypot(x, y), np.arctan2(y, x)
    away = np.abs(r - 1.0 - 0.4 * np.cos(7 * phi)) > 1e-4
    found = inside_polygons([star], x, y, 0.0)
    assert (found == (r < 1.0 + 0.4 * np.cos(7 * phi)))[away].all()


def test_a_patch_turned_on_its_side_is_no_height_field():
    patch = sphere_patch()
    upright = patch.turned(np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]))
    with pytest.raises(GeometryError, match=r"folds back|stands upright"):
        upright.jet(np.zeros(1), np.zeros(1))


def test_a_cone_is_refused_at_its_tip():
    points, weights, knots = circle()
    control, w = revolved(np.array([[20.0, -5.0], [0.0, 0.0]]), np.ones(2), points, weights)
    cone = NurbsSurface.of((2, 1), knots, [0, 0, 1, 1], control, w)
    with pytest.raises(GeometryError, match="comes to a tip at x = 0, y = 0"):
        cone.jet(np.array([5.0]), np.zeros(1))


def test_a_ramp_that_winds_over_itself_is_refused():
    points, weights, _ = circle()
    turns = np.concatenate([points, points[1:]])
    many = np.concatenate([weights, weights[1:]])
    knots = np.concatenate([[0.0], np.repeat(np.arange(9.0), 2), [8.0]])
    rise = np.linspace(0.0, 20.0, len(turns))
    control = np.stack([np.column_stack([r * turns, rise]) for r in (10.0, 20.0)], axis=1)
    ramp = NurbsSurface.of((2, 1), knots, [0, 0, 1, 1], control, many[:, None] * np.ones(2))
    with pytest.raises(GeometryError, match="lies over itself at x"):
        ramp.jet(np.array([15.0]), np.zeros(1))


@pytest.mark.parametrize(
    "change",
    [
        {"weights": np.zeros((3, 3))},
        {"knots_u": [0.0, 0, 1, 0, 1, 1]},
        {"knots_v": [0.0, 0, 0, 1, 1]},
        {"control_mm": np.full((3, 3, 3), np.nan)},
        {"degrees": (0, 2)},
    ],
)
def test_numbers_that_are_no_patch_are_refused(change):
    good = sphere_patch()
    parts = {"degrees": (2, 2), "knots_u": BEZIER2, "knots_v": BEZIER2}
    parts |= {"control_mm": good.control_mm, "weights": good.weights}
    with pytest.raises(GeometryError, match="not a patch"):
        NurbsSurface.of(**(parts | change))
