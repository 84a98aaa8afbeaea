"""The Monte Carlo against closed forms, and against fits that are not linear."""

from dataclasses import replace

import closed_forms as cf
import h5py
import numpy as np
import pytest
from truth import measured_window

from cmm_align.config import AlignConfig
from cmm_align.errors import GeometryError, UsageError
from cmm_align.io.records import read_record, write_record
from cmm_align.model import Nominal, PointKind, PointSet, frozen_array
from cmm_align.model.monte_carlo import MonteCarlo
from cmm_align.numerics.machine_error import common_covariance, error_factors, machine_error
from cmm_align.pose import Pose
from cmm_align.stages.align import align
from cmm_align.stages.monte_carlo import linear_refit, monte_carlo
from cmm_align.stages.offset import offset, surface_digest
from cmm_align.surfaces.geometry import unit_normal

MPE = "0.7+L/400"
ERROR = machine_error(0.7e-3, 1e-3 / 400.0)
KEEP = AlignConfig(outliers="keep")
RUNS = 2000
AXES = ("rx_urad", "ry_urad", "rz_urad", "tx_um", "ty_um", "tz_um")


def aligned(**measured):
    truth = measured_window(**measured)
    nominal = offset(truth.surface, truth.tip_radius_mm)
    return align(PointSet.of(truth.tip_centre_machine_mm, kind=PointKind.TIP_CENTRE), nominal, KEEP)


@pytest.fixture(scope="module")
def perfect():
    """A part without form error: the fit is Gauss-Newton's."""
    return aligned(pv_mm=0.0, lines=15, per_line=29)


@pytest.fixture(scope="module")
def part():
    """27 um of form error."""
    return aligned(lines=15, per_line=29)


@pytest.fixture(scope="module")
def simulated(part):
    return monte_carlo(part, MPE, RUNS)


def rows_and_covariance(alignment):
    """The change of each deviation with the pose (n, 6), and the exact covariance of the errors (n, n)."""
    arm = alignment.tip_centre_part_mm - alignment.centroid_mm
    n = alignment.normals
    errors = common_covariance(ERROR, arm, n, arm, n) + ERROR.white_mm2 * np.eye(len(n))
    return np.hstack([np.cross(arm, n), n]), errors


def assert_same_covariance(found, expected, runs):
    """A sample covariance of normal numbers differs from the true one by 1 / sqrt(runs) in each element."""
    low = np.linalg.cholesky(expected)
    whitened = np.linalg.solve(low, np.linalg.solve(low, found).T)
    error = np.sqrt((1.0 + np.eye(len(low))) / runs)
    assert np.all(np.abs(whitened - np.eye(len(low))) < 4.0 * error)


def test_pose_and_points_spread_as_the_closed_form_says(perfect):
    rows, errors = rows_and_covariance(perfect)
    gain = -np.linalg.solve(rows.T @ rows, rows.T)
    left = np.eye(len(rows)) + rows @ gain

    found, points = monte_carlo(perfect, MPE, RUNS)

    exact = gain @ errors @ gain.T
    assert_same_covariance(np.array(found.covariance), exact, RUNS)
    sigma = np.sqrt(np.diag(exact))
    for k, (name, unit) in enumerate([("rx_urad", 1e6), ("ry_urad", 1e6), ("rz_urad", 1e6), ("tx_um", 1e3)]):
        assert found.pose_sigma[name] == pytest.approx(unit * sigma[k], rel=4.0 / np.sqrt(2 * RUNS))
    np.testing.assert_array_equal(points.index, np.arange(len(rows)))
    of_points = np.sqrt(np.einsum("ij,jk,ik->i", left, errors, left))
    np.testing.assert_allclose(1e3 * points.sigma_mm, 1e3 * of_points, rtol=5.0 / np.sqrt(2 * RUNS))


def test_the_intervals_are_those_of_normal_numbers(simulated):
    found, _ = simulated
    # A quantile at 2.5 % of N normal numbers has the standard deviation sqrt(p (1 - p) / N) / density.
    error = np.sqrt(0.025 * 0.975 / RUNS) / 0.05845
    for name, sigma in found.pose_sigma.items():
        np.testing.assert_allclose(
            np.array(found.pose_interval[name]) / sigma,
            [-1.96, 1.96],
            atol=4.0 * np.hypot(error, 1.96 / np.sqrt(2 * RUNS)),
        )


