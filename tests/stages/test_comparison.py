"""What changed between two measurements, against changes that are known and noise that is nothing else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from truth_maps import WINDOW, Quadric, aligned, form_error_mm, random_places

from cmm_align.config import ErrorMapConfig
from cmm_align.errors import GeometryError, InputError, UsageError, WrongStageError
from cmm_align.stages.comparison import compare
from cmm_align.stages.error_map import error_map
from cmm_align.surfaces.geometry import unit_normal

CONFIG = ErrorMapConfig()
NOISE_MM = 0.3e-3
N = 4000


def nothing(x, y):
    return np.zeros_like(x)


def changed_by(change, *, before=form_error_mm, n=N, noise_mm=NOISE_MM, seed=0, surface=WINDOW, after=None):
    """Compare two measurements of one form at other places, with other noise."""
    late = after or (lambda x, y: before(x, y) + change(x, y))
    a = aligned(surface, late, random_places(surface, n, seed), noise_mm=noise_mm, seed=100 + seed)
    b = aligned(surface, before, random_places(surface, n, seed + 1), noise_mm=noise_mm, seed=200 + seed)
    return compare(error_map(a, CONFIG), b, CONFIG, names=("late", "early"))


def bump(x, y, height=3e-3, at=(12.0, -6.0), width=5.0):
    return height * np.exp(-((x - at[0]) ** 2 + (y - at[1]) ** 2) / (2 * width**2))


def power(x, y):
    """Zernike's power over the circle around the nodes: another piston would be no rigid motion here."""
    return 0.5e-3 * (2.0 * (x**2 + y**2) / 59.2**2 - 1.0)


def rigid(x, y):
    """10 um along z and a tilt, as the normal sees them."""
    jet = WINDOW.jet(x, y)
    n = unit_normal(jet, 1)
    points = np.stack([x, y, jet.z], axis=1)
    return n @ np.array([0.0, 0.0, 10e-3]) + np.cross(points, n) @ np.array([5e-5, -3e-5, 0.0])


@pytest.mark.parametrize(
    ("form", "n"), [(nothing, 1000), pytest.param(form_error_mm, 4000, marks=pytest.mark.slow)]
)
def test_noise_alone_is_no_change_over_50_seeds(form, n):
    places = [random_places(WINDOW, n, seed) for seed in range(2)]
    found = []
    for seed in range(50):
        a = aligned(WINDOW, form, places[0], noise_mm=NOISE_MM, seed=300 + seed)
        b = aligned(WINDOW, form, places[1], noise_mm=NOISE_MM, seed=400 + seed)
        found.append(compare(error_map(a, CONFIG), b, CONFIG).change)
    # 1 % of the seeds may have a node, and 1 % a whole: more than 3 of 50 come with a chance under 0.2 %
    assert sum(c.share_changed > 0.0 for c in found) <= 3
    assert sum(not c.rungs[0].noise for c in found) <= 3
    assert np.mean([c.share_changed for c in found]) < 1e-3
    assert not any(c.worse_than_before or c.better_than_before for c in found)
    for k in range(len(found[0].bands)):
        ratio = np.mean([(c.bands[k].rms_um / c.bands[k].expected_rms_um) ** 2 for c in found])
        spread = np.sqrt(2.0 / found[0].bands[k].freedom / 50)
        assert ratio == pytest.approx(1.0, abs=4.0 * spread + 0.1)  # the noise is known to 5 %


def test_no_change_is_said_with_both_numbers():
    change = changed_by(nothing).change
    assert not change.real
    assert len(change.words) == 1
    assert "no change beyond the noise" in change.words[0]
    assert change.rungs[1].rms_um == pytest.approx(change.rungs[1].expected_rms_um, rel=0.15)


def test_a_bump_is_found_where_it_is_with_its_size_and_nothing_else_is():
    c = changed_by(bump)
    d = c.change.difference
    assert d.max_mm == pytest.approx(3e-3, abs=4 * np.nanmedian(c.u_mm))
    assert np.hypot(d.max_at_mm[0] - 12.0, d.max_at_mm[1] + 6.0) < 2 * c.change.spacing_mm
    x, y = np.meshgrid(c.x_mm, c.y_mm)
    r = np.hypot(x - 12.0, y + 6.0)
    assert c.changed[r < 5.0].all()
    assert c.changed[r > 20.0].mean() < 0.01
    assert c.change.real
    assert c.change.form_changed
    assert not c.change.rungs[-1].noise


