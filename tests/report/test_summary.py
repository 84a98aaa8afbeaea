"""The rows of the summaries: the right numbers, each with its unit."""

from dataclasses import replace

import numpy as np
import pytest
from truth_maps import WINDOW, aligned, random_places

from cmm_align.config import ErrorMapConfig
from cmm_align.model import NominalQuality
from cmm_align.report import alignment_summary, summary
from cmm_align.stages.compensate import compensate
from cmm_align.stages.error_map import error_map


@pytest.fixture(scope="module")
def alignment():
    return aligned(WINDOW, lambda x, y: 0.001 + 1e-4 * x, random_places(WINDOW, 1000), side=-1)


def test_an_alignment_is_told_in_um_with_n(alignment):
    rows = dict(alignment_summary.of_alignment(alignment))
    e = alignment.deviation_mm * 1e3
    assert rows["RMS"] == f"{np.sqrt(np.mean(e**2)):.3f} um"
    assert rows["points"].startswith("1000 of 1000 used")
    assert "not observable" not in rows
    held = replace(alignment, report=replace(alignment.report, unobservable=("rotation about z",)))
    assert dict(alignment_summary.of_alignment(held))["not observable"].startswith("rotation about z")


def test_a_map_shows_verdict_extremes_ladder_and_side(alignment):
    m = error_map(alignment, ErrorMapConfig(tolerance_pv_um=1.0))
    rows = dict([*summary.of_map(m), *summary.details_of_map(m)])
    word, reasons = summary.verdict_of(m)
    assert word == "FAIL"
    assert reasons[0].startswith("PV ")
    assert summary.verdict_of(error_map(alignment)) == ("", ())
    assert rows["PV"].startswith(f"{m.statistics.pv_mm * 1e3:.3f} um")
    assert "without rigid motion" in rows
    assert m.low_orders is not None
    assert rows["form"] == m.low_orders.words
    assert "% of the nominal," in rows["coverage"]
    assert "-z side" in rows["sign"]


def test_a_correction_shows_before_after_and_the_reason(alignment):
    c = compensate(error_map(alignment))
    rows = dict(summary.of_correction(c))
    assert rows["another pass"] == c.reason
    assert rows["now"].startswith("PV ")
    assert rows["pass"] == "1, gain 1"
    text = " ".join(value for _, value in summary.of_correction(c))
    assert "- = take off, + = leave or raise" in text
    assert "from pass to pass" in text
    assert "set by" in rows["band"]
    assert text.isascii()


def test_a_nominal_shows_its_quality(alignment):
    quality = NominalQuality(1000, 42.5, None, None, True, 1400.0, 0.003, 0.01, (0.5, 0.5), 5)
    rows = dict(summary.of_nominal(replace(alignment.nominal, quality=quality)))
    assert rows["steepest slope"] == "42.50 deg"
    assert rows["points"] == "1000, spacing 0.500 mm x 0.500 mm"
    assert rows["surface error"] == "0.003 nm PV (spline of degree 5); flat facets 1.4 um PV"
    assert rows["tightest bowl"].startswith("none")
    dome = replace(quality, min_concave_radius_mm=29_090.0)
    assert (
        dict(summary.of_nominal(replace(alignment.nominal, quality=dome)))["tightest bowl"] == "radius 29.1 m"
    )
    bowl = replace(quality, min_concave_radius_mm=12.5, min_concave_at_mm=(1.0, -2.0), regular=False)
    rows = dict(summary.of_nominal(replace(alignment.nominal, quality=bowl)))
    assert rows["tightest bowl"].startswith("radius 12.5 mm at (+1.00, ")
    assert "NOT regular" in rows["equidistant"]
    assert len(summary.of_nominal(alignment.nominal)) == 2


def test_uncertainties_are_calm_numbers_in_the_unit_of_their_size(alignment):
    sigma = {"tx_um": 1700.0, "ty_um": 3.46, "rz_urad": 343.0, "rx_urad": 0.0, "ry_urad": np.inf}
    wild = replace(alignment, report=replace(alignment.report, pose_sigma=sigma))
    text = dict(alignment_summary.of_alignment(wild))["uncertainty (k=1)"]
    assert text == "tx 1.7 mm, ty 3.5 um, rz 340 urad, rx 0 urad, ry unknown"
    rows = dict(alignment_summary.details_of_alignment(wild))
    assert {"rotation vector", "stopped", "two paths differ by"} <= set(rows)
