"""Decentred and tilted terms against what they must be."""

import numpy as np
import pytest

from cmm_align.surfaces.terms import term_from_table

PLACES = np.random.default_rng(8).uniform(-12, 12, (2, 200))


def term(**table):
    return term_from_table(table, where="w")


def close(one, other, atol=1e-13):
    for a, b in zip(one, other, strict=True):
        np.testing.assert_allclose(a, b, rtol=0.0, atol=atol)


def about(axis, degrees):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    matrix = np.eye(3)
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    matrix[i, i] = matrix[j, j] = c
    matrix[i, j], matrix[j, i] = -s, s
    return matrix


def test_decentre_moves_the_vertex():
    moved = term(kind="conic", radius=50.0, conic=-0.5, decentre=[3.0, -2.0])
    there = term(kind="conic", radius=50.0, conic=-0.5)

    close(moved.jet(*PLACES), there.jet(PLACES[0] - 3.0, PLACES[1] + 2.0), atol=0.0)


@pytest.mark.parametrize("tilt", [[20.0, 0.0, 0.0], [0.0, -35.0, 10.0], [10.0, 12.0, 75.0]])
@pytest.mark.parametrize("radius", [40.0, -40.0])
def test_a_sphere_tilted_about_its_centre_is_the_same_sphere(tilt, radius):
    turn = about(0, tilt[0]) @ about(1, tilt[1]) @ about(2, tilt[2])
    vertex = np.array([0.0, 0.0, radius]) - turn @ [0.0, 0.0, radius]

    tilted = term(kind="conic", radius=radius, tilt_deg=tilt, decentre=list(vertex))

    close(tilted.jet(*PLACES), term(kind="conic", radius=radius).jet(*PLACES))


def test_a_tilted_plane_is_a_plane_with_its_slopes():
    plane = term(kind="conic", curvature=0.0, tilt_deg=[10.0, -25.0, 40.0], decentre=[1.0, 2.0])
    nx, ny, nz = (about(0, 10.0) @ about(1, -25.0))[:, 2]

    jet = plane.jet(*PLACES)

    np.testing.assert_allclose(jet.zx, -nx / nz, rtol=1e-14)
    np.testing.assert_allclose(jet.zy, -ny / nz, rtol=1e-14)
    np.testing.assert_allclose(jet.z, jet.zx * (PLACES[0] - 1.0) + jet.zy * (PLACES[1] - 2.0), atol=1e-14)
    close(jet[3:], np.zeros((3, 200)), atol=0.0)


def test_turning_about_x_right_handed_lifts_plus_y():
    assert term(kind="conic", curvature=0.0, tilt_deg=[5.0, 0.0, 0.0]).jet(np.zeros(1), np.ones(1)).z[0] > 0
    assert term(kind="conic", curvature=0.0, tilt_deg=[0.0, 5.0, 0.0]).jet(np.ones(1), np.zeros(1)).z[0] < 0


def test_points_of_the_term_turned_by_hand_lie_on_the_tilted_term():
    tilt, shift = [12.0, -9.0, 33.0], np.array([4.0, 5.0, 0.25])
    keys = {"kind": "zernike", "convention": "noll", "normalization_radius": 20.0}
    keys["coefficients"] = {"4": 0.4, "7": 0.3, "10": 0.2}
    own = np.array([*PLACES, term(**keys).jet(*PLACES).z])
    turned = (about(0, tilt[0]) @ about(1, tilt[1]) @ about(2, tilt[2]) @ own).T + shift

    found = term(**keys, tilt_deg=tilt, decentre=list(shift)).jet(turned[:, 0], turned[:, 1])

    np.testing.assert_allclose(found.z, turned[:, 2], atol=1e-13)


def test_an_off_axis_paraboloid_keeps_its_curvatures():
    # Gaussian curvature does not depend on the frame.
    keys = {"kind": "conic", "radius": 200.0, "conic": -1.0}
    own = term(**keys).jet(PLACES[0] + 90.0, PLACES[1])
    tilt = np.degrees(np.arctan(90.0 / 200.0))
    turn = about(1, tilt)
    points = turn @ np.array([PLACES[0] + 90.0, PLACES[1], own.z])

    found = term(**keys, tilt_deg=[0.0, tilt, 0.0]).jet(points[0], points[1])

    def gaussian(jet):
        return (jet.zxx * jet.zyy - jet.zxy**2) / (1.0 + jet.zx**2 + jet.zy**2) ** 2

    np.testing.assert_allclose(found.z, points[2], atol=1e-12)
    np.testing.assert_allclose(gaussian(found), gaussian(own), rtol=1e-11)


def test_a_place_that_the_tilted_term_does_not_reach_is_not_defined():
    tilted = term(kind="conic", radius=10.0, tilt_deg=[0.0, 20.0, 0.0])

    z = tilted.jet(np.array([0.0, 50.0]), np.zeros(2)).z

    assert np.isfinite(z[0])
    assert np.isnan(z[1])
