"""Minimax fits against data whose optimum is known, and against other ways to find it."""

from dataclasses import replace

import closed_forms as cf
import numpy as np
import pytest
from scipy.optimize import linprog, minimize

from cmm_align.errors import InputError, NumericsError
from cmm_align.numerics.fit_steps import FitSettings, stepped
from cmm_align.numerics.linearisation import Measure, Placement, evaluate, moved, rows_of
from cmm_align.numerics.minimum_zone import least_stock, minimum_zone, within_tolerance
from cmm_align.numerics.rigid_fit import fit
from cmm_align.numerics.rotations import rotation_from_vector, vector_from_rotation
from cmm_align.surfaces.distance import facet_measure, light_net, smooth_measure
from cmm_align.surfaces.geometry import unit_normal

RADIUS = 1.5
HALF = 14.0
SURFACE = cf.Paraboloid(b_mm=-90.0)
MEASURE = smooth_measure(SURFACE, 1, RADIUS)
EPS = np.finfo(float).eps


class Case:
    """Tip centres over places with deviations, and the least-squares fit from a start that is off."""

    def __init__(self, x, y, deviation, *, surface=SURFACE, measure=MEASURE, scale=1.0, observability=1e-8):
        jet = surface.jet(x, y)
        normal = unit_normal(jet, 1)
        points = np.stack([x, y, jet.z], axis=1) + (scale * RADIUS + deviation)[:, None] * normal
        self.measure, self.n = measure, len(x)
        # The machine saw the part elsewhere: q = R^T (p - c) - shift, so that the truth is not the identity.
        self.truth_rotation = rotation_from_vector(np.array([0.02, -0.03, 0.05]))
        centre = points.mean(axis=0)
        self.points = (points - centre) @ self.truth_rotation
        self.truth = Placement(self.truth_rotation, centre)
        length = float(np.sqrt(np.mean(np.sum(self.points**2, axis=1))))
        size = 2.0 * np.sqrt(2.0) * surface.half_mm
        self.settings = FitSettings(size, length, 1e-14, 50, 0.3, observability)
        off = stepped(self.truth, 0.01 * length * np.array([1.0, -0.5, 0.3, 0.2, 0.4, -0.3]), length)
        self.fit = fit(measure, self.points, off, self.settings)
        assert self.fit.evaluation.used.all()

    def solve(self, function, **limits):
        return function(
            self.measure,
            self.points,
            self.fit.placement,
            self.settings,
            used=self.fit.evaluation.used,
            previous=self.fit.evaluation.feet,
            **limits,
        )

    def rows(self, placement, feet):
        p = moved(self.points, placement)
        return rows_of(p, placement, feet, self.settings.length_mm)[:6].T

    def distances(self, motion, placement, feet):
        there = stepped(placement, motion, self.settings.length_mm)
        return evaluate(
            self.measure, self.points, there, self.settings.length_mm, previous=feet
        ).feet.distance_mm

    def pose_error(self, found):
        turn = vector_from_rotation(found.placement.rotation @ self.truth.rotation.T)
        return np.abs(turn).max(), np.abs(found.placement.position_mm - self.truth.position_mm).max()


def places(rng, n):
    return rng.uniform(-HALF, HALF, (2, n))


def wavy(rng, n=400, size=0.01, **options):
    x, y = places(rng, n)
    return Case(x, y, size * np.sin(x / 5.0) * np.cos(y / 4.0) + rng.normal(0, size / 30, n), **options)


def balanced(rng, n, m):
    """Places, the first m of which carry signs and multipliers with ``sum l s J = 0``."""
    while True:
        x, y = places(rng, n)
        jet = SURFACE.jet(x[:m], y[:m])
        normal = unit_normal(jet, 1)
        feet = np.stack([x[:m], y[:m], jet.z], axis=1)
        rows = np.hstack([np.cross(feet, normal) / HALF, normal])
        null = np.linalg.svd(rows.T)[2][6:]
        weight = rng.normal(size=len(null)) @ null
        share = np.abs(weight) / np.abs(weight).sum()
        if share.min() > 0.1 / m:
            return x, y, np.sign(weight), share


