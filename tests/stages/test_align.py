import closed_forms as cf
import numpy as np
import pytest
from scipy.optimize import least_squares

from cmm_align.config import AlignConfig, OffsetConfig
from cmm_align.errors import GeometryError, NumericsError, UnitsError, WrongStageError
from cmm_align.model import Nominal, PointKind, PointSet
from cmm_align.pose import Pose, rotation_from_vector
from cmm_align.stages.align import align
from cmm_align.stages.offset import offset, surface_digest
from cmm_align.surfaces.geometry import unit_normal
from cmm_align.surfaces.prescription import prescription_from_toml

RADIUS = 1.5
WINDOW = """
schema = "cmm-align/prescription/1"
[aperture]
shape = "rectangle"
width = 102.0
height = 62.0
[[term]]
kind = "conic"
radius = -82.0
conic = -0.3
[[term]]
kind = "xy_polynomial"
coefficients = { "1,0" = 0.02, "3,0" = 2e-5, "2,1" = 1.5e-5, "0,3" = -2e-5, "2,0" = -8e-4 }
"""


def turned(*degrees):
    x, y, z = (rotation_from_vector(np.radians(d) * np.eye(3)[k]) for k, d in enumerate(degrees))
    return z @ y @ x


PAPER = Pose(turned(20, 10, 20), np.array([20.0, 10.0, 20.0]), "machine", "part")


@pytest.fixture(scope="module")
def window():
    return prescription_from_toml(WINDOW, "window.toml")


@pytest.fixture(scope="module")
def nominal(window):
    return offset(window, RADIUS)


@pytest.fixture(scope="module")
def grid_nominal(window):
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(-51, 51, 205), np.linspace(-31, 31, 125)))
    points = np.stack([x, y, window.jet(x, y).z], axis=1)
    return offset(PointSet.of(points, kind=PointKind.NOMINAL), RADIUS)


def tips(surface, x, y, deviation=0.0, side=1, radius=RADIUS):
    jet = surface.jet(x, y)
    height = radius + np.broadcast_to(deviation, x.shape)
    return np.stack([x, y, jet.z], axis=1) + height[:, None] * unit_normal(jet, side)


def places(n=4000, seed=1, half=(50.0, 30.0)):
    rng = np.random.default_rng(seed)
    return rng.uniform(-half[0], half[0], n), rng.uniform(-half[1], half[1], n)


def measured(points, pose=PAPER, kind=PointKind.TIP_CENTRE):
    return PointSet.of(pose.apply(points), kind=kind, source="part.csv")


def bare(surface, radius=RADIUS, side=1):
    """A nominal straight from a closed form, without the equidistant net."""
    flat = Pose.identity("surface", "part")
    return Nominal(surface, side, radius, flat, surface_digest(surface, side, flat))


def pose_error(alignment, truth=PAPER):
    """How far the found motion is from undoing the true one: mm over the window, rad."""
    left = (alignment.part_from_machine @ truth).matrix() - np.eye(4)
    return np.abs(left[:3, 3]).max(), np.abs(left[:3, :3]).max()


@pytest.mark.parametrize("which", ["nominal", "grid_nominal"])
def test_noise_free_points_come_home_from_the_papers_start(which, window, request):
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(-51, 51, 52), np.linspace(-31, 31, 32)))

    found = align(measured(tips(window, x, y)), request.getfixturevalue(which))

    # Grid nodes at 2 mm are knots of the 0.5 mm grid, so its spline is exact there.
    assert found.report.converged
    assert found.report.iterations <= 10
    assert 1e6 * np.ptp(found.deviation_mm) <= 1e-6  # nm
    assert pose_error(found)[0] < 1e-11
    assert pose_error(found)[1] < 1e-13
    on_the_border = 2 * 52 + 2 * 32 - 4  # there an edge that stands proud would be touched first
    assert np.count_nonzero(~found.used) == found.report.n_edge == on_the_border
    assert found.report.unobservable == ()