def test_a_rigid_motion_is_that_and_nothing_more():
    c = changed_by(rigid)
    assert not c.change.rungs[0].noise
    assert all(rung.noise for rung in c.change.rungs[1:])
    assert c.change.real
    assert not c.change.form_changed
    assert c.change.share_changed == 0.0
    assert "its form has not changed" in c.change.words[-1]
    assert c.change.difference.rms_mm == pytest.approx(
        np.sqrt(np.mean(rigid(*random_places(WINDOW, 20_000)) ** 2)), rel=0.03
    )


def test_power_is_named_and_the_rest_is_noise():
    change = changed_by(power).change
    noise = {rung.removed: rung.noise for rung in change.rungs}
    assert not noise["nothing"]
    assert not noise["rigid motion"]
    assert noise["+ power"]
    assert "without rigid motion and power is noise" in change.words[-1]
    assert [band.significant for band in change.bands] == [True, False, False][: len(change.bands)]


def test_a_ripple_shows_in_its_band_only():
    def ripple(x, y):
        return 1e-3 * np.sin(2 * np.pi * x / 8.0) * np.exp(-(x**2 + y**2) / (2 * 10.0**2))

    change = changed_by(ripple, n=20_000).change
    assert [(band.name, band.significant) for band in change.bands] == [
        ("low orders", False),
        ("middle", False),
        ("fine", True),
    ]


def test_better_and_worse_are_said_in_both_directions():
    better = changed_by(None, after=lambda x, y: 0.2 * form_error_mm(x, y)).change
    worse = changed_by(None, before=lambda x, y: 0.2 * form_error_mm(x, y), after=form_error_mm).change
    assert better.better_than_before
    assert not better.worse_than_before
    assert worse.worse_than_before
    assert not worse.better_than_before
    assert better.rms_change_um == pytest.approx(-worse.rms_change_um, rel=0.02)
    assert any(text.startswith("WORSE than before, outside the noise") for text in worse.words)
    assert better.share_better > 0.8
    assert better.share_worse < 0.1
    assert better.share_changed == pytest.approx(better.share_better + better.share_worse)


def test_swapping_the_two_turns_the_sign():
    places = random_places(WINDOW, N, 0)
    a = aligned(WINDOW, lambda x, y: form_error_mm(x, y) + bump(x, y), places, noise_mm=NOISE_MM, seed=1)
    b = aligned(WINDOW, form_error_mm, places, noise_mm=NOISE_MM, seed=2)
    there, back = compare(error_map(a, CONFIG), b, CONFIG), compare(error_map(b, CONFIG), a, CONFIG)
    np.testing.assert_allclose(there.difference_mm, -back.difference_mm, atol=1e-15)
    np.testing.assert_array_equal(there.changed, back.changed)
    assert there.change.share_better == pytest.approx(back.change.share_worse)


def test_only_what_both_know_is_compared_and_holes_stay_holes():
    x, y = random_places(WINDOW, N, 5)
    hole, half = np.hypot(x - 15.0, y) < 8.0, x < -10.0
    a = aligned(WINDOW, form_error_mm, (x[~hole], y[~hole]), noise_mm=NOISE_MM, seed=1)
    b = aligned(WINDOW, form_error_mm, (x[~half], y[~half]), noise_mm=NOISE_MM, seed=2)
    c = compare(error_map(a, CONFIG), b, CONFIG)
    xg, yg = np.meshgrid(c.x_mm, c.y_mm)
    step = c.change.spacing_mm
    assert np.isnan(c.difference_mm[np.hypot(xg - 15.0, yg) < 8.0 - step]).all()
    assert np.isnan(c.difference_mm[xg < -10.0 - step]).all()
    assert np.isfinite(c.difference_mm[xg > 28.0]).mean() > 0.97  # places at random leave a few out
    assert c.change.common == pytest.approx((2 * 31 * 61 - np.pi * 64) / (102 * 62 - np.pi * 64), abs=0.05)
    assert not c.change.real


