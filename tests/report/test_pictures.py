"""Pictures: they draw without a display, the colours mean what they should, nothing global changes."""

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.image import imread
from truth_maps import WINDOW, Quadric, aligned, form_error_mm, random_places

from cmm_align.report.canvas import limit_um, signed, three_digits
from cmm_align.report.correction_picture import draw_correction
from cmm_align.report.deviation_colours import deviation_colours
from cmm_align.report.map_picture import draw_map
from cmm_align.report.series_picture import draw_series
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
