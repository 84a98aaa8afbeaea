"""The deviation map against measurements whose truth is known."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from truth_maps import PLANE, SLOPE_45, WINDOW, Quadric, aligned, form_error_mm, random_places

from cmm_align.config import ErrorMapConfig
from cmm_align.errors import GeometryError, UsageError
from cmm_align.model import Verdict, frozen_array
from cmm_align.pose import Pose, rotation_from_vector
from cmm_align.stages.error_map import error_map

ROUND = Quadric(half_x=40.0, half_y=40.0, c=0.005, d=0.003, round=True)


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("surface", [WINDOW, ROUND], ids=["window", "round"])
def test_20000_noisy_points_give_pv_and_rms_within_3_percent_and_the_shape(surface, seed):
    places = random_places(surface, 20_000, seed)
    truth = form_error_mm(*places)
    m = error_map(aligned(surface, form_error_mm, places, noise_mm=0.3e-3, seed=seed + 50))
    known = np.isfinite(m.deviation_mm)
    at_nodes = form_error_mm(*np.meshgrid(m.x_mm, m.y_mm))[known]
    assert m.statistics.pv_mm == pytest.approx(np.ptp(truth), rel=0.03)
    assert m.statistics.rms_mm == pytest.approx(np.sqrt(np.mean(truth**2)), rel=0.03)
    assert np.corrcoef(m.deviation_mm[known], at_nodes)[0, 1] >= 0.999
    normalised = (m.deviation_mm[known] - at_nodes) / m.sigma_mm[known]
    assert np.std(normalised) == pytest.approx(1.0, abs=0.1)


def test_u_rms_covers_the_spread_of_the_rms_over_repeated_measurements():
    places = random_places(WINDOW, 4000)
    maps = [error_map(aligned(WINDOW, form_error_mm, places, noise_mm=1e-3, seed=s)) for s in range(25)]
    spread = np.std([m.statistics.rms_mm for m in maps], ddof=1)
    noise_only = 1e-3 / np.sqrt(4000)
    assert spread == pytest.approx(noise_only, rel=0.6)  # 25 seeds tell a spread to 15 %
    assert all(m.u_rms_mm >= 0.9 * noise_only for m in maps)


@pytest.mark.parametrize("side", [1, -1])
def test_a_bump_outwards_is_positive_and_along_z_it_points_to_the_side_of_the_probe(side):
    bump = aligned(
        SLOPE_45, lambda x, y: 0.01 * np.exp(-(x**2 + y**2) / 200.0), random_places(SLOPE_45, 4000), side=side
    )
    m = error_map(bump)
    assert m.statistics.max_mm == pytest.approx(0.01, rel=0.02)
    assert np.hypot(*m.statistics.max_at_mm) < 2 * m.spacing_mm
    known = np.isfinite(m.deviation_mm)
    np.testing.assert_allclose(
        m.sag_deviation_mm[known], side * np.sqrt(2.0) * m.deviation_mm[known], rtol=1e-12
    )


def test_the_map_lies_in_frame_surface_however_the_part_lies():
    places = random_places(WINDOW, 3000)
    turn = Pose(rotation_from_vector(np.array([0.4, -1.2, 0.3])), np.zeros(3), "surface", "part")
    straight = error_map(aligned(WINDOW, form_error_mm, places))
    turned = error_map(aligned(WINDOW, form_error_mm, places, surface_from_part=turn))
    np.testing.assert_allclose(turned.x_mm, straight.x_mm, atol=1e-12)
    np.testing.assert_allclose(turned.deviation_mm, straight.deviation_mm, atol=1e-12)


def test_nodes_off_the_aperture_and_in_a_hole_are_unknown_and_the_rest_is_known():
    x, y = random_places(ROUND, 20_000)
    keep = np.hypot(x - 5.0, y) > 8.0
    m = error_map(aligned(ROUND, form_error_mm, (x[keep], y[keep])))
    xg, yg = np.meshgrid(m.x_mm, m.y_mm)
    assert np.isnan(m.deviation_mm[np.hypot(xg, yg) > 40.0]).all()
    assert np.isnan(m.deviation_mm[np.hypot(xg - 5.0, yg) < 8.0 - m.spacing_mm]).all()
    inside = (np.hypot(xg, yg) < 40.0 - m.spacing_mm) & (np.hypot(xg - 5.0, yg) > 8.0 + m.spacing_mm)
    assert np.isfinite(m.deviation_mm[inside]).mean() > 0.999
    assert m.statistics.n == np.isfinite(m.deviation_mm).sum()


def test_the_spacing_follows_the_distinct_places_not_the_number_of_points():
    x, y = random_places(WINDOW, 2000)
    once = error_map(aligned(WINDOW, form_error_mm, (x, y)))
    thrice = error_map(aligned(WINDOW, form_error_mm, (np.repeat(x, 3), np.repeat(y, 3))))
    assert thrice.spacing_mm == once.spacing_mm
    along, across = np.meshgrid(np.linspace(-51, 51, 2000), np.linspace(-31, 31, 21))
    lines = error_map(aligned(WINDOW, form_error_mm, (along.ravel(), across.ravel())))
    assert lines.spacing_mm == pytest.approx(3.1 * 1.2, rel=0.15)
    assert np.isfinite(lines.deviation_mm).all()


def test_the_longer_side_has_at_most_max_nodes():
    m = error_map(aligned(PLANE, form_error_mm, random_places(PLANE, 20_000)), ErrorMapConfig(max_nodes=32))
    assert len(m.x_mm) <= 32
    with pytest.raises(UsageError, match="max_nodes"):
        error_map(aligned(PLANE, form_error_mm, random_places(PLANE, 100)), ErrorMapConfig(spacing_mm=0.01))


def test_a_spacing_asked_for_is_kept_and_the_grid_lies_evenly_in_the_data():
    places = random_places(PLANE, 20_000)
    m = error_map(aligned(PLANE, form_error_mm, places), ErrorMapConfig(spacing_mm=2.0))
    np.testing.assert_allclose(np.diff(m.x_mm), 2.0, rtol=1e-12)
    assert m.x_mm[0] - places[0].min() == pytest.approx(places[0].max() - m.x_mm[-1])
    assert m.spacing_mm == pytest.approx(2.0)


def test_the_ladder_removes_what_it_names_and_pvr_of_a_low_order_is_its_pv():
    def potato(x, y):
        return 1e-3 * (
            0.5 + 0.02 * x + 0.002 * (x**2 + y**2) + 0.001 * (x**2 - y**2) + 1e-5 * (x**3 - 3 * x * y**2)
        )

    m = error_map(aligned(PLANE, potato, random_places(PLANE, 5000)))
    rms = [rung.rms_mm for rung in m.ladder]
    assert m.ladder[0].removed == "nothing"
    assert len(m.ladder) == 6
    assert rms[0] == pytest.approx(m.statistics.rms_mm)
    assert all(a >= b - 1e-12 for a, b in pairwise(rms))
    cubic_rest = 1e-5  # a local quadratic smooths a cubic a little, by another cubic at most near the border
    assert rms[4] < cubic_rest
    assert m.pvr_mm == pytest.approx(m.statistics.pv_mm, rel=0.01)


def test_few_points_still_make_a_map_with_a_shorter_ladder():
    m = error_map(aligned(PLANE, lambda x, y: 1e-3 + 1e-5 * x, random_places(PLANE, 36)))
    known = np.isfinite(m.deviation_mm)
    assert known.sum() >= 4
    plane = 1e-3 + 1e-5 * np.meshgrid(m.x_mm, m.y_mm)[0]
    np.testing.assert_allclose(m.deviation_mm[known], plane[known], atol=1e-12)
    assert m.ladder[0].removed == "nothing"


@pytest.mark.parametrize(
    ("pv_um", "rms_um", "expected"),
    [
        (0, 0, "none"),
        (60, 0, "pass"),
        (60, 10, "pass"),
        (10, 10, "fail"),
        (60, 1, "fail"),
        (0, -1, "undecided"),
    ],
)
def test_the_verdict_keeps_a_guard_band_on_both_sides(pv_um, rms_um, expected):
    a = aligned(WINDOW, form_error_mm, random_places(WINDOW, 4000), noise_mm=1e-3)
    if rms_um == -1:  # exactly at the limit, of the worse of nodes and single points
        plain = error_map(a)
        rms_um = max(plain.statistics.rms_mm, plain.point_statistics.rms_mm) * 1e3
    m = error_map(a, ErrorMapConfig(tolerance_pv_um=pv_um, tolerance_rms_um=rms_um))
    assert m.verdict is Verdict(expected)


def test_points_that_do_not_count_leave_no_trace():
    x, y = random_places(WINDOW, 3000)
    a = aligned(WINDOW, form_error_mm, (x, y))
    spoiled = a.deviation_mm.copy()
    used = np.ones(len(x), dtype=bool)
    used[::10], spoiled[::10] = False, 1.0
    bad = replace(a, deviation_mm=frozen_array(spoiled), judged=frozen_array(used, np.bool_))
    clean = error_map(aligned(WINDOW, form_error_mm, (x[used], y[used])))
    np.testing.assert_array_equal(error_map(bad).deviation_mm, clean.deviation_mm)


def test_nothing_to_map_is_said():
    a = aligned(PLANE, form_error_mm, random_places(PLANE, 100))
    with pytest.raises(GeometryError, match="none of the 100 points"):
        error_map(replace(a, judged=frozen_array(np.zeros(100), np.bool_)))
    line = np.linspace(-40, 40, 100)
    with pytest.raises(GeometryError, match="span"):
        error_map(aligned(PLANE, form_error_mm, (line, np.zeros(100))))
    with pytest.raises(GeometryError, match="determine no node"):
        error_map(aligned(PLANE, form_error_mm, (line, 0.5 * line)))


def test_the_arrays_of_the_map_are_read_only():
    m = error_map(aligned(PLANE, form_error_mm, random_places(PLANE, 500)))
    for array in (m.x_mm, m.y_mm, m.deviation_mm, m.sag_deviation_mm, m.sigma_mm):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0
