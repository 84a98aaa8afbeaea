"""The report as a page: what is in it, what is escaped, how the map is packed. Without a browser."""

import base64
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from truth_maps import WINDOW, Quadric, aligned, form_error_mm, random_places

from cmm_align.config import ErrorMapConfig
from cmm_align.errors import GeometryError
from cmm_align.model import FitReport, PointStatus, Verdict, frozen_array
from cmm_align.model.root_causes import Cause, Member, RootCauses
from cmm_align.provenance import InputFile, Step
from cmm_align.report.instruction import instruction
from cmm_align.report.page import PagePicture, lean, write_page
from cmm_align.report.page_map import MOST_NODES, map_data, outline, packed, packed_u, thinning
from cmm_align.report.page_section import shown
from cmm_align.report.page_sections import sections
from cmm_align.stages.cause_signatures import SET
from cmm_align.stages.comparison import compare
from cmm_align.stages.error_map import error_map

EVIL = """<script>alert("x")</script> 'Spiegel' ä&ß </title>"""
PROBE = "tip radius 1.5 mm, on the +z side of the nominal"


@pytest.fixture(scope="module")
def a_map():
    points = aligned(WINDOW, form_error_mm, random_places(WINDOW, 2000), noise_mm=3e-4)
    return error_map(points, ErrorMapConfig(tolerance_pv_um=10.0))


@pytest.fixture
def page_of(tmp_path):
    def make(deviation_map, **more):
        given = {"title": "part", "source": "part.align.h5", "probe": PROBE, **more}
        given.setdefault("advice", instruction(deviation_map, "cmm-align compensate part.map.h5"))
        write_page(deviation_map, tmp_path / "part.html", **given)
        return (tmp_path / "part.html").read_text(encoding="utf-8")

    return make


def data_of(page):
    text = re.search(r'<script type="application/json" id="map-data">(.*?)</script>', page, re.DOTALL)[1]
    return json.loads(text)


def test_the_page_says_the_verdict_the_numbers_and_where_it_comes_from(a_map, page_of):
    step = Step(
        "align", "9.8.7", "2026-01-31T12:00:00Z", {"align": {"seed": 1}}, (InputFile("p.csv", "ab" * 32),)
    )
    page = page_of(a_map, steps=[step], warnings=["5 points were left out, up to -3 um"])

    assert '<p class="verdict fail" id="verdict">FAIL</p>' in page
    assert f"{a_map.statistics.pv_mm * 1e3:.2f}" in page
    assert "2026-01-31 12:00:00 UTC" in page
    assert "9.8.7" in page
    assert "ab" * 32 in page
    assert "align.seed" in page
    assert "up to \N{MINUS SIGN}3 µm" in page
    assert PROBE in page


def test_without_a_tolerance_it_says_so(a_map, page_of):
    page = page_of(replace(a_map, verdict=Verdict.NONE, verdict_lines=()))

    assert ">no tolerance given</p>" in page
    assert "Ask for the tolerance" in page


def test_text_of_users_is_text(a_map, page_of):
    step = Step(EVIL, EVIL, EVIL, {EVIL: {EVIL: [EVIL]}}, (InputFile(EVIL, EVIL),))
    page = page_of(a_map, title=EVIL, source=EVIL, probe=EVIL, steps=[step], warnings=[EVIL])

    assert page.count("<script") == 2  # the data and the script of the page
    assert page.count("</script>") == 2
    assert page.count("</title>") == 1
    assert "&lt;script&gt;alert(&#34;x&#34;)&lt;/script&gt; &#39;Spiegel&#39; ä&amp;ß" in page


def test_nothing_is_loaded_from_elsewhere(a_map, page_of):
    page = page_of(a_map)

    assert not re.search(r"https?:|=.//|@import|url\(|<link|<iframe", page)
    assert "default-src 'none'" in page


def test_a_name_that_is_no_unicode_is_written_all_the_same(a_map, page_of):
    assert "part?" in page_of(a_map, title="part\udcff")


@pytest.mark.parametrize("size_um", [0.8, 12.0, 900.0])
def test_the_packed_map_is_the_map_rounded_once(a_map, size_um):
    scale = size_um * 1e-3 / np.nanmax(np.abs(a_map.deviation_mm))
    m = replace(
        a_map,
        deviation_mm=a_map.deviation_mm * scale,
        statistics=replace(a_map.statistics, max_mm=size_um * 1e-3, min_mm=-size_um * 1e-3),
    )
    data = map_data(m)
    kind = {16: "<i2", 32: "<i4"}[data["bits"]]
    counts = np.frombuffer(base64.b64decode(data["deviation"]), kind).reshape(m.deviation_mm.shape)
    known = np.isfinite(m.deviation_mm)

    assert data["digits"] == (4 if size_um < 3.2 else 3)
    assert data["bits"] == (32 if size_um > 32.7 else 16)
    assert (counts[~known] == np.iinfo(kind).min).all()
    for count, value in zip(counts[known][::37], m.deviation_mm[known][::37], strict=True):
        assert f"{count / 10 ** data['digits']:.{data['digits']}f}" == f"{value * 1e3:.{data['digits']}f}"


