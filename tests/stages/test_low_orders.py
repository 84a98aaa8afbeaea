"""The ladder and the low orders against form errors whose answer is known."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from truth_maps import PLANE, WINDOW, Quadric, aligned, form_error_mm, random_places

from cmm_align.model import frozen_array
from cmm_align.model.monte_carlo import MonteCarlo, Spread
from cmm_align.numerics.aperture_basis import node_widths
from cmm_align.numerics.handed_noise import handed_noise
from cmm_align.numerics.local_regression import local_regression
from cmm_align.numerics.machine_error import error_factors, machine_error
from cmm_align.stages.low_orders import low_orders
from cmm_align.surfaces.geometry import unit_normal

DISK = Quadric(half_x=40.0, half_y=40.0, round=True)
BOWL = Quadric(half_x=40.0, half_y=40.0, c=0.005, d=0.003, round=True)
SPHERE_LIKE = Quadric(c=0.005, d=0.005, half_x=40.0, half_y=40.0, round=True)


def grid(surface, n=81):
    x = np.linspace(-surface.half_x, surface.half_x, n)
    y = np.linspace(-surface.half_y, surface.half_y, n)
    return x, y, *np.meshgrid(x, y)


def of_field(surface, field, n=81, noise=1e-4, **changes):
    """The low orders of a field known exactly on every node of a surface."""
    x, y, xg, yg = grid(surface, n)
    inside = surface.contains(xg.ravel(), yg.ravel()).reshape(xg.shape)
    alignment = aligned(surface, lambda u, _: 0 * u, random_places(surface, 10))
    report = replace(alignment.report, **changes)
    e = np.where(inside, field(xg, yg), np.nan)
    return low_orders(replace(alignment, report=report), x, y, e, np.full(e.shape, noise**2))


def kind(found, name):
    return next(k for k in found.kinds if k.name == name)


def motion(surface, twist):
    """The deviations that a small motion of the part makes, to first order."""

    def field(x, y):
        jet = surface.jet(x.ravel(), y.ravel())
        p = np.stack([x.ravel(), y.ravel(), jet.z], axis=1)
        return np.sum((np.cross(twist[:3], p) + twist[3:]) * unit_normal(jet, 1), axis=1).reshape(x.shape)

    return field


def polar(x, y, radius=40.0):
    return np.hypot(x, y) / radius, np.arctan2(y, x)


def test_a_rigid_motion_of_a_curved_surface_is_gone_after_the_second_rung():
    twist = np.array([2e-5, -1e-5, 3e-5, 1e-3, -2e-3, 4e-3])
    found = of_field(WINDOW, motion(WINDOW, twist))
    assert found.rungs[0].rms_um > 1.0
    assert found.rungs[1].pv_um < 1e-9
    assert found.words == "nothing beyond the rigid motion"
    assert found.rigid == "all six motions"


@pytest.mark.parametrize("axis_deg", [0.0, 31.0, 120.0])
def test_astigmatism_has_its_pv_and_its_axis_and_is_named(axis_deg):
    def field(x, y):
        r, t = polar(x, y)
        return 3.1e-3 * r**2 * np.cos(2 * (t - np.radians(axis_deg)))

    found = of_field(DISK, field)
    a = kind(found, "astigmatism")
    step = 1.0 / 40.0  # so far inside may the outer nodes lie, and r^2 falls twice as fast
    assert 6.2 * (1.0 - 2.0 * step) <= a.amplitude_um <= 6.2 * (1.0 + 1e-9)
    assert (a.angle_deg - axis_deg + 90.0) % 180.0 - 90.0 == pytest.approx(0.0, abs=1e-6)
    assert a.rms_um == pytest.approx(3.1 / np.sqrt(6.0), rel=2e-2)  # Noll 1976; border of a mask of squares
    assert a.share == pytest.approx(1.0)
    assert found.words == f"mostly astigmatism, 6.2 um, axis {axis_deg:.0f} deg"
    assert found.rungs[3].rms_um < 1e-9


@pytest.mark.parametrize(("name", "order", "axis_deg"), [("coma", 1, 250.0), ("trefoil", 3, 100.0)])
def test_coma_and_trefoil_point_where_the_border_is_highest(name, order, axis_deg):
    def field(x, y):
        r, t = polar(x, y)
        around = np.cos(order * (t - np.radians(axis_deg)))
        return 2e-3 * (r**3 if order == 3 else 3 * r**3 - 2 * r) * around

    found = of_field(DISK, field)
    k = kind(found, name)
    steepest = (
        7.0 / 40.0
    )  # coma falls by 9 - 2 per radius at the border, trefoil by 3; nodes lie a step inside
    assert 4.0 * (1.0 - steepest) <= k.amplitude_um <= 4.0 * (1.0 + steepest)
    assert k.angle_deg == pytest.approx(axis_deg, abs=1e-6)
    assert found.words.startswith(f"mostly {name}, ")


def test_power_is_positive_where_the_border_stands_higher():
    high = of_field(DISK, lambda x, y: 5e-3 * polar(x, y)[0] ** 2)
    low = of_field(DISK, lambda x, y: -5e-3 * polar(x, y)[0] ** 2)
    assert kind(high, "power").amplitude_um == pytest.approx(5.0)
    assert kind(low, "power").amplitude_um == pytest.approx(-5.0)
    assert kind(low, "power").angle_deg is None
    assert low.words == "mostly power, -5.0 um"


def test_turning_the_form_turns_the_angle_and_nothing_else_on_a_square_mask():
    square = Quadric(half_x=30.0, half_y=30.0)

    def field(x, y):
        return 1e-3 * (0.3 * x * y + 0.1 * x**2 + 0.002 * x**3 - 0.003 * x * y**2 + 0.05 * y**2) / 30.0

    straight, turned = of_field(square, field), of_field(square, lambda x, y: field(y, -x))
    for one, other in zip(straight.kinds, turned.kinds, strict=True):
        assert other.amplitude_um == pytest.approx(one.amplitude_um, rel=1e-9)
        if one.angle_deg is not None:
            period = {"astigmatism": 180.0, "coma": 360.0, "trefoil": 120.0}[one.name]
            turn = (other.angle_deg - one.angle_deg - 90.0 + period / 2) % period - period / 2
            assert turn == pytest.approx(0.0, abs=1e-7)
    assert [r.rms_um for r in turned.rungs] == pytest.approx([r.rms_um for r in straight.rungs])


@pytest.mark.parametrize("surface", [WINDOW, BOWL, DISK], ids=["window", "bowl", "disk"])
def test_rungs_are_nested_and_pvr_follows_its_definition(surface):
    _, _, xg, yg = grid(surface)
    found = of_field(surface, form_error_mm)
    rms = [rung.rms_um for rung in found.rungs]
    e = form_error_mm(xg, yg)[surface.contains(xg.ravel(), yg.ravel()).reshape(xg.shape)] * 1e3
    assert [rung.removed for rung in found.rungs][:2] == ["nothing", "rigid motion"]
    assert len(rms) == 6
    assert rms[0] == pytest.approx(np.sqrt(np.mean(e**2)))
    assert found.rungs[0].pv_um == pytest.approx(np.ptp(e))
    assert all(a >= b for a, b in pairwise(rms))
    assert found.rungs[-1].pvr_um == pytest.approx(3 * rms[-1])
    beyond = rms[1] ** 2 - rms[-1] ** 2  # Parseval
    assert sum(t.coefficient_um**2 for t in found.terms) == pytest.approx(beyond)


def test_36_terms_of_the_ladder_are_a_plain_least_squares_fit_of_polynomials_and_motions():
    _, _, xg, yg = grid(WINDOW)
    u, v = xg.ravel() / 51.0, yg.ravel() / 31.0
    twists = [motion(WINDOW, twist)(xg, yg).ravel() for twist in np.eye(6)]
    powers = [u**i * v**j for i in range(8) for j in range(8 - i)]
    columns = np.stack([*twists, *powers], axis=1)
    columns /= np.linalg.norm(columns, axis=0)
    e = form_error_mm(xg, yg).ravel()
    rest = (e - columns @ np.linalg.lstsq(columns, e, rcond=None)[0]) * 1e3
    found = of_field(WINDOW, form_error_mm)
    assert found.rungs[-1].rms_um == pytest.approx(np.sqrt(np.mean(rest**2)), rel=1e-6)
    assert found.rungs[0].pvr_um == pytest.approx(np.ptp(e * 1e3 - rest) + 3 * np.std(rest), rel=1e-6)


def test_a_motion_that_the_surface_cannot_tell_takes_no_shape_away_and_a_locked_one_is_removed():
    turned = motion(SPHERE_LIKE, np.array([0, 0, 1e-3, 0, 0, 0]))
    _, _, xg, yg = grid(SPHERE_LIKE)
    assert np.abs(turned(xg, yg)).max() < 1e-12  # a surface of revolution
    found = of_field(SPHERE_LIKE, form_error_mm)
    assert found.rigid == "5 of six motions; the others do not change the form"
    told = of_field(SPHERE_LIKE, form_error_mm, unobservable=("rotation about z",))
    assert told.rungs == found.rungs
    locked = of_field(WINDOW, motion(WINDOW, np.array([0, 0, 0, 0, 0, 5e-3])), locked=("tz",))
    assert "the fit held tz" in locked.rigid
    assert locked.rungs[0].rms_um > 1.0
    assert locked.rungs[1].rms_um < 1e-9


def test_words_say_when_no_kind_dominates_and_when_it_is_finer_than_the_low_orders():
    def mixed(x, y):
        r, t = polar(x, y)
        return 1e-3 * (1.2 * r**2 + 0.9 * r**2 * np.cos(2 * t) + 0.8 * r**3 * np.cos(3 * t))

    words = of_field(DISK, mixed).words
    assert words.startswith("no single kind dominates: ")
    assert "astigmatism 1.8" in words
    assert words.endswith(" um")
    ripple = of_field(DISK, lambda x, y: 1e-3 * np.cos(x) * np.cos(y)).words
    assert ripple.startswith("mostly finer than the low orders, 0.5")


def test_few_nodes_have_a_shorter_ladder():
    found = of_field(PLANE, lambda x, y: 1e-3 * x * y / 1e3, n=6)
    assert [rung.removed for rung in found.rungs] == [
        "nothing",
        "rigid motion",
        "+ power",
        "+ astigmatism",
        "+ coma and trefoil",
    ]
    assert found.words.startswith("mostly astigmatism")
    assert found.rungs[-1].pvr_um == pytest.approx(3 * found.rungs[-1].rms_um)
    tiny = of_field(PLANE, lambda x, y: 1e-3 * x / 50.0, n=2)
    assert [rung.removed for rung in tiny.rungs] == ["nothing"]
    assert tiny.words == "too few nodes for a word on the form"


def test_noise_that_is_not_known_leaves_the_numbers_and_no_uncertainty():
    found = of_field(DISK, form_error_mm, noise=np.nan)
    assert np.isfinite([t.coefficient_um for t in found.terms]).all()
    assert np.isnan([t.u_um for t in found.terms]).all()


def covered(surface, n_points, seeds):
    """Errors in standard uncertainties, of terms, of amplitudes and angles; RMS over its truth."""
    places = random_places(surface, n_points)
    x, y, xg, yg = grid(surface, int(np.sqrt(n_points) / 1.8))
    x, y = 0.985 * x, 0.985 * y
    weights = np.outer(
        node_widths(y, -surface.half_y, surface.half_y), node_widths(x, -surface.half_x, surface.half_x)
    )
    xg, yg = np.meshgrid(x, y)
    inside = surface.contains(xg.ravel(), yg.ravel()).reshape(xg.shape)
    bare = aligned(surface, form_error_mm, places)
    known = inside & np.isfinite(local_regression(*places, bare.deviation_mm, x, y).value)
    truth = low_orders(
        bare, x, y, np.where(known, form_error_mm(xg, yg), np.nan), np.zeros(known.shape), weights
    )
    noise = np.random.default_rng(7)
    terms, kinds, rms = [], [], []
    for _ in range(seeds):
        fit = local_regression(*places, bare.deviation_mm + 0.3e-3 * noise.standard_normal(n_points), x, y)
        noise2 = handed_noise(fit, known)
        found = low_orders(bare, x, y, np.where(known, fit.value, np.nan), noise2, weights)
        pairs = zip(found.terms, truth.terms, strict=True)
        terms.append([(f.coefficient_um - t.coefficient_um) / f.u_um for f, t in pairs])
        both = list(zip(found.kinds, truth.kinds, strict=True))
        kinds.append(
            [(f.amplitude_um - t.amplitude_um) / f.u_um for f, t in both]
            + [(f.angle_deg - t.angle_deg) / f.u_angle_deg for f, t in both if f.angle_deg is not None]
        )
        rms.append(found.rungs[0].rms_um)
    dense = random_places(surface, 400_000, 99)
    return (
        np.array(terms),
        np.array(kinds),
        np.array(rms) / np.sqrt(np.mean(form_error_mm(*dense) ** 2)) / 1e3,
    )


def share_inside(errors):
    return float(np.mean(np.abs(errors) <= 1.96))


def test_coefficients_lie_in_their_95_percent_intervals_about_as_often_as_stated():
    terms, kinds, _ = covered(WINDOW, 4000, 20)

    for errors in (terms, kinds):
        trials = errors.size if errors is terms else 20 * 4  # angles and amplitudes hang together
        low = 0.93 - 3 * np.sqrt(0.93 * 0.07 / trials)  # three standard deviations beside 93 and 97 %
        high = 0.97 + 3 * np.sqrt(0.97 * 0.03 / trials)
        assert low <= share_inside(errors) <= high


@pytest.mark.slow
@pytest.mark.parametrize("surface", [WINDOW, BOWL], ids=["window", "bowl"])
def test_300_seeds_hold_93_to_97_percent_of_the_coefficients_and_the_rms_within_1_percent(surface):
    terms, kinds, rms = covered(surface, 20_000, 300)

    assert 0.93 <= share_inside(terms) <= 0.97
    assert 0.92 <= share_inside(kinds) <= 0.98  # 8 numbers, 300 seeds: one standard deviation is 0.5 %
    assert np.abs(rms - 1.0).max() <= 0.01


def test_what_touches_have_in_common_adds_what_it_would_change():
    # By simulation: fields drawn from the machine's errors, each taken apart.
    constant_mm, slope = 0.7e-3, 1e-3 / 400.0
    none = Spread(0.0, 0.0, 0.0, 0.0, 0.0)
    record = MonteCarlo("0.7+L/400", 2.0, 0.5, 100, 1, 10, {}, {}, (), none, none)
    x, y, xg, yg = grid(WINDOW, 15)
    jet = WINDOW.jet(xg.ravel(), yg.ravel())
    bare = aligned(WINDOW, form_error_mm, random_places(WINDOW, 10))
    centre = bare.centroid_mm
    n = unit_normal(jet, 1)
    tips = np.stack([xg.ravel(), yg.ravel(), jet.z], axis=1) + bare.nominal.tip_radius_mm * n - centre
    factors, _ = error_factors(machine_error(constant_mm, slope), tips, n)
    fields = np.random.default_rng(5).standard_normal((100, len(factors))) @ factors
    alignment = replace(bare, report=replace(bare.report, monte_carlo=record))
    noise = np.zeros(xg.shape)
    stated = low_orders(alignment, x, y, form_error_mm(xg, yg), noise)
    drawn = [
        [t.coefficient_um for t in low_orders(bare, x, y, field.reshape(xg.shape), noise).terms]
        for field in fields
    ]
    ratio = np.std(drawn, axis=0) / [t.u_um for t in stated.terms]
    np.testing.assert_allclose(ratio, 1.0, atol=4.5 / np.sqrt(2 * 100))  # 100 draws tell a spread to 7 %
    assert kind(stated, "power").u_um > 0.05


def test_stages_change_nothing_they_were_given():
    x, y, xg, yg = grid(DISK, 21)
    inside = DISK.contains(xg.ravel(), yg.ravel()).reshape(xg.shape)
    e = frozen_array(np.where(inside, form_error_mm(xg, yg), np.nan))
    alignment = aligned(DISK, form_error_mm, random_places(DISK, 10))
    noise = frozen_array(np.full(e.shape, 1e-8))
    assert low_orders(alignment, x, y, e, noise) == low_orders(alignment, x, y, e, noise)
