from dataclasses import replace

import closed_forms as cf
import numpy as np
import pytest
from scipy.spatial import cKDTree
from truth import DOME

from cmm_align.config import AlignConfig, OffsetConfig
from cmm_align.errors import UsageError, WrongStageError
from cmm_align.model import PointKind, PointSet
from cmm_align.numerics.icp_closest_point import best_motion
from cmm_align.numerics.reference_look_up import look_up_measure
from cmm_align.pose import Pose, rotation_from_vector
from cmm_align.stages.offset import offset
from cmm_align.stages.reference_methods import METHODS, reference_pose
from cmm_align.surfaces.distance import smooth_measure
from cmm_align.surfaces.equidistant import limits_of
from cmm_align.surfaces.geometry import principal_curvatures, slope, unit_normal
from cmm_align.surfaces.prescription import prescription_from_toml

RADIUS = 1.5
SMALL = Pose(rotation_from_vector(np.radians([0.05, -0.03, 0.04])), np.array([0.1, -0.08, 0.05]), "m", "part")
MOVED = replace(SMALL, target="machine")


def window_with(nodes):
    return offset(prescription_from_toml(DOME, "window.toml"), RADIUS, OffsetConfig(nodes=nodes))


@pytest.fixture(scope="module")
def nominal():
    return window_with(6000)


@pytest.fixture(scope="module")
def fine():
    return window_with(24_000)


def places(n=2500, seed=1):
    rng = np.random.default_rng(seed)
    return rng.uniform(-29, 29, n), rng.uniform(-19, 19, n)


def tips(surface, x, y, radius=RADIUS):
    jet = surface.jet(x, y)
    return np.stack([x, y, jet.z], axis=1) + radius * unit_normal(jet, 1)


def cloud(points, pose=MOVED, kind=PointKind.TIP_CENTRE):
    return PointSet.of(pose.apply(points), kind=kind)


def left_over_mm(found, points, nominal, pose=MOVED):
    """True deviations that noise-free points show at the pose found: all of it is error of the method."""
    laid = (found.part_from_machine @ pose).apply(points)
    return smooth_measure(nominal.surface, 1, RADIUS).distance(laid, None)[0].distance_mm


def rms(values):
    return float(np.sqrt(np.mean(values**2)))


def worst_curvature(surface):
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(-30, 30, 31), np.linspace(-20, 20, 21)))
    jet = surface.jet(x, y)
    return jet, np.abs(np.stack(principal_curvatures(jet, 1))).max(axis=0)


def spacing_on_the_surface_mm(nominal):
    """Step of the net, stretched by the slope and by the offset of a convex surface."""
    jet, k = worst_curvature(nominal.surface)
    h = max(nominal.quality.spacing_mm)
    return h * np.sqrt(1 + slope(jet).max() ** 2) * (1 + RADIUS * k.max()), k.max()


@pytest.mark.parametrize("method", METHODS)
def test_every_method_finds_a_proper_motion_and_the_same_one_again(method, nominal):
    points = cloud(tips(nominal.surface, *places(800)))

    found = reference_pose(method, points, nominal)
    again = reference_pose(method, points, nominal)

    assert found.converged, found.stop_reason
    assert found.method == method
    assert len(found.cost_history_mm2) >= found.iterations > 0
    assert found.own_rms_mm == np.sqrt(found.cost_history_mm2[-1])
    assert found.own_rms_mm <= np.sqrt(found.cost_history_mm2[0])
    np.testing.assert_allclose(np.linalg.det(found.part_from_machine.rotation), 1.0, atol=1e-14)
    assert (found.part_from_machine.target, found.part_from_machine.source) == ("part", "machine")
    np.testing.assert_array_equal(again.part_from_machine.matrix(), found.part_from_machine.matrix())


@pytest.mark.parametrize("method", ["facet", "point-to-plane"])
def test_facets_and_vertex_planes_err_by_the_square_of_their_spacing(method, nominal, fine):
    points = tips(nominal.surface, *places())

    coarse, good = (reference_pose(method, cloud(points), net) for net in (nominal, fine))
    errors = [rms(left_over_mm(f, points, net)) for f, net in ((coarse, nominal), (good, fine))]

    # Least squares project the error of the target on six motions, which makes none larger; that error is
    # at most h^2 k / 4: (diagonal)^2 k / 8 for a facet, k rho^2 / 2 with rho = half the diagonal for a plane.
    for error, net in zip(errors, (nominal, fine), strict=True):
        h, k = spacing_on_the_surface_mm(net)
        assert 0.0 < error <= h**2 * k / 4
    ratio = (nominal.quality.spacing_mm[0] / fine.quality.spacing_mm[0]) ** 2
    # The mean of b_i b_j over the places of N points scatters by some 1 / sqrt N.
    np.testing.assert_allclose(errors[0] / errors[1], ratio, rtol=5 / np.sqrt(len(points)))


