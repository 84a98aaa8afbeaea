"""The pictures of a map: each is drawn for every kind of part, in both formats, the same bytes each time."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.image import imread
from truth_maps import WINDOW, Quadric, aligned, form_error_mm, random_places

from cmm_align.config import ErrorMapConfig
from cmm_align.errors import GeometryError, UsageError
from cmm_align.model import PointStatus, Spectrum
from cmm_align.report.bands_picture import BAND_COLOURS, band_edges
from cmm_align.report.canvas import WIDTH_IN
from cmm_align.report.chart import with_limits
from cmm_align.report.outliers_picture import MARKS
from cmm_align.report.pictures import PICTURES, draw
from cmm_align.report.relief_picture import at
from cmm_align.report.section_lines import middle_lines, profile_along, section_line
from cmm_align.report.wishes import Limits, Wishes
from cmm_align.stages.error_map import error_map
from cmm_align.surfaces.protocol import Bounds

ROUND = Quadric(half_x=40.0, half_y=40.0, c=0.004, d=0.004, round=True)
NARROW = Quadric(half_x=6.0, half_y=50.0, d=0.003)
BOX = Bounds(-51.0, 51.0, -31.0, 31.0)
WISHES = Wishes("a $ <script> part", "part.align.h5", limits=Limits(-9.0, 9.0, "a tolerance"))


def map_of(surface, n=1500, hole_mm=0.0, spacing_mm=0.0):
    x, y = random_places(surface, n)
    keep = np.hypot(x - 5.0, y) >= hole_mm
    part = aligned(surface, form_error_mm, (x[keep], y[keep]), noise_mm=3e-4)
    return error_map(part, ErrorMapConfig(spacing_mm=spacing_mm))


@pytest.fixture(autouse=True)
def _small_and_quick(monkeypatch):
    monkeypatch.setattr("cmm_align.report.canvas.DPI", 50)


@pytest.fixture(scope="module")
def window():
    return map_of(WINDOW, hole_mm=9.0)


@pytest.mark.parametrize("name", PICTURES)
def test_an_svg_is_the_same_bytes_each_time_and_needs_no_font(name, window, tmp_path):
    for copy in ("a", "b"):
        draw(name, window, tmp_path / f"{copy}.svg", WISHES)
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()
    text = (tmp_path / "a.svg").read_text(encoding="utf-8")
    assert ET.fromstring(text).get("width") == f"{72 * WIDTH_IN:g}pt"
    assert "<script" not in text
    assert "<text" not in text, "text as outlines: no font is needed"
    assert "dc:date" not in text


@pytest.fixture(scope="module")
def narrow():
    return map_of(NARROW, 800, spacing_mm=1.5)


@pytest.mark.parametrize("name", PICTURES)
def test_a_picture_of_a_narrow_part(name, narrow, tmp_path):
    draw(name, narrow, tmp_path / "a.png", WISHES)
    picture = imread(tmp_path / "a.png")
    assert picture.shape[1] == 50 * WIDTH_IN
    assert picture[..., :3].std() > 0.02


@pytest.mark.parametrize("name", ["bands", "relief"])
def test_a_picture_of_a_round_part(name, tmp_path):
    draw(name, map_of(ROUND, 500), tmp_path / "a.png", WISHES)
    assert imread(tmp_path / "a.png")[..., :3].std() > 0.02


@pytest.mark.parametrize("name", ["map", "sections"])
def test_one_scale_makes_the_pictures_of_a_series_compare(name, window, tmp_path):
    small = replace(window, deviation_mm=0.5 * window.deviation_mm)
    draw(name, window, tmp_path / "a.png", Wishes(scale_um=30.0))
    draw(name, small, tmp_path / "b.png", Wishes(scale_um=30.0))
    draw(name, small, tmp_path / "c.png", Wishes(scale_um=15.0))
    a, b, c = (imread(tmp_path / f"{letter}.png")[70:-45, 45:240, :3] for letter in "abc")
    assert np.abs(a - b).mean() > 3.0 * np.abs(a - c).mean()  # half as high looks so only on one scale


def test_a_section_is_the_form_error_along_its_line(window):
    line = section_line("y=-20mm", BOX)
    profile = profile_along(window, line)
    x = np.linspace(-51.0, 51.0, len(profile.arc_mm))
    known = np.isfinite(profile.deviation_mm)
    assert known.mean() > 0.9
    error = profile.deviation_mm[known] - form_error_mm(x, np.full_like(x, -20.0))[known]
    assert np.sqrt(np.mean(error**2)) < 4e-4  # noise 0.3 um, a step of 2.6 mm
    # z = c x^2 along the line: its arc length in closed form, counted from x = 0.
    slope = 2.0 * WINDOW.c * x
    arc = 0.5 * (x * np.sqrt(1.0 + slope**2) + np.arcsinh(slope) / (2.0 * WINDOW.c))
    np.testing.assert_allclose(profile.arc_mm, arc, atol=1e-3)


def test_a_section_over_a_hole_has_a_gap_and_ends_where_the_nodes_end(window):
    line = section_line("y=0", BOX)
    profile = profile_along(window, line)
    x = np.linspace(-51.0, 51.0, len(profile.arc_mm))
    assert np.isnan(profile.deviation_mm[np.hypot(x - 5.0, 0.0) < 6.0]).all()
    assert np.isnan(profile.deviation_mm[(x < window.x_mm[0] - 0.1) | (x > window.x_mm[-1] + 0.1)]).all()
    assert (profile.sigma_mm[np.isfinite(profile.deviation_mm)] > 0.0).all()


def test_the_middle_lines_cross_in_the_middle_of_the_aperture():
    upright, level = middle_lines(Bounds(10.0, 30.0, -4.0, 0.0))
    assert (upright.start_mm, upright.end_mm) == ((20.0, -4.0), (20.0, 0.0))
    assert (level.start_mm, level.end_mm) == ((10.0, -2.0), (30.0, -2.0))


@pytest.mark.parametrize(
    ("text", "ends"),
    [
        ("x=0", ((0.0, -31.0), (0.0, 31.0))),
        ("y = 5mm", ((-51.0, 5.0), (51.0, 5.0))),
        ("-20,0:20,10", ((-20.0, 0.0), (20.0, 10.0))),
        ("-2cm, 0 : 20000um, 10", ((-20.0, 0.0), (20.0, 10.0))),
        ("0mm,0:1000um,1", ((0.0, 0.0), (1.0, 1.0))),
    ],
)
def test_lines_are_read_as_typed(text, ends):
    line = section_line(text, BOX)
    assert (line.start_mm, line.end_mm) == ends


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("z=0", "expected x=0"),
        ("x=", "expected x=0"),
        ("x=abc", "'abc'"),
        ("x=60", "misses the part; expected x from -51 to 51 mm"),
        ("60,60:70,70", "misses the part"),
        ("1,1:1,1", "no length"),
        ("1,1:2", "is no section"),
    ],
)
def test_a_line_that_is_none_is_refused(text, words):
    with pytest.raises(UsageError, match=words):
        section_line(text, BOX)


def test_limits_have_room_unless_they_are_far_away():
    assert with_limits(10.0, Limits(-5.0, 12.0)) == pytest.approx(1.08 * 12.0)
    assert with_limits(10.0, Limits(-5.0, 5.0)) == 10.0
    assert with_limits(10.0, Limits(-50.0, 50.0)) == 10.0
    assert Limits(-5.0, 7.5, "why").words == "limits \N{MINUS SIGN}5 to +7.5 µm (why)"


def test_what_a_map_has_not_is_no_picture(window, tmp_path):
    with pytest.raises(GeometryError, match="no tolerance"):
        draw("bands", window, tmp_path / "a.png")
    for spectrum, words in ((None, "older version"), (Spectrum(missing="too small"), "too small")):
        with pytest.raises(GeometryError, match=words):
            draw("psd", replace(window, spectrum=spectrum), tmp_path / "a.png")
    assert list(tmp_path.iterdir()) == []


def test_bands_lie_about_the_middle_of_the_tolerance_and_are_light_within():
    np.testing.assert_allclose(band_edges(Limits(-30.0, 50.0)), [-70.0, -30.0, -10.0, 30.0, 50.0, 90.0])
    rgb = np.array([[int(c[k : k + 2], 16) for k in (1, 3, 5)] for c in BAND_COLOURS]) / 255.0
    grey = rgb @ [0.299, 0.587, 0.114]
    assert grey[2:5].min() > max(grey[[0, 1, 5, 6]]) + 0.15  # what is out is darker, in grey print too


def test_nearer_parts_of_a_relief_lie_lower_on_the_sheet_and_heights_go_up():
    origin, up = at(0.0, 0.0, 0.0), at(0.0, 0.0, 10.0)
    assert up[0] == origin[0]
    assert up[1] > origin[1]
    assert at(10.0, 0.0, 0.0)[1] < origin[1] < at(0.0, 10.0, 0.0)[1]
    assert at(10.0, 0.0, 0.0)[0] > origin[0]


def test_every_status_has_its_own_mark_and_is_drawn(window, tmp_path):
    assert set(MARKS) == set(PointStatus)
    assert len({mark.marker for mark in MARKS.values()}) == len(PointStatus)
    alignment = window.alignment
    status = np.zeros(len(alignment.status), np.uint8)
    places = np.array(alignment.contact_part_mm)
    draw("outliers", window, tmp_path / "plain.png")
    status[:12] = np.repeat([1, 2, 3, 4, 5, 0], 2)
    places[0, 0] = 500.0  # far beside the part
    marked = replace(alignment, status=status, contact_part_mm=places)
    draw("outliers", replace(window, alignment=marked), tmp_path / "marked.png")
    assert (tmp_path / "plain.png").read_bytes() != (tmp_path / "marked.png").read_bytes()
