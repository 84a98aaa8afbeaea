import closed_forms as cf
import numpy as np
import pytest
from laid_anywhere import NEAR_SYMMETRIC, NEARER_SYMMETRIC, SQUARE, Table, part_points, polynomial
from scipy.spatial.transform import Rotation

from cmm_align.numerics.linearisation import Placement, evaluate
from cmm_align.numerics.pose_batch import rotations_from_vectors, scores
from cmm_align.numerics.pose_evidence import independent_number, tie_factor
from cmm_align.numerics.pose_starts import first_guesses, principal_frame
from cmm_align.numerics.pose_verdicts import good_enough, is_mirrored, near_ties
from cmm_align.numerics.rotations import rotation_from_vector
from cmm_align.virtual.window import window

ROUND = 'shape = "circle"\nradius = 30.0'
SIXTY = 'shape = "rectangle"\nwidth = 60.0\nheight = 60.0'
LEFT, STRIP = (-1.0, 0.0, -1.0, 1.0), (-1.0, 1.0, -0.1, 0.1)
# What form error on a part of the window can hide in its weak motions: well within the right minimum.
BASIN = (0.05, 3.0)


@pytest.fixture(scope="module")
def demo():
    return Table(window())


def at_home(found, k=0):
    turn, shift = found.off(k)
    return turn < BASIN[0] and shift < BASIN[1]


def test_the_demo_window_is_found_from_thirty_poses(demo):
    points = part_points(window(), n=2000)

    for seed in range(30):
        found = demo.find(points, seed)

        assert at_home(found), seed
        assert found.candidates[0].rms_mm < 0.006
        assert found.candidates[0].inside == 1.0
        assert np.linalg.det(found.candidates[0].placement.rotation) == pytest.approx(1.0, abs=1e-12)
        assert near_ties(found.candidates) == ()


@pytest.mark.parametrize(
    ("surface", "where"),
    [
        (window(), {"box": LEFT}),
        (window(), {"box": STRIP}),
        (window(), {"strays": 0.1}),
        (window(), {"strays": 0.1, "box": LEFT}),
        (polynomial(NEAR_SYMMETRIC), {"pv_mm": 0.009}),
        (polynomial(SQUARE, SIXTY), {}),
        (polynomial(SQUARE, ROUND), {}),
    ],
    ids=["half", "strip", "strays", "half with strays", "near symmetric", "square", "round"],
)
def test_harder_parts_are_found_too(surface, where):
    points, table = part_points(surface, n=2000, **where), Table(surface)

    for seed in range(3):
        assert at_home(table.find(points, seed)), seed


def test_a_scan_that_reaches_beyond_the_window_is_found(demo):
    points = part_points(window(), n=2000)
    x, y = np.meshgrid(np.linspace(52.0, 80.0, 20), np.linspace(-30.0, 30.0, 20))
    table_top = np.stack([x.ravel(), y.ravel(), np.full(x.size, -30.0)], axis=1)

    found = demo.find(np.vstack([points, table_top]), 5)

    turn = Rotation.from_matrix(found.candidates[0].placement.rotation @ found.true_rotation.T).magnitude()
    assert turn < BASIN[0]
    assert found.candidates[0].rms_mm < 0.01


def test_a_window_that_the_form_error_makes_symmetric_is_a_near_tie():
    surface = polynomial(NEARER_SYMMETRIC)
    found = Table(surface).find(part_points(surface, n=2000, pv_mm=0.009), 2)

    assert at_home(found, 0) or at_home(found, 1)
    assert len(near_ties(found.candidates)) == 1


def test_the_same_input_gives_the_same_bits(demo):
    points = part_points(window(), n=1000)

    one, other = (demo.find(points, 4).candidates[0].placement for _ in range(2))

    np.testing.assert_array_equal(one.rotation, other.rotation)
    np.testing.assert_array_equal(one.position_mm, other.position_mm)


@pytest.mark.parametrize(
    "surface",
    [cf.Sphere(radius_mm=-50.0), cf.Plane(), cf.Paraboloid()],
    ids=["sphere", "plane", "revolution"],
)
def test_no_clocking_is_made_up(surface):
    table, points = Table(surface), part_points(surface, n=2000, pv_mm=0.001)
    start = Placement(rotation_from_vector(np.array([0.02, -0.03, 0.1])), points.mean(axis=0) + 0.3)
    centred = points - points.mean(axis=0)

    found = table.search(centred, start)

    turned = Rotation.from_matrix(found[0].placement.rotation @ start.rotation.T).magnitude()
    assert turned < 0.15  # at most the tilt of the start that the data do tell
    assert np.linalg.norm(found[0].placement.position_mm - start.position_mm) < 5.0