def test_a_coarser_earlier_measurement_sets_the_grid_and_makes_no_change():
    def ripple(x, y):  # not to be seen by the coarse one
        return form_error_mm(x, y) + 0.5e-3 * np.sin(2 * np.pi * x / 3.0)

    a = aligned(WINDOW, ripple, random_places(WINDOW, 20_000, 1), noise_mm=NOISE_MM, seed=1)
    b = aligned(WINDOW, ripple, random_places(WINDOW, 2000, 2), noise_mm=NOISE_MM, seed=2)
    m = error_map(a, CONFIG)
    c = compare(m, b, CONFIG)
    assert c.change.spacing_mm > 2 * m.spacing_mm
    assert c.change.spacing_mm == pytest.approx(error_map(b, CONFIG).spacing_mm, rel=0.05)
    assert c.change.share_changed < 0.01


def test_without_noise_any_change_is_one_and_none_is_none():
    def plane(x, y):  # a window holds it wherever the points lie
        return 1e-5 * (x + y)

    same = changed_by(nothing, before=plane, noise_mm=0.0).change
    other = changed_by(bump, before=plane, noise_mm=0.0).change
    assert not same.real
    assert other.real


def test_a_stated_uncertainty_larger_than_the_scatter_is_believed():
    places = random_places(WINDOW, N, 0)
    a = aligned(WINDOW, form_error_mm, places, noise_mm=NOISE_MM, seed=1)
    b = aligned(WINDOW, form_error_mm, places, noise_mm=NOISE_MM, seed=2)
    plain = compare(error_map(a, CONFIG), b, CONFIG)
    stated = replace(b, sigma_mm=np.full(N, 5 * NOISE_MM))
    raised = compare(error_map(a, CONFIG), stated, CONFIG)
    assert np.nanmedian(raised.u_mm / plain.u_mm) == pytest.approx(np.sqrt((1 + 25) / 2), rel=0.05)


def test_a_round_part_works_too():
    surface = Quadric(half_x=40.0, half_y=40.0, c=0.005, d=0.003, round=True)
    assert not changed_by(nothing, surface=surface, seed=3).change.real
    found = changed_by(bump, surface=surface, seed=3)
    assert found.change.form_changed


def test_what_cannot_be_compared_is_refused_by_name():
    places = random_places(WINDOW, 1500)
    a = aligned(WINDOW, form_error_mm, places, noise_mm=NOISE_MM, seed=1)
    b = aligned(WINDOW, form_error_mm, places, noise_mm=NOISE_MM, seed=2)
    m = error_map(a, CONFIG)
    other = replace(b, nominal=replace(b.nominal, digest="f" * 64))
    with pytest.raises(
        InputError, match=r"early: it is of another part: .*ffffffffffff.*late is 000000000000"
    ):
        compare(m, other, CONFIG, names=("late", "early"))
    turned = replace(b, nominal=replace(b.nominal, side=-1))
    with pytest.raises(InputError, match="from the -z side"):
        compare(m, turned, CONFIG)
    with pytest.raises(WrongStageError, match="the same measurement"):
        compare(m, a, CONFIG)
    with pytest.raises(UsageError, match="filtered"):
        compare(error_map(a, replace(CONFIG, low_pass_mm=15.0)), b, CONFIG)
    x, y = places
    left, right = x < -20.0, x > 20.0
    with pytest.raises(GeometryError, match="0 nodes in common"):
        compare(
            error_map(aligned(WINDOW, form_error_mm, (x[left], y[left])), CONFIG),
            aligned(WINDOW, form_error_mm, (x[right], y[right])),
            CONFIG,
        )


def test_a_report_region_cuts_both_measurements():
    def wave(x, y):
        return 3e-3 * np.sin(2.0 * np.pi * x / 6.0) * np.cos(2.0 * np.pi * y / 7.0)

    places = random_places(WINDOW, 6000, 1)
    late, early = (aligned(WINDOW, wave, places, noise_mm=1e-4, seed=seed) for seed in (1, 2))
    config = ErrorMapConfig(report_region="circle:0,0,22")
    change = compare(error_map(late, config), early, config).change
    noise_um = 0.1 * 2.0**0.5  # of a touch; windows on the border see the same points, so waves fall out
    assert change.difference.rms_mm * 1e3 < noise_um
    assert change.common == 1.0