def test_vertex_planes_and_facets_err_to_opposite_sides(nominal):
    points = tips(nominal.surface, *places())

    means = {
        method: left_over_mm(reference_pose(method, cloud(points), nominal), points, nominal).mean()
        for method in ("facet", "point-to-plane")
    }

    # Facets of a dome hang below it, and planes stand over it: the cloud sinks, or rises.
    assert means["facet"] < 0.0 < means["point-to-plane"]


def test_icp_is_exact_on_its_own_vertices(nominal):
    vertices = nominal.equidistant.points_mm[::7]

    small = Pose(rotation_from_vector(np.array([1e-3, -1e-3, 1e-3])), np.array([0.1, -0.1, 0.0]), "m", "part")
    # Nearer than half a step of 0.63 mm everywhere: 0.14 mm and 1.7 mrad x 36 mm = 0.06 mm.
    pose = replace(small, target="machine")
    found = reference_pose("icp", cloud(vertices, pose), nominal)

    np.testing.assert_allclose((found.part_from_machine @ pose).matrix(), np.eye(4), atol=1e-12)
    assert found.own_rms_mm < 1e-12
    assert found.stop_reason == "partners unchanged"


def test_icp_is_left_with_the_distance_to_the_next_vertex(nominal):
    surface = nominal.surface
    x, y = places()

    found = reference_pose("icp", cloud(tips(surface, x, y)), nominal)

    # Between the vertices of a rectangle a x b the mean square distance to the next is (a^2 + b^2) / 12. The
    # part is sloped: steps are h sqrt(1 + z_x^2) and h sqrt(1 + z_y^2) long, times 1 + r k on the offset.
    jet = surface.jet(x, y)
    h = nominal.quality.spacing_mm[0]
    stretch = 1 + RADIUS * np.mean(np.abs(np.stack(principal_curvatures(jet, 1))))
    expected = stretch * h * np.sqrt(np.mean(2 + slope(jet) ** 2) / 12)
    np.testing.assert_allclose(found.own_rms_mm, expected, rtol=0.05)
    # The truth has this cost or nearly: what was found is no worse, and still not the truth.
    tree = cKDTree(nominal.equidistant.points_mm)
    at_truth = rms(tree.query(tips(surface, x, y))[0])
    assert found.own_rms_mm <= at_truth * 1.01
    assert rms(left_over_mm(found, tips(surface, x, y), nominal)) > 1e-4


def test_the_best_motion_of_points_off_their_centre_is_the_one_they_have_made():
    points = np.random.default_rng(4).normal(size=(50, 3)) * [10.0, 5.0, 2.0] + [30.0, -20.0, 10.0]

    motion = best_motion(points, MOVED.apply(points))

    np.testing.assert_allclose(motion.rotation, MOVED.rotation, atol=1e-14)
    np.testing.assert_allclose(motion.position_mm, MOVED.translation_mm, atol=1e-12)


def test_mirrored_partners_do_not_make_a_mirrored_motion():
    rng = np.random.default_rng(4)
    points = rng.normal(size=(50, 3)) * [10.0, 5.0, 0.01]

    motion = best_motion(points, points * [1.0, 1.0, -1.0])

    np.testing.assert_allclose(np.linalg.det(motion.rotation), 1.0, atol=1e-14)


def test_the_vertical_look_up_is_exact_on_a_plane():
    plane = cf.Plane(a=0.9, b=-0.6)
    rng = np.random.default_rng(2)
    points = tips(plane, *rng.uniform(-15, 15, (2, 200)))

    feet, inside = look_up_measure(plane.jet, 1, RADIUS, limits_of(plane)).distance(points, None)

    assert inside.all()
    assert np.abs(feet.distance_mm).max() < 1e-14 * 50


@pytest.mark.parametrize("degrees", [10.0, 25.0, 40.0])
def test_the_bias_of_the_vertical_look_up_on_a_sphere(degrees):
    big, r, theta = 86.0, RADIUS, np.radians(degrees)
    ball = cf.Sphere(half_mm=80.0, radius_mm=-big)
    x = (big + r) * np.sin(theta)
    point = np.array([[x, 0.0, (big + r) * np.cos(theta) - big]])

    bias = look_up_measure(ball.jet, 1, r, limits_of(ball)).distance(point, None)[0].distance_mm[0]

    cos_below = np.sqrt(1 - (x / big) ** 2)  # the place of look-up stands at this angle on the sphere
    exact = ((big + r) * np.cos(theta) - big * cos_below) * cos_below - r
    np.testing.assert_allclose(bias, exact, atol=1e-13)
    # The rule of thumb, k r^2 tan^2 / 2, misses terms of the next order in r / R / cos^2.
    rule = -(r**2) * np.tan(theta) ** 2 / (2 * big)
    np.testing.assert_allclose(bias, rule, rtol=3 * r / big / np.cos(theta) ** 2)


