"""Pictures: they draw without a display, the colours mean what they should, nothing global changes."""

from dataclasses import replace

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.image import imread
from truth_maps import WINDOW, Quadric, aligned, form_error_mm, random_places

from cmm_align.config import ErrorMapConfig
from cmm_align.report.canvas import STYLE, limit_um, sheet, signed, three_digits
from cmm_align.report.comparison_picture import draw_comparison
from cmm_align.report.correction_picture import draw_correction
from cmm_align.report.deviation_colours import LEAVE_HUE_DEG, TAKE_OFF_HUE_DEG, deviation_colours
from cmm_align.report.field import draw_field, unknown_inside
from cmm_align.report.map_picture import draw_map
from cmm_align.report.region_outline import draw_regions
from cmm_align.report.series_picture import draw_series
from cmm_align.stages.comparison import compare
from cmm_align.stages.compensate import compensate
from cmm_align.stages.error_map import error_map

LMS_FROM_RGB = np.array(
    [
        [0.4122214708, 0.5363325363, 0.0514459929],
        [0.2119034982, 0.6806995451, 0.1073969566],
        [0.0883024619, 0.2817188376, 0.6299787005],
    ]
)
OKLAB_FROM_LMS = np.array(
    [
        [0.2104542553, 0.7936177850, -0.0040720468],
        [1.9779984951, -2.4285922050, 0.4505937099],
        [0.0259040371, 0.7827717662, -0.8086757660],
    ]
)
# Vienot, Brettel, Mollon 1999: what a dichromat sees, as a matrix on linear RGB.
DICHROMATS = {
    "protan": [[0.11238, 0.88762, 0.0], [0.11238, 0.88762, 0.0], [0.00401, -0.00401, 1.0]],
    "deutan": [[0.29275, 0.70725, 0.0], [0.29275, 0.70725, 0.0], [-0.02234, 0.02234, 1.0]],
}


def linear(srgb):
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def oklab(rgb):
    return np.cbrt(np.maximum(rgb @ LMS_FROM_RGB.T, 0.0)) @ OKLAB_FROM_LMS.T


@pytest.fixture(scope="module")
def a_map():
    return error_map(aligned(WINDOW, form_error_mm, random_places(WINDOW, 2000), noise_mm=3e-4))


def test_colours_step_evenly_are_light_at_zero_and_equally_dark_at_both_ends():
    lab = oklab(linear(deviation_colours(255)))
    steps = np.linalg.norm(np.diff(lab, axis=0), axis=1)
    assert steps.std() < 0.05 * steps.mean()
    np.testing.assert_allclose(lab[:, 0], lab[::-1, 0], atol=0.01)
    assert np.argmax(lab[:, 0]) == 127
    assert lab[127, 0] > 0.95
    assert (np.diff(lab[127:, 0]) < 0.0).all()


@pytest.mark.parametrize("kind", DICHROMATS)
def test_plus_and_minus_are_told_apart_by_the_colour_blind(kind):
    seen = oklab(np.clip(linear(deviation_colours(255)) @ np.array(DICHROMATS[kind]).T, 0.0, 1.0))
    apart = np.linalg.norm(seen - seen[::-1], axis=1)
    assert apart[:100].min() > 0.1  # five just noticeable differences (0.02)


@pytest.mark.parametrize("kind", DICHROMATS)
def test_take_off_and_leave_are_told_apart_by_the_colour_blind_too(kind):
    colours = deviation_colours(255, (TAKE_OFF_HUE_DEG, LEAVE_HUE_DEG))
    seen = oklab(np.clip(linear(colours) @ np.array(DICHROMATS[kind]).T, 0.0, 1.0))
    assert np.linalg.norm(seen - seen[::-1], axis=1)[:100].min() > 0.1