@pytest.mark.parametrize("m", [7, 8, 11])
@pytest.mark.parametrize("n", [200, 3000])
def test_data_made_from_multipliers_give_exactly_the_known_zone(rng, n, m):
    t = 0.005
    x, y, sign, share = balanced(rng, n, m)
    deviation = rng.uniform(-0.9 * t, 0.9 * t, n)
    deviation[:m] = sign * t
    case = Case(x, y, deviation)

    found = case.solve(minimum_zone)

    assert found.converged
    assert abs(found.t_mm - t) <= 1e-9 * t
    # Feet are exact to a few ulp of the part's size.
    assert abs(found.t_mm - t) <= 64 * EPS * case.settings.size_mm
    turn, shift = case.pose_error(found)
    assert turn <= 1e-11
    assert shift <= 1e-10
    assert found.certificate_residual <= 1e-12
    assert abs(found.gap_mm) <= 1e-9 * t
    assert set(found.active) <= set(range(m))
    np.testing.assert_array_equal(found.sides, sign[found.active])
    assert found.multipliers.min() > 0
    assert found.multipliers.sum() == pytest.approx(1.0, abs=1e-14)
    if m == 7:  # the multipliers are unique then
        np.testing.assert_allclose(found.multipliers[np.argsort(found.active)], share, rtol=1e-8)
    np.testing.assert_allclose(found.evaluation.feet.distance_mm, deviation, atol=1e-12)


@pytest.mark.parametrize("allowance", [0.0, 0.002])
def test_data_made_from_multipliers_give_exactly_the_known_stock(rng, allowance):
    t = 0.012
    x, y, sign, _ = balanced(rng, 2000, 7)
    deviation = rng.uniform(allowance + 0.0005, t - 0.0005, x.size)
    deviation[:7] = np.where(sign > 0, t, allowance)
    case = Case(x, y, deviation)

    found = case.solve(least_stock, allowance_mm=allowance)

    assert found.converged
    assert abs(found.t_mm - t) <= 1e-9 * t
    assert found.broken_mm <= 64 * EPS * case.settings.size_mm
    assert found.certificate_residual <= 1e-12
    assert case.pose_error(found)[1] <= 1e-10
    assert set(found.active) == set(range(7))


@pytest.mark.parametrize("margin", [0.001, -0.002], ids=["fits", "does not fit"])
def test_data_made_from_multipliers_give_exactly_the_known_margin(rng, margin):
    x, y, sign, share = balanced(rng, 2000, 7)
    lower, upper = -rng.uniform(0.006, 0.008, x.size), rng.uniform(0.006, 0.009, x.size)
    deviation = rng.uniform(lower + 0.0012, upper - 0.0012)
    deviation[:7] = np.where(sign > 0, upper[:7] - margin, lower[:7] + margin)
    upper[10], lower[11] = np.inf, -np.inf
    case = Case(x, y, deviation)

    found = case.solve(within_tolerance, lower_mm=lower, upper_mm=upper)

    assert found.passes == (margin > 0)
    assert found.margin_mm == pytest.approx(margin, rel=1e-9)
    assert found.certificate_residual <= 1e-12
    np.testing.assert_allclose(found.multipliers[np.argsort(found.active)], share, rtol=1e-8)
    e = found.evaluation.feet.distance_mm
    assert np.minimum(upper - e, e - lower).min() == pytest.approx(found.margin_mm, abs=1e-15)


def infeasible_status(case, found, lower, upper, picked):
    """Ask a linear programme without an objective whether the picked points can keep their limits."""
    rows = case.rows(found.placement, found.evaluation.feet)[picked]
    d = found.evaluation.feet.distance_mm[picked]
    right = np.concatenate([upper[picked] - d, d - lower[picked]])
    keep = np.isfinite(right)
    return linprog(
        np.zeros(6), A_ub=np.vstack([rows, -rows])[keep], b_ub=1e3 * right[keep], bounds=[(None, None)] * 6
    ).status


def test_the_points_of_the_proof_conflict_and_none_of_them_is_idle(rng):
    case = wavy(rng)
    lower, upper = -0.005 + 0.001 * np.sin(np.arange(case.n)), np.full(case.n, 0.003)

    found = case.solve(within_tolerance, lower_mm=lower, upper_mm=upper)

    assert not found.passes
    assert found.proof_reach_mm > 0.5
    assert infeasible_status(case, found, lower, upper, found.active) == 2
    for k in range(len(found.active)):
        rest = np.delete(found.active, k)
        assert infeasible_status(case, found, lower, upper, rest) == 0
    # Nonlinear, too: as far as the proof reaches, no motion brings the active points inside.
    for motion in rng.normal(size=(300, 6)):
        reach = found.proof_reach_mm * rng.uniform(0.0, 0.9)
        step = reach * motion / np.linalg.norm(motion)
        e = case.distances(step, found.placement, found.evaluation.feet)[found.active]
        assert max((e - upper[found.active]).max(), (lower[found.active] - e).max()) > 0