def test_full_fits_find_the_pose_that_the_linear_one_does(part):
    index = np.flatnonzero(part.used)
    every = np.arange(len(part.deviation_mm))
    refit = linear_refit(part, every, part.used.astype(float))
    centre = part.tip_centre_part_mm[index].mean(axis=0)
    arm = part.tip_centre_part_mm - centre
    factors, sigma = error_factors(ERROR, arm, part.normals)
    normals_machine = part.part_from_machine.inverse().rotate(part.normals)
    scale = np.linalg.inv(np.linalg.cholesky(np.array(monte_carlo(part, MPE, RUNS)[0].covariance)))
    random = np.random.default_rng(4)
    for _ in range(5):
        errors = random.normal(size=len(factors)) @ factors + sigma * random.normal(size=len(every))
        linear = refit.to_part @ refit.response @ refit.push @ errors
        points = part.tip_centre_machine_mm + errors[:, None] * normals_machine

        full = align(
            PointSet.of(points, kind=PointKind.TIP_CENTRE), part.nominal, KEEP, start=part.part_from_machine
        )

        step = full.part_from_machine @ part.part_from_machine.inverse()
        moved = np.concatenate([step.rotation_vector_rad(), step.apply(centre[None])[0] - centre])
        # Second order: an error of 1 um beside radii of 80 mm, 1.3e-5, seen through motions of which the
        # weakest is 100 times weaker than the strongest: 1.3e-3 of the uncertainty, twice for tails.
        assert np.linalg.norm(scale @ (moved - linear)) < 3e-3
        after = part.deviation_mm + errors + np.hstack([np.cross(arm, part.normals), part.normals]) @ linear
        np.testing.assert_allclose(full.deviation_mm, after, atol=1e-6)  # 1 nm; errors are 1 um


def test_errors_add_to_the_mean_square_what_they_have(part, simulated):
    found, points = simulated

    measured = part.deviation_mm[part.used]
    assert found.pv.measured_um == pytest.approx(1e3 * np.ptp(measured), rel=1e-12)
    assert found.rms.measured_um == pytest.approx(1e3 * np.sqrt(np.mean(measured**2)), rel=1e-12)
    assert found.rms.bias_um > 0.0
    assert found.pv.low_um < found.pv.mean_um < found.pv.high_um
    # E[rms^2] = rms^2 + mean variance, exactly; the spread of the mean is std / sqrt(N).
    mean_square = found.rms.mean_um**2 + found.rms.std_um**2
    expected = found.rms.measured_um**2 + np.mean((1e3 * points.sigma_mm) ** 2)
    assert mean_square == pytest.approx(
        expected, abs=4.0 * 2.0 * found.rms.mean_um * found.rms.std_um / RUNS**0.5
    )


def test_pv_of_a_perfect_part_is_that_of_its_errors(perfect):
    rows, errors = rows_and_covariance(perfect)
    left = np.eye(len(rows)) - rows @ np.linalg.solve(rows.T @ rows, rows.T)
    random = np.random.default_rng(9)
    draws = random.normal(size=(1000, len(rows))) @ np.linalg.cholesky(errors).T @ left
    exact = 1e3 * np.ptp(draws, axis=1)

    found, _ = monte_carlo(perfect, MPE, 1000)

    error = np.hypot(found.pv.std_um, exact.std()) / np.sqrt(1000)
    assert found.pv.mean_um == pytest.approx(exact.mean(), abs=4.0 * error)
    assert found.pv.std_um == pytest.approx(exact.std(), rel=6.0 / np.sqrt(2000))  # a longer tail than normal
    assert found.pv.measured_um < 1e-5
    assert found.pv.bias_um == found.pv.mean_um - found.pv.measured_um


def test_the_same_seed_gives_the_same_bits_and_another_one_does_not(part, simulated):
    again, points = monte_carlo(part, MPE, RUNS)
    other, _ = monte_carlo(part, MPE, RUNS, 2)

    assert again == simulated[0]
    np.testing.assert_array_equal(points.sigma_mm, simulated[1].sigma_mm)
    assert other.covariance != again.covariance


def test_twice_the_statement_is_twice_the_uncertainty(part):
    one, _ = monte_carlo(part, MPE, 100)
    two, _ = monte_carlo(part, "1.4+L/200", 100)

    np.testing.assert_allclose(np.array(two.covariance), 4.0 * np.array(one.covariance), rtol=1e-6)