@pytest.mark.parametrize("nodes", [8, 70])
def test_a_drawn_field_stays_within_its_nodes_and_reaches_the_border(nodes):
    nominal = aligned(WINDOW, form_error_mm, random_places(WINDOW, 50)).nominal
    b = nominal.surface.bounds
    step_x, step_y = (b.x_max - b.x_min) / nodes, (b.y_max - b.y_min) / nodes
    x = b.x_min + step_x * (np.arange(nodes) + 0.7)  # uneven gaps to the border, both under a step
    y = b.y_min + step_y * (np.arange(nodes) + 0.3)
    field = np.where(np.add.outer(np.arange(nodes), np.arange(nodes)) % 2, -2e-3, 3e-3)
    field[0, 0] = np.nan
    with mpl.rc_context(STYLE):
        axes = sheet(5.0).add_axes((0.1, 0.1, 0.8, 0.8))
        image = draw_field(axes, nominal, x, y, field, 3.0)
    shown = image.get_array()
    assert shown.min() >= -2.0 - 1e-9
    assert shown.max() <= 3.0 + 1e-9
    left, right, low, high = image.get_extent()
    factor = shown.shape[1] / (right - left) * step_x / step_x
    column = int((b.x_max - left) * factor) - 1
    assert not shown.mask[shown.shape[0] // 2, column]
    assert unknown_inside(nominal, x, y, field) >= 1
    assert (low, high) == pytest.approx((y[0] - 1.5 * step_y, y[-1] + 1.5 * step_y))


def test_positive_is_red_and_negative_is_blue():
    colours = deviation_colours(255)
    assert colours[50, 2] > colours[50, 0]
    assert colours[200, 0] > colours[200, 2]


def test_pictures_are_drawn_at_full_width_and_leave_no_global_trace(a_map, tmp_path):
    settings = dict(mpl.rcParams)
    draw_map(a_map, tmp_path / "map.part", title="price: $5 <script>")
    draw_series([("before", a_map), ("after", a_map)], tmp_path / "series.png")
    draw_correction(compensate(a_map), tmp_path / "correction.png")
    assert dict(mpl.rcParams) == settings
    for name in ("map.part", "series.png", "correction.png"):
        picture = imread(tmp_path / name, format="png")
        assert picture.shape[1] == 1410
        assert picture[..., :3].std() > 0.05


def test_a_verdict_a_source_and_a_long_odd_name_fit_on_the_sheet(tmp_path):
    alignment = aligned(WINDOW, form_error_mm, random_places(WINDOW, 2000), noise_mm=3e-4)
    judged = error_map(alignment, ErrorMapConfig(tolerance_pv_um=1.0, tolerance_rms_um=50.0))
    draw_map(judged, tmp_path / "a.png", title="a very long name " * 9 + "\udcff", source="part.align.h5")
    assert imread(tmp_path / "a.png").shape[1] == 1410


def test_the_same_map_gives_the_same_bytes(a_map, tmp_path):
    for name in ("one.png", "two.png"):
        draw_map(a_map, tmp_path / name)
    assert (tmp_path / "one.png").read_bytes() == (tmp_path / "two.png").read_bytes()


def test_narrow_and_perfect_parts_can_be_drawn(tmp_path):
    narrow = Quadric(half_x=5.0, half_y=40.0)
    perfect = error_map(aligned(narrow, lambda x, y: 0 * x, random_places(narrow, 500)))
    draw_map(perfect, tmp_path / "narrow.png")
    assert imread(tmp_path / "narrow.png").shape[1] == 1410


def test_the_scale_is_symmetric_and_holds_the_largest_value_of_a_series():
    assert limit_um(np.array([0.0121, np.nan]), np.array([-0.0271])) == pytest.approx(28.0)
    assert limit_um(np.array([0.0])) == 1.0
    assert limit_um(np.array([0.010])) == pytest.approx(10.0)


def test_numbers_are_written_with_a_true_minus_and_without_exponents():
    assert signed(-1.234, 1) == "\N{MINUS SIGN}1.2"
    assert signed(0.04, 1) == "0.0"
    assert signed(3.0, 0) == "+3"
    assert [three_digits(v) for v in (27.34, 0.2861, 4.0, 0.0)] == ["27.3", "0.286", "4.00", "0"]


def test_the_regions_are_outlined_and_named(tmp_path):
    plain = aligned(WINDOW, form_error_mm, random_places(WINDOW, 2000))
    report = replace(
        plain.report,
        report_region="circle",
        report_region_text="circle:0,0,20",
        fit_region="rectangle",
        fit_region_text="rectangle:0,0,60,40",
    )
    alignment = replace(plain, report=report)
    axes = sheet(4.0).add_axes((0, 0, 1, 1))
    marks = draw_regions(axes, alignment)
    assert [word for _, word in marks] == ["report region", "fit region"]
    circle, rectangle = (collection.get_paths()[0].vertices for collection in axes.collections)
    np.testing.assert_allclose(np.hypot(*circle.T), 20.0, atol=0.1)  # a step of the raster: 102 / 900 mm
    np.testing.assert_allclose(np.abs(rectangle).max(axis=0), [30.0, 20.0], atol=0.1)
    assert draw_regions(axes, plain) == []
    draw_map(error_map(alignment), tmp_path / "map.png")
    assert imread(tmp_path / "map.png").shape[1] == 1410


@pytest.mark.parametrize("share", [0.9, 0.0])
def test_a_comparison_is_drawn_with_its_outline(a_map, tmp_path, share):
    """Nearly the same form: the difference has a scale of its own; no form before: one scale for all."""
    before = aligned(
        WINDOW,
        lambda x, y: share * form_error_mm(x, y),
        random_places(WINDOW, 2000, 7),
        noise_mm=3e-4,
        seed=9,
    )
    told = replace(a_map, comparison=compare(a_map, before, ErrorMapConfig()))
    draw_comparison(told, tmp_path / "a.png", title="a $x$ part")
    draw_comparison(told, tmp_path / "b.png", title="a $x$ part")
    image = imread(tmp_path / "a.png")
    assert image.shape[1] == 1410
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
