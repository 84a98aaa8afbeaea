"""Verdicts: which number is judged against what, by which rule, and how sure that is."""

from dataclasses import replace

import numpy as np
import pytest
from truth_maps import PLANE, aligned, form_error_mm, random_places

from cmm_align.config import ErrorMapConfig
from cmm_align.errors import UsageError
from cmm_align.model import PointStatus, frozen_array
from cmm_align.stages.error_map import error_map
from cmm_align.stages.verdict import probability_below

PART = aligned(PLANE, form_error_mm, random_places(PLANE, 8000), noise_mm=0.3e-3)
PLAIN = error_map(PART)


def judged(limits=None, **settings):
    return error_map(PART, ErrorMapConfig(**settings), limits=limits)


N = PLAIN.numbers


@pytest.mark.parametrize(
    ("setting", "measured", "value", "u"),
    [
        ("tolerance_pv_um", N.points_pv_um, N.pv_without_noise_um, N.u_pv_um),
        ("tolerance_profile_um", N.points_profile_um, N.profile_without_noise_um, N.u_profile_um),
        ("tolerance_rms_um", max(N.points_rms_um, N.rms_um), N.rms_without_noise_um, N.u_rms_um),
        ("tolerance_slope_mrad", N.slope.max_mrad, N.slope.max_without_noise_mrad, N.slope.u_max_mrad),
    ],
)
def test_each_number_passes_and_fails_only_beyond_its_guard_band(setting, measured, value, u):
    def outcome(limit, **more):
        return judged(**{setting: limit, **more}).verdict

    assert outcome(measured + 1.7 * u) == "pass"
    assert outcome(measured + 1.6 * u) == "undecided"
    assert outcome(value - 1.6 * u) == "undecided"
    assert outcome(value - 1.7 * u) == "fail"
    assert outcome(1.001 * measured, decision="simple") == "pass"
    assert outcome(0.999 * measured, decision="simple") == "fail"
    (j,) = judged(**{setting: measured}).conformance.judgements
    assert (j.measured, j.value) == (pytest.approx(measured), pytest.approx(value))
    assert j.probability == pytest.approx(probability_below(measured, value, u))


def test_noise_neither_lets_pass_nor_fails():
    between = 0.5 * (N.points_pv_um + N.pv_without_noise_um)
    m = judged(tolerance_pv_um=between)
    assert N.pv_without_noise_um < between < N.points_pv_um
    assert m.verdict == "undecided"
    assert m.verdict_lines[0].endswith(": undecided")


def test_a_band_is_judged_at_its_nearer_side_and_as_a_table_point_by_point():
    s = PLAIN.point_statistics
    low, high = s.min_mm * 1e3, s.max_mm * 1e3
    wide = judged(tolerance_band_lower_um=low - 3.0, tolerance_band_upper_um=high + 2.0)
    (j,) = wide.conformance.judgements
    assert wide.verdict == "pass"
    assert -j.measured == pytest.approx(2.0, abs=1e-9)
    assert "with 2 um to spare" in j.sentence
    assert wide.numbers.points_in_tolerance == 1.0
    e = PART.deviation_mm
    loose = e - 0.005, e + 0.005
    table = judged(loose)
    assert table.verdict == "pass"
    assert table.numbers.band_um is None
    upper = loose[1].copy()
    upper[17] = e[17] - 0.01  # one point out, all others within
    one_out = judged((loose[0], upper))
    assert one_out.verdict == "fail"
    assert one_out.numbers.points_in_tolerance == pytest.approx(1 - 1 / 8000)
    assert "exceeded by 10 um" in one_out.verdict_lines[0]


def test_a_verdict_says_what_a_slope_or_a_filter_does_not_reach():
    s = N.slope
    (line,) = judged(tolerance_slope_mrad=9.0).verdict_lines
    assert f"over {s.base_mm:.2g} mm, without {s.n_left_out} nodes on the border" in line
    e = PART.deviation_mm
    (line,) = judged((e - 0.005, e + 0.005), low_pass_mm=20.0).verdict_lines
    assert line.startswith("band of each point, which no filter touches, kept")