def test_a_map_without_a_node_is_refused(a_map, page_of, tmp_path):
    with pytest.raises(GeometryError, match="no node"):
        page_of(replace(a_map, deviation_mm=np.full_like(a_map.deviation_mm, np.nan)))
    assert not (tmp_path / "part.html").exists()


def test_unknown_nodes_and_the_largest_numbers_are_kept_apart():
    text, bits = packed(np.array([[np.nan, -32.767, 32.767]]), 3)
    assert (bits, list(np.frombuffer(base64.b64decode(text), "<i2"))) == (16, [-32768, -32767, 32767])
    assert packed(np.array([[32.768]]), 3)[1] == 32
    text, digits = packed_u(np.array([[np.inf, np.nan, 0.25, 700.0]]), 3)
    assert (digits, list(np.frombuffer(base64.b64decode(text), "<u2"))) == (1, [65535, 65535, 2, 7000])


def test_the_outline_is_the_aperture():
    (ring,) = outline(
        aligned(
            Quadric(half_x=20.0, half_y=20.0, round=True), form_error_mm, random_places(WINDOW, 9)
        ).nominal
    )
    corners = np.array(ring).reshape(-1, 2)
    step = 40.0 / 700.0

    assert np.abs(np.hypot(*corners.T) - 20.0).max() < step
    (ring,) = outline(aligned(WINDOW, form_error_mm, random_places(WINDOW, 9)).nominal)
    assert len(ring) <= 2 * 8  # a rectangle needs few corners


def test_what_changed_is_told_rung_by_rung(a_map, page_of):
    before = aligned(
        WINDOW, lambda x, y: 3.0 * form_error_mm(x, y), random_places(WINDOW, 2000), noise_mm=3e-4
    )
    comparison = compare(a_map, before, ErrorMapConfig(), names=("now.align.h5", EVIL))
    m = replace(a_map, comparison=comparison)
    told = next(s for s in sections(m, PROBE) if s.title.startswith("What changed since"))

    assert len(told.rows) == len(comparison.change.rungs) + len(comparison.change.bands)
    assert told.rows[0][-1] == "real"
    assert float(told.rows[0][2]) == pytest.approx(comparison.change.rungs[0].rms_um, rel=1e-3)
    assert "<script>alert" not in page_of(m)


def test_regions_are_drawn_and_named(a_map, page_of):
    report = replace(
        a_map.alignment.report,
        report_region="the aperture less 4 mm all round",
        report_region_text="aperture:-4",
        fit_region="circle",
        fit_region_text="circle:0,0,20",
    )
    page = page_of(replace(a_map, alignment=replace(a_map.alignment, report=report)))
    told, fitted = data_of(page)["regions"]
    corners = np.array(told["outline_mm"][0]).reshape(-1, 2)

    assert [told["name"], fitted["name"]] == ["report region", "fit region"]
    np.testing.assert_allclose(np.abs(corners).max(axis=0), [47.0, 27.0], atol=102.0 / 700.0)
    assert "numbers and map of the aperture less 4 mm all round" in page


def test_pictures_are_kept_as_long_as_there_is_room(a_map, page_of):
    small = PagePicture("small", b'<svg><path d="M 1.234567 -2.999999"/></svg>')
    large = PagePicture("large", b"<svg>" + b"x" * 2_800_000 + b"</svg>")
    page = page_of(a_map, pictures=[large, small])

    assert "left out: large" in page
    assert page.count("<img") == 1
    assert lean(small.data.decode()) == '<svg><path d="M 1.23 -3.00"/></svg>'


def test_what_only_the_summary_says_is_on_the_page_too(a_map):
    made = {s.title: s for s in sections(a_map, PROBE)}["More numbers, and how they were made"]

    assert {"method", "without noise", "slope error"} <= {row[0] for row in made.rows}
    assert not {"without power", "without rigid motion", "without 36 terms"} & {row[0] for row in made.rows}


def test_each_tolerance_is_told_with_its_chance(a_map):
    told = next(s for s in sections(a_map, PROBE) if s.title == "Tolerances")
    (j,) = a_map.conformance.judgements

    assert told.rows == (
        ("PV, µm", f"{j.measured:.2f}", f"{j.value:.2f}", *told.rows[0][3:4], "≤ 10", "< 0.1 %"),
    )
    assert "guard band of 1.65 u" in told.note