def test_the_optimum_is_the_one_scipy_finds(window, nominal):
    x, y = places(400)
    points = tips(window, x, y, 0.02 * np.sin(x / 11.0) + np.random.default_rng(2).normal(0, 0.003, x.size))
    found = align(measured(points), nominal)
    normals = found.part_from_machine.inverse().rotate(found.normals)
    centre = points.mean(axis=0)

    def deviations(parameters):
        motion = Pose(rotation_from_vector(parameters[:3]), parameters[3:], "part", "part")
        moved = motion.apply(points - centre) + centre
        return align(
            PointSet.of(moved, kind=PointKind.TIP_CENTRE), nominal, AlignConfig(max_iterations=0)
        ).deviation_mm

    brute = least_squares(
        deviations, np.zeros(6), x_scale=[1e-2] * 3 + [1.0] * 3, xtol=1e-14, ftol=1e-14, gtol=1e-14
    )

    np.testing.assert_allclose(
        np.sqrt(np.mean(brute.fun**2)), np.sqrt(np.mean(found.deviation_mm**2)), rtol=1e-12
    )
    np.testing.assert_allclose(brute.fun, found.deviation_mm, atol=1e-8)
    assert normals.shape == points.shape


def null_space_points(surface, n=200, size=0.005, seed=3):
    """NPL's exact data: deviations in the null space of J^T, so the identity is the optimum."""
    x, y = places(n, seed)
    jet = surface.jet(x, y)
    normal = unit_normal(jet, 1)
    feet = np.stack([x, y, jet.z], axis=1)
    rows = np.hstack([np.cross(feet, normal), normal])
    raw = np.random.default_rng(seed).normal(0, size, n)
    basis, _ = np.linalg.qr(rows)
    deviation = raw - basis @ (basis.T @ raw)
    deviation -= basis @ (basis.T @ deviation)
    return feet + (RADIUS + deviation)[:, None] * normal, deviation


def test_null_space_data_has_exactly_the_known_answer(window, nominal):
    points, deviation = null_space_points(window)

    found = align(measured(points), nominal)

    assert pose_error(found)[0] < 1e-11
    assert pose_error(found)[1] < 1e-13
    np.testing.assert_allclose(found.deviation_mm, deviation, atol=1e-12)


def test_a_bump_outwards_is_positive_from_both_sides(window):
    x, y = places()
    bump = 0.02 * np.exp(-((x - 10.0) ** 2 + (y + 5.0) ** 2) / 50.0)
    for side, name in ((1, "+z"), (-1, "-z")):
        nominal = offset(window, RADIUS, OffsetConfig(side=name))

        found = align(measured(tips(window, x, y, bump, side)), nominal)

        at = np.argmax(found.deviation_mm)
        assert np.hypot(x[at] - 10.0, y[at] + 5.0) < 3.0
        assert found.deviation_mm[at] > 0.015


def test_moving_the_measurement_changes_no_deviation(window, nominal):
    x, y = places(500)
    points = tips(window, x, y, 0.005 * np.sin(x / 5.0))
    here = align(measured(points, Pose.identity("machine", "part")), nominal)

    there = align(measured(points, PAPER), nominal)

    np.testing.assert_allclose(there.deviation_mm, here.deviation_mm, atol=1e-11)


def test_the_order_of_the_points_does_not_matter(window, nominal):
    x, y = places(700)
    points = tips(window, x, y, 0.005 * np.sin(x / 5.0))
    order = np.random.default_rng(4).permutation(len(points))

    one, other = align(measured(points), nominal), align(measured(points[order]), nominal)

    np.testing.assert_allclose(other.deviation_mm, one.deviation_mm[order], atol=1e-11)


def test_the_same_input_gives_the_same_bits(window, nominal):
    x, y = places(30_000)
    data = measured(tips(window, x, y, 0.005 * np.sin(x / 5.0)))

    one, other = align(data, nominal), align(data, nominal)

    np.testing.assert_array_equal(one.deviation_mm, other.deviation_mm)
    np.testing.assert_array_equal(one.part_from_machine.matrix(), other.part_from_machine.matrix())


def test_a_sample_first_then_all_ends_where_all_at_once_does(window, nominal):
    x, y = places(30_000)
    data = measured(
        tips(window, x, y, 0.01 * np.sin(x / 5.0) + np.random.default_rng(5).normal(0, 3e-4, x.size))
    )

    sampled = align(data, nominal, AlignConfig(coarse_points=2000))
    whole = align(data, nominal, AlignConfig(coarse_points=100_000))

    # Both end within a thousandth of the pose's own uncertainty.
    np.testing.assert_allclose(sampled.deviation_mm, whole.deviation_mm, atol=1e-7)