def dense_successive(case, n_outer=8):
    """Minimum zone by the plainest route: every point in every linear programme, no Newton."""
    placement, feet = case.fit.placement, case.fit.evaluation.feet
    for _ in range(n_outer):
        now = evaluate(case.measure, case.points, placement, case.settings.length_mm, previous=feet)
        feet = now.feet
        rows, d = case.rows(placement, feet), feet.distance_mm
        unit = np.abs(d).max()
        one = np.ones((case.n, 1))
        found = linprog(
            [0, 0, 0, 0, 0, 0, 1],
            A_ub=np.vstack([np.hstack([rows, -one]), np.hstack([-rows, -one])]),
            b_ub=np.concatenate([-d, d]) / unit,
            bounds=[(None, None)] * 7,
        )
        placement = stepped(placement, unit * found.x[:6], case.settings.length_mm)
    last = evaluate(case.measure, case.points, placement, case.settings.length_mm, previous=feet)
    return float(np.abs(last.feet.distance_mm).max())


def test_the_zone_is_the_one_that_dense_programmes_find(rng):
    case = wavy(rng, 700)

    found = case.solve(minimum_zone)

    assert found.t_mm == pytest.approx(dense_successive(case), rel=1e-6)  # HiGHS takes 1e-7 by default
    assert found.t_mm < 0.95 * found.t_start_mm


def test_a_general_optimiser_finds_no_better_zone_or_stock(rng):
    case = wavy(rng, 60)
    zone, stock = case.solve(minimum_zone), case.solve(least_stock)
    feet = case.fit.evaluation.feet

    def distances(z):
        return 1e3 * case.distances(z[:6] * 1e-3, case.fit.placement, feet)

    start = np.r_[np.zeros(6), 1e3 * zone.t_start_mm]
    both = {"type": "ineq", "fun": lambda z: np.r_[z[6] - distances(z), z[6] + distances(z)]}
    above = {"type": "ineq", "fun": lambda z: np.r_[z[6] - distances(z), distances(z)]}
    options = {"maxiter": 300, "ftol": 1e-12}
    for limits, found in ((both, zone), (above, stock)):
        other = minimize(lambda z: z[6], start, method="SLSQP", constraints=limits, options=options)

        assert limits["fun"](other.x).min() > -1e-6
        assert found.t_mm <= 1e-3 * other.x[6] + 1e-8
        assert found.t_mm == pytest.approx(1e-3 * other.x[6], rel=1e-3)


@pytest.mark.parametrize("b", [60.0002, 60.002, -60.0])
def test_where_curvature_places_the_optimum_it_is_found_as_sharply(rng, b):
    """A bowl that is almost of revolution: fewer points than motions hold the zone."""
    surface = cf.Paraboloid(b_mm=b)
    case = wavy(rng, 300, surface=surface, measure=smooth_measure(surface, 1, RADIUS), observability=1e-20)

    found = case.solve(minimum_zone)

    assert found.converged
    assert found.certificate_residual <= 1e-12
    assert abs(found.gap_mm) <= 1e-9 * found.t_mm
    for size in (1e-4, 1e-2, 0.3):
        for motion in size * rng.normal(size=(30, 6)):
            d = case.distances(motion, found.placement, found.evaluation.feet)
            assert not np.abs(d).max() < found.t_mm


def test_the_curvature_is_the_second_derivative_of_the_weighted_excess(rng):
    case = wavy(rng)
    found = case.solve(minimum_zone)
    weight = found.multipliers * found.sides
    h = 0.05

    def value(motion):
        return weight @ case.distances(motion, found.placement, found.evaluation.feet)[found.active]

    pairs = [(i, j) for i in range(6) for j in range(6)]
    unit = h * np.eye(6)
    second = [
        value(unit[i] + unit[j])
        - value(unit[i] - unit[j])
        - value(unit[j] - unit[i])
        + value(-unit[i] - unit[j])
        for i, j in pairs
    ]

    smallest = np.linalg.eigvalsh(np.reshape(second, (6, 6)) / (4 * h * h))[0]

    assert found.curvature_per_mm == pytest.approx(smallest, rel=1e-3)


