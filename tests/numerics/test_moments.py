"""The first step by the principal axes, and when it must not be taken."""

import closed_forms as cf
import numpy as np
import pytest
from laid_anywhere import RADIUS_MM, part_points
from scipy.spatial.transform import Rotation

from cmm_align.numerics.fit_steps import FitSettings
from cmm_align.numerics.moments import laid_by_moments
from cmm_align.numerics.steering import Placement
from cmm_align.surfaces.distance import facet_measure, light_net
from cmm_align.virtual.window import window

SIZE_MM = 119.4
# Axes of n places turn about the normal by s_x s_y / (s_x^2 - s_y^2) / sqrt(n) = 0.014 rad; four sigma.
TURN_RAD = 0.06
SETTINGS = FitSettings(SIZE_MM, 35.0, 1e-3, 50, np.radians(30.0), 1e-5)


def centred(points):
    return points - points.mean(axis=0)


def first_step(points, start, surface=None):
    net = light_net(surface or window(), 1, RADIUS_MM)
    return laid_by_moments(facet_measure(net, 1), centred(points), net.points_mm, start, SETTINGS)


@pytest.mark.parametrize("seed", range(5))
def test_a_cloud_that_covers_its_target_is_laid_near_it_in_one_step(seed):
    points = part_points(window())
    turn = Rotation.from_rotvec(np.random.default_rng(seed).uniform(-0.4, 0.4, 3)).as_matrix()
    start = Placement(turn, points.mean(axis=0) + np.array([20.0, -10.0, 20.0]))

    laid, looks = first_step(points, start)

    # Their centroid is off by the half width over sqrt(3 n), 0.4 mm along x; four sigma.
    assert len(looks) == 1
    assert np.linalg.norm(laid.position_mm - points.mean(axis=0)) < 2.0
    assert Rotation.from_matrix(laid.rotation).magnitude() < TURN_RAD
    assert np.linalg.det(laid.rotation) == pytest.approx(1.0, abs=1e-12)


def test_of_the_half_turns_that_nearest_to_the_start_is_taken():
    points = part_points(window())
    over = Placement(np.diag([-1.0, -1.0, 1.0]), points.mean(axis=0) + np.array([0.0, 0.0, 30.0]))

    laid, _ = first_step(points, over)

    assert Rotation.from_matrix(laid.rotation @ over.rotation.T).magnitude() < TURN_RAD


def test_stray_points_do_not_turn_the_axes():
    points = part_points(window(), strays=0.1)
    start = Placement(np.eye(3), points.mean(axis=0) + np.array([20.0, 10.0, 20.0]))

    laid, _ = first_step(points, start)

    assert Rotation.from_matrix(laid.rotation).magnitude() < TURN_RAD


@pytest.mark.parametrize(
    ("surface", "where", "away_mm"),
    [
        (None, {}, 0.0),
        (None, {"box": (-1.0, 0.0, -1.0, 1.0)}, 20.0),
        (cf.Sphere(radius_mm=-50.0), {}, 20.0),
    ],
    ids=["near already", "half the window", "axes alike"],
)
def test_where_the_axes_tell_nothing_the_start_stays(surface, where, away_mm):
    points = part_points(surface or window(), **where)
    start = Placement(np.eye(3), points.mean(axis=0) + np.array([0.0, 0.0, away_mm]))

    laid, looks = first_step(points, start, surface)

    assert laid is start
    assert looks == ()


def test_a_free_motion_is_not_moved():
    """A plane has no place of its own, although its outline has."""
    surface, rng = cf.Plane(), np.random.default_rng(1)
    x, y = rng.uniform(-20.0, 20.0, 4000), rng.uniform(-10.0, 10.0, 4000)
    net = light_net(surface, 1, 0.0)
    target = net.points_mm[np.abs(net.points_mm[:, 1]) <= 10.0]
    points = np.stack([x, y, surface.jet(x, y).z], axis=1)
    start = Placement(np.eye(3), points.mean(axis=0) + np.array([3.0, 2.0, 15.0]))

    laid, _ = laid_by_moments(facet_measure(net, 1), centred(points), target, start, SETTINGS)

    assert laid is start