def test_contact_points_laid_on_the_nominal_need_no_second_motion(window, nominal):
    """The paper's equivalence check: the second transform is the identity."""
    x, y = places(2000)
    first = align(measured(tips(window, x, y)), nominal)
    contacts = PointSet.of(first.contact_part_mm, kind=PointKind.CONTACT, frame="part")

    second = align(contacts, nominal)

    matrix = second.part_from_machine.matrix() - np.eye(4)
    assert np.abs(matrix[:3, :3]).max() < 1e-9
    assert np.abs(matrix[:3, 3]).max() < 1e-8
    np.testing.assert_allclose(second.deviation_mm, first.deviation_mm, atol=1e-10)


def test_the_second_path_agrees(window, grid_nominal):
    x, y = places(3000)

    found = align(measured(tips(window, x, y, 0.01 * np.sin(x / 9.0))), grid_nominal)

    assert found.report.two_path_difference_nm < 10 * grid_nominal.quality.equidistant_error_pv_nm + 1e-3


def test_facets_keep_the_papers_method_and_its_error(window, grid_nominal):
    x, y = places(3000)
    data = measured(tips(window, x, y))

    found = align(data, grid_nominal, AlignConfig(distance="facet"))

    error_nm = 1e6 * np.ptp(found.deviation_mm)
    assert found.report.distance == "facet"
    assert 50.0 < error_nm < 1.5 * grid_nominal.quality.facet_error_pv_nm
    # The other path is the exact foot point: it sees the error of the facets.
    assert found.report.two_path_difference_nm == pytest.approx(error_nm, rel=0.6)


def test_points_outside_the_nominal_are_counted_and_do_not_steer(window, nominal):
    x, y = places(2000, half=(50.0, 30.0))
    good = tips(window, x, y)
    beyond = np.stack([np.full(50, 54.0), np.linspace(-20, 20, 50), np.full(50, -25.0)], axis=1)

    found = align(measured(np.vstack([good, beyond])), nominal)

    assert found.report.n_outside == 50
    assert not found.used[2000:].any()
    assert np.isnan(found.deviation_mm[2000:]).all()
    assert np.ptp(found.deviation_mm[:2000]) < 1e-9
    assert any("50 of 2050 points" in w for w in found.report.warnings)


@pytest.mark.parametrize(
    ("surface", "free"),
    [(cf.Plane(), 3), (cf.Sphere(radius_mm=-50.0), 3), (cf.Cylinder(), 2), (cf.Paraboloid(), 1)],
    ids=["plane", "sphere", "cylinder", "revolution"],
)
def test_free_motions_are_named_and_left_where_they_were(surface, free):
    x, y = places(1500, half=(14.0, 14.0))
    points = tips(surface, x, y)
    start = Pose(turned(0.5, -0.3, 2.0), np.array([0.5, 0.3, -0.4]), "machine", "part")

    found = align(measured(points, start), bare(surface))

    assert len(found.report.unobservable) == free
    assert np.ptp(found.deviation_mm) < 1e-9


def test_the_covariance_falls_with_the_noise_squared(window, nominal):
    x, y = places(2000)
    noise = np.random.default_rng(6).normal(size=x.size)

    small = align(measured(tips(window, x, y, 1e-4 * noise)), nominal)
    large = align(measured(tips(window, x, y, 3e-4 * noise)), nominal)

    np.testing.assert_allclose(np.diag(large.covariance), 9.0 * np.diag(small.covariance), rtol=1e-3)


def test_the_start_may_be_far_away(window, nominal):
    x, y = places(1000)
    far = Pose(turned(5, -5, 10), np.array([400.0, -300.0, 250.0]), "machine", "part")

    found = align(measured(tips(window, x, y), far), nominal)

    assert pose_error(found, far)[0] < 1e-9


def test_a_start_pose_is_used(window, nominal):
    x, y = places(1000)
    half_turn = Pose(turned(0, 0, 180.0), np.zeros(3), "machine", "part")

    found = align(measured(tips(window, x, y), half_turn), nominal, start=half_turn.inverse())

    assert np.ptp(found.deviation_mm) < 1e-9


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        (lambda p: p[:5], GeometryError, "5 points"),
        (lambda p: np.outer(np.arange(50.0), [1.0, 2.0, 3.0]), GeometryError, "on a line"),
        (lambda p: 0 * p + 1, GeometryError, "the same"),
        (lambda p: p / 25.4, UnitsError, "the points were inch"),
        (lambda p: p * 25.4, UnitsError, "the nominal were inch"),
        (lambda p: p / 1000.0, UnitsError, "the points were m "),
        (lambda p: p * 1000.0, UnitsError, "the points were um"),
        (lambda p: p * 3.0, GeometryError, "2.89 times the size"),
    ],
    ids=["five", "line", "one place", "inch", "inch nominal", "m", "um", "another part"],
)
def test_clouds_that_cannot_be_this_part_are_refused(window, nominal, change, error, words):
    x, y = places(500)

    with pytest.raises(error, match=words):
        align(measured(change(tips(window, x, y))), nominal)