@pytest.mark.parametrize("function", [minimum_zone, least_stock], ids=lambda f: f.__name__)
@pytest.mark.parametrize(
    ("surface", "free"),
    [
        (cf.Plane(), 3),
        (cf.Sphere(radius_mm=-50.0), 3),
        (cf.Sphere(radius_mm=50.0), 3),
        (cf.Cylinder(), 2),
        (cf.Paraboloid(), 1),
    ],
    ids=["plane", "dome", "bowl", "cylinder", "revolution"],
)
def test_free_motions_stay_out_of_the_programme(rng, surface, free, function):
    case = wavy(rng, 500, surface=surface, measure=smooth_measure(surface, 1, RADIUS))

    found = case.solve(function)

    assert found.converged
    assert found.certificate_residual <= 1e-12
    assert len(found.active) <= 7 - free
    assert found.broken_mm <= 1e-13
    # The motion has no part along the free ones.
    motions = case.fit.spectral.motions[:, case.fit.spectral.free]
    turn = vector_from_rotation(found.placement.rotation @ case.fit.placement.rotation.T)
    shift = found.placement.position_mm - case.fit.placement.position_mm
    moved_by = np.concatenate([turn * case.settings.length_mm, shift])
    assert motions.shape[1] == free
    assert np.linalg.norm(motions.T @ moved_by) <= np.linalg.norm(moved_by) * 1e-2


def test_locked_motions_stay_locked(rng):
    case = wavy(rng)
    all_free = case.solve(minimum_zone)

    found = case.solve(minimum_zone, motions=np.eye(6)[:, [0, 1, 5]])

    assert found.certificate_residual <= 1e-12
    assert len(found.active) == 4
    assert all_free.t_mm < found.t_mm <= found.t_start_mm
    shift = found.placement.position_mm - case.fit.placement.position_mm
    turn = vector_from_rotation(found.placement.rotation @ case.fit.placement.rotation.T)
    np.testing.assert_allclose(shift[:2], 0.0, atol=1e-14)
    assert abs(turn[2]) <= np.linalg.norm(turn) ** 2  # turns about x and y make one about z, second order


def test_the_zone_is_never_wider_than_the_least_squares_one(rng):
    for n in (40, 1000):
        for size in (1e-7, 0.02):
            case = wavy(rng, n, size)

            found = case.solve(minimum_zone)

            assert found.t_mm <= found.t_start_mm
            assert found.t_start_mm == pytest.approx(
                np.abs(case.fit.evaluation.feet.distance_mm).max(), abs=1e-12
            )
            assert np.abs(found.evaluation.feet.distance_mm).max() == found.t_mm


def test_a_perfect_part_has_a_zone_of_rounding(rng):
    x, y = places(rng, 1000)
    case = Case(x, y, np.zeros(1000))
    rounding = 64 * EPS * case.settings.size_mm
    band = np.full(1000, 0.01)

    assert case.solve(minimum_zone).t_mm <= rounding
    assert case.solve(least_stock).t_mm <= rounding
    assert case.solve(within_tolerance, lower_mm=-band, upper_mm=band).margin_mm == pytest.approx(
        0.01, abs=rounding
    )


def test_a_start_that_is_far_off_ends_in_the_same_zone(rng):
    case = wavy(rng, 2000)
    near = case.solve(minimum_zone)
    step = np.array([0.5, -0.3, 0.2, 0.3, 0.4, 0.6])

    far = minimum_zone(
        case.measure, case.points, stepped(case.fit.placement, step, case.settings.length_mm), case.settings
    )

    assert far.t_start_mm > 0.3
    assert far.t_mm == pytest.approx(near.t_mm, rel=1e-9)


@pytest.mark.parametrize("factor", [1e-3, 1e3])
def test_another_unit_of_length_changes_nothing(rng, factor):
    x, y = places(rng, 500)
    deviation = 0.01 * np.sin(x / 5.0) * np.cos(y / 4.0)
    scaled = cf.Paraboloid(
        a_mm=SURFACE.a_mm * factor, b_mm=SURFACE.b_mm * factor, half_mm=SURFACE.half_mm * factor
    )
    here = Case(x, y, deviation)
    there = Case(
        factor * x,
        factor * y,
        factor * deviation,
        surface=scaled,
        measure=smooth_measure(scaled, 1, factor * RADIUS),
        scale=factor,
    )

    one, other = here.solve(minimum_zone), there.solve(minimum_zone)

    assert other.t_mm == pytest.approx(factor * one.t_mm, rel=1e-9)
    assert set(other.active) == set(one.active)