def test_the_gradient_of_the_vertical_look_up_is_its_difference_quotient():
    surface = cf.Torus()
    measure = look_up_measure(surface.jet, 1, RADIUS, limits_of(surface))
    points = tips(surface, *np.random.default_rng(3).uniform(-15, 15, (2, 40)))
    feet, _ = measure.distance(points, None)

    step = 1e-5
    for k, unit in enumerate(np.eye(3)):
        up, down = (measure.distance(points + s * step * unit, None)[0].distance_mm for s in (1, -1))
        # The quotient errs by step^2 d''' / 6 and by rounding, 1e-14 / step.
        np.testing.assert_allclose(feet.normal[:, k], (up - down) / (2 * step), atol=1e-8)


def test_the_vertical_look_up_errs_by_the_square_of_radius_and_slope(nominal):
    x, y = places()
    points = tips(nominal.surface, x, y)
    found = reference_pose("xiong", cloud(points), nominal)
    error = rms(left_over_mm(found, points, nominal))

    jet, k = worst_curvature(nominal.surface)
    steepest = slope(jet).max()
    measure = look_up_measure(nominal.surface.jet, 1, RADIUS, limits_of(nominal.surface))
    bias = rms(measure.distance(points, None)[0].distance_mm)
    assert (
        1e-3 < bias < k.max() * RADIUS**2 * steepest**2 / 2 * (1 + 3 * RADIUS * k.max() * (1 + steepest**2))
    )
    assert 0.0 < error <= bias
    contacts = tips(nominal.surface, x, y, radius=0.0)
    exact = reference_pose("xiong", cloud(contacts, kind=PointKind.CONTACT), nominal)
    np.testing.assert_allclose((exact.part_from_machine @ MOVED).matrix(), np.eye(4), atol=1e-10)


def test_errors_of_estimated_normals_count_in_the_second_order(nominal):
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(-29, 29, 59), np.linspace(-19, 19, 39)))
    points = tips(nominal.surface, x, y)

    found = reference_pose("estimated-normals", cloud(points), nominal)

    # One-sided neighbourhoods of 24 points reach 5 mm; z''' there is below 6e-4 / mm^2: an angle below
    # z''' 25 / 6 = 2.5 mrad (with slopes), r angle^2 / 2 = 5 nm along the normal.
    assert rms(left_over_mm(found, points, nominal)) < 5e-6


@pytest.mark.parametrize("method", [m for m in METHODS if m != "icp"])
def test_the_papers_start_ends_where_a_small_one_does(method, nominal):
    axes = (rotation_from_vector(np.radians(d) * np.eye(3)[k]) for k, d in enumerate((20, 10, 20)))
    rx, ry, rz = axes
    far = Pose(rz @ ry @ rx, np.array([20.0, 10.0, 20.0]), "machine", "part")
    points = tips(nominal.surface, *places())

    near, home = (reference_pose(method, cloud(points, pose), nominal) for pose in (MOVED, far))
    started = reference_pose(
        method, cloud(points, far), nominal, start=near.part_from_machine @ MOVED @ far.inverse()
    )

    apart = (home.part_from_machine @ far).apply(points) - (near.part_from_machine @ MOVED).apply(points)
    # Kinks of facets and vertices leave a minimum that is sharp to some 1e-6 of the size only.
    exact = method in ("xiong", "estimated-normals")
    assert np.abs(apart).max() < (1e-9 if exact else 1e-4)
    assert started.iterations <= home.iterations


def test_points_beside_the_nominal_do_not_count_in_the_end(nominal):
    x, y = places()
    points = tips(nominal.surface, x, y)
    beside = points[np.abs(points[:, 0]) > 28][:20]
    beside = beside + np.stack(
        [8.0 * np.sign(beside[:, 0]), 0.0 * beside[:, 0], 0.5 + 0.0 * beside[:, 0]], axis=1
    )

    found = reference_pose("facet", cloud(np.concatenate([points, beside])), nominal)
    clean = reference_pose("facet", cloud(points), nominal)

    laid, alone = ((f.part_from_machine @ MOVED).apply(points) for f in (found, clean))
    assert np.abs(laid - alone).max() < 1e-4


def test_what_cannot_be_done_is_refused(nominal):
    points = tips(nominal.surface, *places(200))

    with pytest.raises(UsageError, match="point-to-plane"):
        reference_pose("guess", cloud(points), nominal)
    with pytest.raises(UsageError, match="net"):
        reference_pose("facet", cloud(points), replace(nominal, equidistant=None))
    with pytest.raises(WrongStageError):
        reference_pose("estimated-normals", cloud(points, kind=PointKind.CONTACT), nominal)


def test_a_fit_that_may_not_iterate_says_that_it_has_not_converged(nominal, monkeypatch):
    monkeypatch.setattr("cmm_align.stages.reference_methods.LEAST_ITERATIONS", 0)

    found = reference_pose(
        "icp", cloud(tips(nominal.surface, *places(300))), nominal, AlignConfig(max_iterations=2)
    )

    assert not found.converged
    assert found.stop_reason == "max iterations"