def test_the_nominal_itself_is_no_measurement(window, nominal):
    x, y = places(500)
    itself = np.stack([x, y, window.jet(x, y).z], axis=1)

    with pytest.raises(WrongStageError, match="nominal itself"):
        align(PointSet.of(itself), nominal)
    with pytest.raises(WrongStageError, match="not measured"):
        align(PointSet.of(itself, kind=PointKind.NOMINAL), nominal)


def test_a_cloud_of_something_else_is_no_fit(nominal):
    rng = np.random.default_rng(7)

    with pytest.raises(NumericsError, match="no fit"):
        align(PointSet.of(rng.uniform(-30, 30, (500, 3)), kind=PointKind.TIP_CENTRE), nominal)


def test_too_few_iterations_are_not_called_a_result(window, nominal):
    x, y = places(500)

    with pytest.raises(NumericsError, match="not converged"):
        align(measured(tips(window, x, y, 0.1 * np.sin(x / 5.0))), nominal, AlignConfig(max_iterations=1))


def test_free_motions_of_a_sphere_stay_at_the_start(window):
    ball = bare(cf.Sphere(radius_mm=-50.0))
    x, y = places(800, half=(14.0, 14.0))
    shift = Pose(np.eye(3), np.array([3.0, 2.0, 1.0]), "machine", "part")

    found = align(measured(tips(ball.surface, x, y), shift), ball)

    assert np.abs(found.part_from_machine.rotation_vector_rad()).max() < 1e-9
    np.testing.assert_allclose(found.part_from_machine.translation_mm, [-3.0, -2.0, -1.0], atol=1e-7)
    assert found.report.pose_sigma["rz_urad"] == np.inf


def test_a_rough_nominal_does_not_make_a_free_motion_observable():
    rng = np.random.default_rng(9)
    x, y = (a.ravel() for a in np.meshgrid(np.arange(-15.0, 15.5), np.arange(-15.0, 15.5)))
    bowl = cf.Paraboloid()
    rough = np.stack([x, y, bowl.jet(x, y).z + rng.normal(0, 1e-4, x.size)], axis=1)
    nominal = offset(PointSet.of(rough, kind=PointKind.NOMINAL), RADIUS)
    u, v = places(1500, half=(13.0, 13.0))

    found = align(measured(tips(bowl, u, v), Pose.identity("machine", "part")), nominal)

    assert len(found.report.unobservable) == 1


def test_jitter_of_a_grid_is_no_error_of_its_surface(window):
    rng = np.random.default_rng(10)
    x, y = (a.ravel() for a in np.meshgrid(np.arange(-40.0, 40.5), np.arange(-25.0, 25.5)))
    x, y = x + rng.uniform(-0.01, 0.01, x.size), y + rng.uniform(-0.01, 0.01, y.size)

    nominal = offset(
        PointSet.of(np.stack([x, y, window.jet(x, y).z], axis=1), kind=PointKind.NOMINAL), RADIUS
    )

    u, v = places(3000, half=(39.0, 24.0))
    assert nominal.kind == "grid"
    assert 1e6 * np.ptp(nominal.surface.jet(u, v).z - window.jet(u, v).z) < 5.0
    assert nominal.quality.surface_error_pv_nm < 20.0


def scattered_errors(n, share, low, high, seed=11):
    rng = np.random.default_rng(seed)
    wrong = rng.permutation(n) < share * n
    return wrong, np.where(wrong, rng.uniform(low, high, n), 0.0)


@pytest.mark.parametrize("share", [0.01, 0.1, 0.3])
def test_gross_errors_do_not_steer_the_fit_and_are_listed(window, nominal, share):
    x, y = places(6000)
    noise = np.random.default_rng(12).normal(0.0, 3e-4, x.size)
    form = 0.01 * np.sin(x / 17.0) * np.cos(y / 11.0)
    wrong, error = scattered_errors(x.size, share, 0.1, 5.0)
    clean = align(measured(tips(window, x, y, form + noise)), nominal)

    found = align(measured(tips(window, x, y, form + noise + error)), nominal)

    moved = found.part_from_machine.apply(found.tip_centre_machine_mm[~wrong])
    apart = np.abs(np.sum((moved - clean.tip_centre_part_mm[~wrong]) * clean.normals[~wrong], axis=1))
    assert apart.max() < 5e-4  # the fit has lost up to 30 % of its points: a shift of form over sqrt(N)
    assert not found.used[wrong].any()
    assert found.report.n_outliers == wrong.sum() - np.count_nonzero(np.isnan(found.deviation_mm[wrong]))
    assert any("outliers were left out" in w for w in found.report.warnings)


