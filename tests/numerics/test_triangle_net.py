import numpy as np
import pytest
from scipy.spatial import Delaunay

from cmm_align.numerics.triangle_net import (
    facet_distance,
    grid_triangles,
    locate,
    triangle_net,
)


def delaunay(xy):
    """Counter-clockwise Delaunay triangles by Qhull, an independent route."""
    t = Delaunay(xy).simplices.astype(np.int32)
    a, b, c = (xy[t[:, k]] for k in range(3))
    area = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    return np.where(area[:, None] < 0, t[:, [0, 2, 1]], t)


def scattered_net(n=2000, seed=1):
    xy = np.random.default_rng(seed).uniform(0, 10, (n, 2))
    points = np.column_stack([xy, 0.1 * xy[:, 0] - 0.2 * xy[:, 1]])
    return points, triangle_net(points, delaunay(xy))


def test_walking_finds_the_triangle_that_scipy_finds():
    points, net = scattered_net()
    query = np.random.default_rng(2).uniform(-1, 11, (5000, 2))
    reference = Delaunay(points[:, :2])

    triangle, inside = locate(net, query[:, 0], query[:, 1])

    expected = reference.find_simplex(query)
    np.testing.assert_array_equal(inside, expected >= 0)
    found = np.sort(net.triangles[triangle[inside]], axis=1)
    wanted = np.sort(reference.simplices[expected[inside]], axis=1)
    np.testing.assert_array_equal(found, wanted)


def test_a_warm_start_gives_the_same_triangles():
    _, net = scattered_net()
    query = np.random.default_rng(3).uniform(0, 10, (1000, 2))
    cold, _ = locate(net, query[:, 0], query[:, 1])

    warm, inside = locate(net, query[:, 0] + 1e-9, query[:, 1], start=cold)

    assert np.mean(warm == cold) > 0.999
    assert inside.mean() > 0.97


def test_triangles_are_counter_clockwise_and_cover_the_grid():
    known = np.ones((5, 7), dtype=bool)
    x, y = np.meshgrid(np.arange(7.0), np.arange(5.0))
    triangles = grid_triangles(known)
    a, b, c = (np.column_stack([x.ravel(), y.ravel()])[triangles[:, k]] for k in range(3))
    area = 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])

    assert (area > 0).all()
    assert area.sum() == pytest.approx(24.0)


def test_a_missing_node_takes_one_triangle_of_each_cell_around_it():
    known = np.ones((4, 4), dtype=bool)
    known[1, 1] = False

    assert len(grid_triangles(known)) == 2 * 5 + 4
    assert grid_triangles(known).max() == 14


def test_facet_distance_to_a_plane_is_exact_inside_and_outside():
    _, net = scattered_net()
    normal = np.array([-0.1, 0.2, 1.0]) / np.sqrt(1.05)
    rng = np.random.default_rng(4)
    query = np.column_stack([rng.uniform(-3, 13, (500, 2)), rng.uniform(-1, 1, 500)])
    triangle, _ = locate(net, query[:, 0], query[:, 1])

    distance, normals = facet_distance(net, query, triangle)

    np.testing.assert_allclose(distance, query @ normal, atol=1e-9)
    np.testing.assert_allclose(normals, np.broadcast_to(normal, (500, 3)), atol=1e-9)