def test_several_tolerances_make_the_worst_verdict_and_a_bound_of_the_probability():
    m = judged(tolerance_pv_um=100.0, tolerance_rms_um=PLAIN.numbers.rms_without_noise_um)
    pv, rms = m.conformance.judgements
    assert m.verdict == "undecided"
    assert (pv.verdict, rms.verdict) == ("pass", "undecided")
    assert m.conformance.probability == pytest.approx(pv.probability + rms.probability - 1.0)
    assert rms.probability == pytest.approx(0.5, abs=0.01)


def test_what_was_not_measured_cannot_pass():
    x, y = random_places(PLANE, 8000)
    half = x < 20.0
    m = error_map(
        aligned(PLANE, form_error_mm, (x[half], y[half])),
        ErrorMapConfig(tolerance_pv_um=100.0, decision="simple"),
    )
    assert m.conformance.judgements[0].verdict == "pass"
    assert m.verdict == "undecided"


def with_outlier(deviation_mm):
    """The part with its tenth point left out as an outlier."""
    e, status, kept = PART.deviation_mm.copy(), PART.status.copy(), PART.judged.copy()
    e[10], status[10], kept[10] = deviation_mm, PointStatus.OUTLIER, False
    contact = PART.contact_part_mm + (e - PART.deviation_mm)[:, None] * PART.normals
    return replace(
        PART,
        deviation_mm=frozen_array(e),
        contact_part_mm=frozen_array(contact),
        status=frozen_array(status, np.uint8),
        judged=frozen_array(kept, np.bool_),
    )


@pytest.mark.parametrize(
    "tolerance",
    [
        {"tolerance_pv_um": 60.0},
        {"tolerance_profile_um": 60.0, "decision": "simple"},
        {"tolerance_band_lower_um": -40.0, "tolerance_band_upper_um": 40.0},
    ],
)
def test_an_outlier_that_would_break_a_tolerance_lets_no_part_pass(tolerance):
    m = error_map(with_outlier(0.05), ErrorMapConfig(**tolerance))
    assert m.conformance.judgements[0].verdict == "pass"
    assert m.verdict == "undecided"
    assert m.verdict_lines[-1].startswith("a point left out as an outlier, up to +50 um, would break")
    assert m.conformance.kept
    assert error_map(with_outlier(0.02), ErrorMapConfig(**tolerance)).verdict == "pass"
    x, y = (float(v[10]) for v in random_places(PLANE, 8000))
    elsewhere = f"circle:{-np.sign(x) * 25},{-np.sign(y) * 15},12"
    assert (
        error_map(with_outlier(0.05), ErrorMapConfig(report_region=elsewhere, **tolerance)).verdict == "pass"
    )


@pytest.mark.parametrize(
    "settings",
    [
        {"tolerance_pv_um": -1.0},
        {"tolerance_slope_mrad": np.nan},
        {"tolerance_band_lower_um": 3.0, "tolerance_band_upper_um": 3.0},
        {"tolerance_band_lower_um": 3.0, "tolerance_band_upper_um": -2.0},
        {"decision": "coin"},
    ],
)
def test_tolerances_that_are_none_are_refused(settings):
    with pytest.raises(UsageError):
        judged(**settings)


def test_a_free_pose_that_noise_hardly_moves_adds_little_and_datum_points_all_they_have():
    c = np.diag([1e-10, 1e-10, 1e-10, 1e-6, 1e-6, 1e-6])  # 1 um and 10 urad: raised for form error
    moved = replace(PART, covariance=c)
    assert error_map(moved).numbers.u_pv_um < 1.05 * N.u_pv_um
    held = replace(moved, report=replace(moved.report, n_fiducials=3))
    assert error_map(held).numbers.u_pv_um > 1.2 * N.u_pv_um