@pytest.mark.parametrize("mpe", ["0+L/250", "1.2", "0.7+L/400"])
@pytest.mark.parametrize("share", [0.0, 1.0])
def test_a_statement_may_lack_a_part(perfect, mpe, share):
    found, points = monte_carlo(perfect, mpe, 100, probe_share=share)

    assert np.linalg.eigvalsh(np.array(found.covariance)).min() > 0.0
    assert np.all(points.sigma_mm > 0.0)


@pytest.mark.parametrize(
    ("surface", "free"),
    [
        (cf.Plane(), AXES),
        (cf.Paraboloid(), ("rz_urad",)),
    ],
    ids=["tilted plane", "revolution"],
)
def test_free_motions_stay_unknown(surface, free):
    flat = Pose.identity("surface", "part")
    nominal = Nominal(surface, 1, 1.5, flat, surface_digest(surface, 1, flat))
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(-14, 14, 29), np.linspace(-14, 14, 29)))
    jet = surface.jet(x, y)
    tips = np.stack([x, y, jet.z], axis=1) + 1.5 * unit_normal(jet, 1)
    alignment = align(PointSet.of(tips, kind=PointKind.TIP_CENTRE), nominal, KEEP)

    found, _ = monte_carlo(alignment, MPE, 200)

    assert {name for name, sigma in found.pose_sigma.items() if np.isinf(sigma)} == set(free)
    assert {name for name, sigma in alignment.report.pose_sigma.items() if np.isinf(sigma)} == set(free)
    assert all(np.isinf(found.pose_interval[name]).all() for name in free)
    assert np.isfinite(found.covariance).all()


def test_locked_motions_have_no_uncertainty_and_the_others_have_less(perfect):
    rows, errors = rows_and_covariance(perfect)
    allowed = np.eye(6)[:, [0, 1, 3, 4, 5]]
    few = rows @ allowed
    gain = np.linalg.solve(few.T @ few, few.T)

    found, _ = monte_carlo(perfect, MPE, RUNS, motions=allowed)

    covariance = np.array(found.covariance)
    assert found.pose_sigma["rz_urad"] == 0.0
    assert np.abs(covariance[2]).max() == 0.0
    assert_same_covariance(allowed.T @ covariance @ allowed, gain @ errors @ gain.T, RUNS)


def test_a_point_without_weight_does_not_steer(perfect):
    half = perfect.tip_centre_part_mm[:, 0] > 0.0
    apart = replace(perfect, used=frozen_array(half, np.bool_))
    rows, errors = rows_and_covariance(apart)
    errors = errors[np.ix_(half, half)]
    gain = np.linalg.solve(rows[half].T @ rows[half], rows[half].T)

    found, points = monte_carlo(apart, MPE, RUNS)

    assert found.n_points == len(points.index) == len(half)
    assert_same_covariance(np.array(found.covariance), gain @ errors @ gain.T, RUNS)
    weighted, _ = monte_carlo(perfect, MPE, 100, weights=np.ones(len(half)))
    assert weighted == monte_carlo(perfect, MPE, 100)[0]


def test_of_many_points_a_sample_with_the_extremes_is_simulated(part):
    found, points = monte_carlo(part, MPE, 40, sample=200)

    assert 150 < len(points.index) <= 202
    assert np.all(np.diff(points.index) > 0)
    assert found.pv.measured_um == pytest.approx(1e3 * np.ptp(part.deviation_mm[part.used]), rel=1e-12)


def test_what_cannot_be_simulated_is_refused(part):
    report = replace(part.report, criterion="minimum-zone")
    with pytest.raises(UsageError, match="40 or more"):
        monte_carlo(part, MPE, 39)
    with pytest.raises(UsageError, match="least-squares"):
        monte_carlo(replace(part, report=report), MPE, 100)
    with pytest.raises(GeometryError, match="5 points"):
        monte_carlo(replace(part, used=frozen_array(np.arange(len(part.used)) < 5, np.bool_)), MPE, 100)


def test_the_result_can_be_recorded(simulated, tmp_path):
    with h5py.File(tmp_path / "record.h5", "w") as file:
        write_record(file.create_group("monte_carlo"), simulated[0])

        assert read_record(file, "monte_carlo", MonteCarlo) == simulated[0]