def test_a_bump_is_form_not_an_outlier(window, nominal):
    x, y = places(6000)
    bump = 0.05 * np.exp(-((x - 10.0) ** 2 + y**2) / 40.0) + np.random.default_rng(1).normal(0, 3e-4, x.size)

    found = align(measured(tips(window, x, y, bump)), nominal)

    assert found.report.n_outliers == 0
    assert found.used.all()


def test_outliers_can_be_kept(window, nominal):
    x, y = places(2000)
    _, error = scattered_errors(x.size, 0.01, 0.5, 1.0)

    found = align(measured(tips(window, x, y, error)), nominal, AlignConfig(outliers="keep"))

    assert found.report.n_outliers == 0
    assert found.used.sum() + found.report.n_outside == 2000


def pose_chi_square(window, nominal, deviation_of, seeds):
    """Squared normalised pose errors about the centroid; six degrees of freedom each."""
    x, y = places(400)
    truth = Pose.identity("machine", "part")
    values, raised = [], []
    for seed in seeds:
        points = tips(window, x, y, deviation_of(seed, x, y))
        found = align(measured(points, truth), nominal)
        centre = points.mean(axis=0)
        error = found.part_from_machine
        motion = np.r_[error.rotation_vector_rad(), error.apply(centre[None])[0] - centre]
        values.append(motion @ np.linalg.solve(found.covariance, motion))
        raised.append(found.report.correlated)
    return np.array(values), np.array(raised)


@pytest.mark.slow
def test_the_covariance_is_honest_for_white_noise(window, nominal):
    seeds = range(500)
    values, raised = pose_chi_square(
        window, nominal, lambda s, x, _y: np.random.default_rng(s).normal(0.0, 1e-3, x.size), seeds
    )

    # Mean of chi-square with 6 degrees of freedom over 500 seeds: 6 +- sqrt(12 / 500) = 0.155; 4 sigma.
    assert values.mean() == pytest.approx(6.0, abs=0.62)
    assert raised.mean() < 0.02


def test_correlated_errors_raise_the_covariance(window, nominal):
    def waves(seed, x, y):
        rng = np.random.default_rng(seed)
        k, phase = rng.normal(0.0, 1 / 12.0, (8, 2)), rng.uniform(0, 2 * np.pi, 8)
        return 1e-3 * sum(np.sin(a * x + b * y + p) for (a, b), p in zip(k, phase, strict=True))

    values, raised = pose_chi_square(window, nominal, waves, range(12))

    assert raised.mean() > 0.9
    assert np.median(values) < 100.0  # 42; without the blocks it is 367


def test_the_minimum_zone_is_never_wider_than_least_squares_and_proves_itself(window, nominal):
    x, y = places(1500)
    form = 0.01 * np.sin(x / 17.0) * np.cos(y / 11.0) + np.random.default_rng(1).normal(0, 3e-4, x.size)
    data = measured(tips(window, x, y, form))
    squares = align(data, nominal, AlignConfig(outliers="keep"))

    zone = align(data, nominal, AlignConfig(outliers="keep", criterion="minimum-zone"))

    widest = np.abs(zone.deviation_mm).max()
    assert widest < np.abs(squares.deviation_mm).max()
    assert zone.report.certificate["zone_um"] == pytest.approx(1e3 * widest, rel=1e-12)
    assert zone.report.certificate["residual"] < 1e-9
    assert zone.report.criterion == "minimum-zone"


def test_the_least_stock_leaves_no_point_below_the_nominal(window, nominal):
    x, y = places(1500)
    form = 0.01 * np.sin(x / 17.0) * np.cos(y / 11.0)

    stock = align(
        measured(tips(window, x, y, form)), nominal, AlignConfig(outliers="keep", criterion="least-stock")
    )

    assert stock.deviation_mm.min() > -1e-9
    assert stock.report.certificate["zone_um"] == pytest.approx(1e3 * stock.deviation_mm.max(), rel=1e-9)
