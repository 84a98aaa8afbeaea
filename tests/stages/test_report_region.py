"""The clear aperture chosen after the fit: numbers, map and verdict of a region; the pose stays."""

from dataclasses import replace

import numpy as np
import pytest
from truth_maps import PLANE, WINDOW, aligned, form_error_mm, random_places

from cmm_align.config import ErrorMapConfig
from cmm_align.errors import GeometryError, UsageError
from cmm_align.model import PointStatus, Verdict, frozen_array
from cmm_align.model.monte_carlo import MonteCarlo, Spread
from cmm_align.stages.error_map import error_map
from cmm_align.stages.report_region import reported_in
from cmm_align.surfaces.region import region_from_text

PLACES = random_places(WINDOW, 8000)
WHOLE = aligned(WINDOW, form_error_mm, PLACES, noise_mm=0.3e-3)
INSIDE = {
    "circle:-5,3,20": lambda x, y: np.hypot(x + 5.0, y - 3.0) <= 20.0,
    "rectangle:0,0,60mm,30mm": lambda x, y: (abs(x) <= 30.0) & (abs(y) <= 15.0),
    "annulus:0,0,8,25": lambda x, y: (np.hypot(x, y) <= 25.0) & (np.hypot(x, y) >= 8.0),
    "polygon:-30,-20,30,-20,0,25": lambda x, y: (y >= -20.0) & (y <= 25.0 - 1.5 * np.abs(x)),
    "aperture:-6mm": lambda x, y: (abs(x) <= 45.0) & (abs(y) <= 25.0),
}


@pytest.mark.parametrize("text", INSIDE)
def test_numbers_and_map_are_those_of_the_points_in_the_region_alone(text):
    told = INSIDE[text](*PLACES)
    m = error_map(WHOLE, ErrorMapConfig(report_region=text))
    x, y = (p[told] for p in PLACES)
    e = WHOLE.deviation_mm[told]
    assert m.point_statistics.n == told.sum()
    assert m.point_statistics.pv_mm == np.ptp(e)
    assert m.point_statistics.rms_mm == pytest.approx(np.sqrt(np.mean(e**2)))
    assert m.statistics.rms_mm == pytest.approx(np.sqrt(np.mean(form_error_mm(x, y) ** 2)), rel=0.06)
    xg, yg = np.meshgrid(m.x_mm, m.y_mm)
    known = np.isfinite(m.deviation_mm)
    assert INSIDE[text](xg[known], yg[known]).all()
    assert m.coverage > 0.97
    np.testing.assert_array_equal(m.alignment.used, WHOLE.used)


def test_it_replaces_the_region_of_the_alignment_in_both_directions():
    narrow = reported_in(WHOLE, region_from_text("circle:0,0,10", WINDOW))
    wide = error_map(narrow, ErrorMapConfig(report_region="circle:0,0,25"))
    assert (
        wide.point_statistics
        == error_map(WHOLE, ErrorMapConfig(report_region="circle:0,0,25")).point_statistics
    )
    assert wide.alignment.report.report_region_text == "circle:0.0,0.0,25.0"
    assert error_map(narrow).point_statistics.n == narrow.judged.sum() < wide.point_statistics.n


def test_what_did_not_touch_or_is_an_outlier_never_comes_back():
    status = np.zeros(len(PLACES[0]), np.uint8)
    status[::3], status[1::3] = PointStatus.OUTLIER, PointStatus.APART
    found = reported_in(
        replace(WHOLE, status=frozen_array(status, np.uint8)), region_from_text("aperture:0", WINDOW)
    )
    np.testing.assert_array_equal(found.judged, status != PointStatus.OUTLIER)


def test_the_verdict_is_that_of_the_region():
    bump = aligned(
        PLANE, lambda x, y: 0.02 * np.exp(-((x - 40.0) ** 2 + y**2) / 20.0), random_places(PLANE, 6000)
    )
    strict = ErrorMapConfig(tolerance_pv_um=5.0)
    assert error_map(bump, strict).verdict is Verdict.FAIL
    assert error_map(bump, replace(strict, report_region="circle:0,0,25")).verdict is Verdict.PASS


def test_no_point_in_the_region_says_where_the_points_lie():
    with pytest.raises(GeometryError, match="none of the 8000 points") as caught:
        error_map(WHOLE, ErrorMapConfig(report_region="circle:90,0,5"))
    assert "from x -5" in str(caught.value)
    with pytest.raises(UsageError, match="no region"):
        error_map(WHOLE, ErrorMapConfig(report_region="disk:0,0,5"))


def test_a_simulation_of_the_whole_part_is_bounded_for_a_region():
    spread = Spread(5.0, 5.0, 0.1, 4.8, 5.2)
    simulated = MonteCarlo("0.7+L/400", 2.0, 0.5, 100, 1, 8000, {}, {}, (), spread, spread)
    sigma = np.full(len(PLACES[0]), 0.4e-3)
    a = replace(
        WHOLE,
        report=replace(WHOLE.report, monte_carlo=simulated),
        sigma_mm=frozen_array(sigma),
    )
    assert error_map(a).u_rms_mm == pytest.approx(0.1e-3, rel=0.02)
    # mean |e| 0.4 um / RMS: at most all of it, and 0.7 at least for any smooth form
    narrowed = error_map(a, ErrorMapConfig(report_region="circle:0,0,25")).u_rms_mm
    assert 0.7 * 0.4e-3 < narrowed < 0.4e-3