@pytest.mark.parametrize("n", [512, 1500])
def test_the_largest_map_stays_under_three_megabytes(a_map, page_of, rng, n):
    noise = rng.uniform(-0.9, 0.9, (n, n))
    x, y = np.linspace(-50.0, 50.0, n), np.linspace(-30.0, 30.0, n)
    m = replace(a_map, x_mm=x, y_mm=y, deviation_mm=noise, sigma_mm=np.abs(noise))
    page = page_of(m)
    data = data_of(page)

    assert len(page.encode()) < 3e6
    assert len(data["x_mm"]) * len(data["y_mm"]) <= MOST_NODES
    assert thinning(n * n) == (1 if n == 512 else 3)
    assert ("every 3. node" in page) == (n == 1500)
    assert data["x_mm"][1] == pytest.approx(x[thinning(n * n)], abs=1e-6)


def test_outliers_are_counted_with_the_worst(a_map):
    points = a_map.alignment
    status = points.status.copy()
    status[[3, 5]] = PointStatus.OUTLIER
    deviation = points.deviation_mm.copy()
    deviation[5] = -0.0421
    marked = replace(points, status=frozen_array(status, np.uint8), deviation_mm=frozen_array(deviation))
    found = {s.title: s for s in sections(replace(a_map, alignment=marked), PROBE)}

    assert found["Outliers"].rows[0] == ("left out", "2")
    assert found["Outliers"].rows[1][1].startswith("\N{MINUS SIGN}42.10 µm, point 5 at")


def test_what_the_fit_could_not_tell_or_was_not_asked_is_said(a_map):
    report = FitReport(3, "x", True, ("rotation about z",), {}, 0.1, "smooth", 0, 0, locked=("tx", "ty"))
    found = sections(replace(a_map, alignment=replace(a_map.alignment, report=report)), PROBE)
    hid = next(s for s in found if s.title == "What the best fit hid")

    assert ("cannot be told", "rotation about z") in hid.rows
    assert any(row[0] == "locked" and row[1].startswith("tx, ty") for row in hid.rows)


def test_the_signs_of_a_page():
    assert shown("PV 3 um <= 5 um (u 0.2 um), -3.2 urad, x-3 m-3 um-x") == (
        "PV 3 µm ≤ 5 µm (u 0.2 µm), \N{MINUS SIGN}3.2 µrad, x-3 m-3 µm-x"
    )


@pytest.mark.parametrize(
    ("verdict", "coverage", "order"),
    [
        (Verdict.PASS, 1.0, "Clean and ship"),
        (Verdict.PASS, 0.7, "Measure the rest"),
        (Verdict.FAIL, 1.0, "Compensate, then grind"),
        (Verdict.UNDECIDED, 1.0, "Measure again, with more points"),
        (Verdict.NONE, float("nan"), "Ask for the tolerance"),
    ],
)
def test_there_is_one_instruction(a_map, verdict, coverage, order):
    told = instruction(replace(a_map, verdict=verdict, coverage=coverage), "cmm-align compensate x.map.h5")

    assert told.order == order
    assert bool(told.command) == (verdict == Verdict.FAIL)


@pytest.mark.parametrize(
    ("name", "remedy", "odds", "order"),
    [
        ("wheel radius", SET, 1e9, "Change wheel radius by \N{MINUS SIGN}3.21 µm first"),
        ("wheel radius", SET, 2.0, "Check wheel radius first"),
        ("drift along z", "let the machine settle, then measure again", 1e9, "Let the machine settle"),
    ],
)
def test_a_cause_that_explains_most_comes_before_a_compensation(a_map, name, remedy, odds, order):
    other = Member("stylus radius", 3.0, 0.3, "um", None, "", odds)
    cause = Cause(name, -3.21, 0.4, "um", None, None, "", remedy, 0.61, 0.03, 3.2, 1.9, 1e12, (other,))
    found = RootCauses((cause,), "", ("wheel radius",), ("tilt",), 4.0, 1.9, 2000, 500, 0.0, (0.0, 0.0))
    m = replace(a_map, root_causes=found, verdict=Verdict.FAIL)
    told = {s.title: s for s in sections(m, PROBE)}["Root causes"]

    assert instruction(m, "cmm-align compensate x").order == order
    assert instruction(replace(m, verdict=Verdict.PASS), "").order == "Clean and ship"
    assert told.rows == ((name, "\N{MINUS SIGN}3.210 ± 0.40 µm", "61 %", "1.900"),)
    assert "say nothing about tilt" in told.note