def test_a_mirrored_cloud_is_told_from_a_true_one(demo):
    points = part_points(window(), n=1500)
    true, mirrored = demo.find(points, 6), demo.find(points * [-1.0, 1.0, 1.0], 6)

    for found, answer in ((true, False), (mirrored, True)):
        assert (
            is_mirrored(
                demo.measure, found.points_mm, demo.net.points_mm, found.settings, found.candidates[0]
            )
            is answer
        )


def test_a_symmetric_surface_is_never_called_mirrored():
    surface = cf.Paraboloid(60.0, 90.0)
    table = Table(surface)
    found = table.find(part_points(surface, n=1500) * [-1.0, 1.0, 1.0], 7)

    assert not is_mirrored(
        table.measure, found.points_mm, table.net.points_mm, found.settings, found.candidates[0]
    )


@pytest.mark.parametrize(("surface", "enough"), [(window(), True), (polynomial(NEARER_SYMMETRIC), False)])
def test_a_fit_is_good_enough_if_nothing_else_can_be_better(surface, enough):
    table, points = Table(surface), part_points(surface, n=1500, pv_mm=0.02)
    centred = points - points.mean(axis=0)
    place = Placement(np.eye(3), points.mean(axis=0))
    settings = table.settings(centred)
    there = evaluate(table.measure, centred, place, settings.length_mm)

    assert good_enough(table.measure, centred, table.net.points_mm, place, there, settings) is enough


def test_first_guesses_are_proper_and_carry_the_centre_to_the_target():
    rng = np.random.default_rng(8)
    cloud = rng.uniform(-1.0, 1.0, (500, 3)) * [50.0, 30.0, 2.0]
    target = rng.uniform(-1.0, 1.0, (900, 3)) * [50.0, 30.0, 2.0] + [7.0, 8.0, 9.0]

    starts = first_guesses(cloud + 100.0, target)

    np.testing.assert_allclose(np.linalg.det(starts.rotations), 1.0, atol=1e-12)
    there = starts.rotations @ (principal_frame(cloud).centre_mm + 100.0) + starts.positions_mm
    np.testing.assert_allclose(there, np.broadcast_to(target.mean(axis=0), there.shape), atol=1e-9)


def test_strays_do_not_turn_the_principal_axes():
    rng = np.random.default_rng(9)
    cloud = rng.uniform(-1.0, 1.0, (500, 3)) * [50.0, 30.0, 2.0]
    strayed = cloud.copy()
    strayed[:50, 2] += rng.uniform(-20.0, 20.0, 50)

    normal, other = principal_frame(cloud).axes[:, 2], principal_frame(strayed).axes[:, 2]

    assert abs(normal @ other) > np.cos(0.1)


def test_many_rotation_vectors_are_turned_as_one_is():
    vectors = np.random.default_rng(10).normal(size=(20, 3)) * np.logspace(-9, 0.4, 20)[:, None]

    for vector, matrix in zip(vectors, rotations_from_vectors(vectors), strict=True):
        np.testing.assert_allclose(matrix, rotation_from_vector(vector), atol=1e-14)


def test_a_tenth_of_strays_is_not_heard_and_points_outside_are():
    distance = np.full((1, 100), 2.0)
    inside = np.ones((1, 100), dtype=bool)
    strayed = distance.copy()
    strayed[0, :10] = 1e6
    half = inside.copy()
    half[0, :50] = False

    assert scores(distance, inside)[0] == pytest.approx(2.0)
    assert scores(strayed, inside)[0] == pytest.approx(2.0)
    assert scores(distance, half)[0] == pytest.approx(4.0)


def test_white_noise_is_worth_all_its_points_and_form_error_a_few():
    rng = np.random.default_rng(11)
    x, y = rng.uniform(-1.0, 1.0, (2, 2000))
    places = np.stack([x, y, 0.0 * x], axis=1)

    assert independent_number(places, rng.normal(size=2000)) > 1000.0
    assert 2.0 < independent_number(places, x**2 - y**2) < 60.0
    assert tie_factor(1e6) < 1.0001
    assert tie_factor(10.0) > 1.5
