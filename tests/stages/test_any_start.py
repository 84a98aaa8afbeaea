"""Parts laid on the table in any orientation and place, aligned without a start pose."""

import numpy as np
import pytest
from laid_anywhere import LARGEST_MM, NEAR_SYMMETRIC, RADIUS_MM, SQUARE, part_points, polynomial
from scipy.spatial.transform import Rotation

from cmm_align.errors import GeometryError
from cmm_align.model import PointKind, PointSet
from cmm_align.pose import Pose
from cmm_align.stages.align import align
from cmm_align.stages.offset import offset
from cmm_align.virtual.window import window

# The same optimum of the same points, whatever the start.
PLACE_MM, TURN_RAD = 1e-4, 1e-6


@pytest.fixture(scope="module")
def demo():
    return offset(window(), RADIUS_MM)


def somewhere(seed):
    rng = np.random.default_rng(seed)
    turn = Rotation.random(random_state=seed).as_matrix()
    return Pose(turn, rng.uniform(-LARGEST_MM, LARGEST_MM, 3), "machine", "part")


def laid(points, pose):
    return PointSet.of(pose.apply(points), kind=PointKind.TIP_CENTRE)


def same_optimum(points, pose, found, best):
    """Whether the points end where they end from the true pose."""
    there = found.part_from_machine.apply(pose.apply(points))
    home = best.part_from_machine.apply(points)
    turn = found.part_from_machine.rotation @ pose.rotation @ best.part_from_machine.rotation.T
    return np.abs(there - home).max() < PLACE_MM and Rotation.from_matrix(turn).magnitude() < TURN_RAD


@pytest.mark.parametrize(
    ("surface", "pv_mm", "poses"),
    [
        (window(), 0.027, 10),
        (polynomial(NEAR_SYMMETRIC), 0.009, 4),
        (polynomial(SQUARE, 'shape = "circle"\nradius = 30.0'), 0.01, 4),
    ],
    ids=["demo", "near symmetric", "round"],
)
def test_a_part_laid_anywhere_ends_in_the_best_optimum(surface, pv_mm, poses):
    nominal, points = offset(surface, RADIUS_MM), part_points(surface, n=4000, pv_mm=pv_mm)
    best = align(laid(points, Pose.identity("machine", "part")), nominal)

    for seed in range(poses):
        pose = somewhere(seed)

        found = align(laid(points, pose), nominal)

        assert found.report.converged
        assert same_optimum(points, pose, found, best), seed


def test_a_half_turn_on_the_table_is_found(demo):
    points = part_points(window(), n=3000)
    half_turn = Pose(np.diag([-1.0, -1.0, 1.0]), np.zeros(3), "machine", "part")

    found = align(laid(points, half_turn), demo)

    assert np.sqrt(np.mean(found.deviation_mm**2)) < 0.006


def test_half_a_window_is_found(demo):
    points = part_points(window(), n=3000, box=(-1.0, 0.0, -1.0, 1.0))
    best = align(laid(points, Pose.identity("machine", "part")), demo)

    for seed in range(3):
        pose = somewhere(seed)
        assert same_optimum(points, pose, align(laid(points, pose), demo), best)


def test_a_mirrored_cloud_is_refused_and_said_to_be_mirrored(demo):
    points = part_points(window(), n=3000) * [1.0, -1.0, 1.0]

    with pytest.raises(GeometryError, match="mirrored"):
        align(laid(points, somewhere(3)), demo)