def test_the_order_of_the_points_does_not_matter_and_the_same_input_gives_the_same_bits(rng):
    x, y = places(rng, 3000)
    deviation = 0.01 * np.sin(x / 5.0) * np.cos(y / 4.0) + rng.normal(0, 3e-4, 3000)
    order = rng.permutation(3000)
    case, mixed = Case(x, y, deviation), Case(x[order], y[order], deviation[order])

    one, again, other = (c.solve(minimum_zone) for c in (case, case, mixed))

    assert one.t_mm == again.t_mm
    np.testing.assert_array_equal(one.placement.rotation, again.placement.rotation)
    assert other.t_mm == pytest.approx(one.t_mm, rel=1e-10)
    assert set(order[other.active]) == set(one.active)


def test_a_symmetric_band_has_the_minimum_zone_as_its_margin(rng):
    case = wavy(rng)
    zone = case.solve(minimum_zone)
    band = np.full(case.n, 0.02)

    found = case.solve(within_tolerance, lower_mm=-band, upper_mm=band)

    assert found.margin_mm == pytest.approx(0.02 - zone.t_mm, abs=1e-12)
    assert set(found.active) == set(zone.active)
    assert found.proof_reach_mm == 0.0


def test_limits_on_one_side_only_are_enough(rng):
    case = wavy(rng)

    found = case.solve(within_tolerance, lower_mm=np.zeros(case.n), upper_mm=np.full(case.n, np.inf))

    assert found.passes  # lift it off: material everywhere, as much as the way allows
    assert found.margin_mm > 1.0


def test_points_that_do_not_count_do_not_matter(rng):
    x, y = places(rng, 600)
    deviation = 0.01 * np.sin(x / 5.0) * np.cos(y / 4.0)
    whole = Case(x[:500], y[:500], deviation[:500])
    found = whole.solve(minimum_zone)
    deviation[500:] = 0.3
    used = np.arange(600) < 500
    other = Case(x, y, deviation)

    kept = minimum_zone(other.measure, other.points, other.truth, other.settings, used=used, previous=None)

    assert kept.t_mm == pytest.approx(found.t_mm, rel=1e-9)
    assert kept.active.max() < 500


def test_facets_have_a_zone_too(rng):
    net = light_net(SURFACE, 1, RADIUS, nodes=60)
    case = wavy(rng, 500, measure=facet_measure(net, 1))

    found = case.solve(minimum_zone)

    assert found.t_mm < found.t_start_mm
    assert found.t_mm == pytest.approx(wavy(rng, 500).solve(minimum_zone).t_mm, rel=0.2)
    assert found.curvature_per_mm == 0.0


@pytest.mark.parametrize(
    ("lower", "upper", "words"),
    [
        (np.zeros(39), np.ones(40), "shape"),
        (np.full(40, 0.1), np.zeros(40), "of point 0"),
        (np.full(40, np.nan), np.zeros(40), "of point 0"),
        (np.full(40, -np.inf), np.full(40, np.inf), "no point has"),
    ],
    ids=["shape", "crossed", "nan", "none"],
)
def test_limits_that_are_none_are_refused(rng, lower, upper, words):
    case = wavy(rng, 40)

    with pytest.raises(InputError, match=words):
        case.solve(within_tolerance, lower_mm=lower, upper_mm=upper)


def test_no_points_and_points_without_feet_are_refused(rng):
    case = wavy(rng, 40)
    blind = Measure(
        lambda p, previous: (
            (feet := MEASURE.distance(p, previous)[0])._replace(
                distance_mm=np.where(np.arange(len(p)) == 3, np.nan, feet.distance_mm)
            ),
            np.ones(len(p), dtype=bool),
        )
    )

    with pytest.raises(NumericsError, match="no point counts"):
        minimum_zone(MEASURE, case.points, case.truth, case.settings, used=np.zeros(40, dtype=bool))
    with pytest.raises(NumericsError, match="no foot"):
        minimum_zone(blind, case.points, case.truth, case.settings, used=np.ones(40, dtype=bool))


def test_too_few_iterations_are_said(rng):
    case = wavy(rng)

    found = minimum_zone(
        case.measure, case.points, case.fit.placement, replace(case.settings, max_iterations=0)
    )

    assert not found.converged
    assert found.stop_reason == "max iterations"
    assert found.t_mm == found.t_start_mm
