"""The page in a real browser: it loads in peace, reads the map under the pointer, prints on one sheet."""

from __future__ import annotations

import re
import shutil
from dataclasses import replace

import numpy as np
import pytest
from truth_maps import WINDOW, aligned, form_error_mm, random_places

from cmm_align.config import ErrorMapConfig
from cmm_align.provenance import InputFile, Step
from cmm_align.report.instruction import instruction
from cmm_align.report.page import PagePicture, write_page
from cmm_align.stages.error_map import error_map

playwright_api = pytest.importorskip("playwright.sync_api")
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine")

QUIET = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
NAME = "<script>document.title = 'caught'</script> \"Spiegel\" ä&ß"
MINUS = "\N{MINUS SIGN}"
SVG = b'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 4 3"><rect width="4" height="3"/></svg>'


@pytest.fixture(scope="module")
def browser():
    with playwright_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=QUIET)
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def a_map():
    x, y = random_places(WINDOW, 3000)
    apart = np.hypot(x - 25.0, y - 5.0) > 9.0  # a hole in the data
    points = aligned(WINDOW, form_error_mm, (x[apart], y[apart]), noise_mm=3e-4)
    return error_map(points, ErrorMapConfig(tolerance_pv_um=10.0))


def write(deviation_map, path, *, warnings=(), pictures=()):
    files = (InputFile(NAME, "0123456789abcdef" * 4),)
    steps = [Step(c, "1", "2026-01-31T12:00:00Z", {"a": {NAME: 1}}, files) for c in ("offset", "align", NAME)]
    advice = instruction(deviation_map, "cmm-align compensate part.map.h5")
    write_page(
        deviation_map,
        path,
        title=NAME,
        source=NAME,
        probe="tip radius 1.5 mm",
        advice=advice,
        steps=steps,
        warnings=warnings,
        pictures=pictures,
    )
    return path


@pytest.fixture(scope="module")
def path(a_map, tmp_path_factory):
    return write(a_map, tmp_path_factory.mktemp("page") / "part.html", pictures=[PagePicture(NAME, SVG)])


class Opened:
    """A page that has been opened, and what it complained about or asked for meanwhile."""

    def __init__(self, browser, path, width=1280):
        self.page = browser.new_page(viewport={"width": width, "height": 1400})
        self.complaints, self.requests = [], []
        self.page.on("console", self.listen)
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.url = path.as_uri()
        self.page.goto(self.url)

    def listen(self, message):
        if "willReadFrequently" not in message.text:  # said of `colour` below, not of the page
            self.complaints.append(message.text)

    def place_of(self, x_mm, y_mm):
        """Where a place of the map lies in the window, CSS pixels."""
        d = self.page.evaluate("({...document.getElementById('map').dataset})")
        box = self.page.locator("#map").bounding_box()
        left, top, scale, x, y = (float(d[k]) for k in ("left", "top", "scale", "x", "y"))
        return box["x"] + left + (x_mm - x) * scale, box["y"] + top + (y - y_mm) * scale

    def point(self, x_mm, y_mm):
        self.page.locator("#map").scroll_into_view_if_needed()
        self.page.mouse.move(*self.place_of(x_mm, y_mm))

    def read(self, name):
        return self.page.locator(f"#read-{name}").text_content()

    def colour(self, x_mm, y_mm):
        x, y = self.place_of(x_mm, y_mm)
        return self.page.evaluate(
            """([x, y]) => { const c = document.getElementById('map'), b = c.getBoundingClientRect(),
            s = c.width / b.width;
            return [...c.getContext('2d').getImageData((x - b.left) * s, (y - b.top) * s, 1, 1).data]; }""",
            [x, y],
        )


@pytest.fixture(scope="module")
def opened(browser, path):
    """One window for the tests that only look and point."""
    window = Opened(browser, path)
    yield window
    window.page.close()


def text_of(value_um, digits=3):
    text = f"{abs(value_um):.{digits}f}"
    return text if float(text) == 0.0 else ("+" if value_um > 0.0 else MINUS) + text


def pages_of(pdf):
    return len(re.findall(rb"/Type\s*/Page\b", pdf))


def test_it_loads_in_peace_and_asks_for_nothing(opened):
    assert opened.complaints == []
    assert [url for url in opened.requests if not url.startswith("data:")] == [opened.url]
    assert opened.page.locator("#verdict").text_content() == "FAIL"


def test_the_read_out_shows_the_values_of_the_map(opened, a_map):
    known = np.argwhere(np.isfinite(a_map.deviation_mm))
    for iy, ix in known[[len(known) // 7, len(known) // 2, -len(known) // 5]]:
        # not on the node itself: the nearest one counts
        aside = 0.3 * a_map.spacing_mm
        opened.point(a_map.x_mm[ix] + aside, a_map.y_mm[iy] - aside)

        assert opened.read("deviation") == text_of(a_map.deviation_mm[iy, ix] * 1e3)
        assert opened.read("u") == f"{a_map.sigma_mm[iy, ix] * 1e3:.3f}"
        assert opened.read("x") == text_of(a_map.x_mm[ix])
        assert opened.read("y") == text_of(a_map.y_mm[iy])


def test_a_hole_is_told_as_a_hole_and_hatched(opened, a_map):
    opened.point(25.0, 5.0)

    assert opened.read("deviation") == "not known"
    red, green, blue, _ = opened.colour(26.5, 6.2)
    assert max(red, green, blue) - min(red, green, blue) < 25  # grey
    assert "not measured" in opened.page.locator("#how").text_content()


def test_the_keyboard_goes_from_node_to_node(opened, a_map):
    page, s = opened.page, a_map.statistics
    page.locator("#map").focus()
    page.keyboard.press("Home")
    assert opened.read("deviation") == text_of(s.max_mm * 1e3)
    assert opened.read("x") == text_of(s.max_at_mm[0])
    page.keyboard.press("End")
    assert opened.read("deviation") == text_of(s.min_mm * 1e3)
    before = opened.read("y")
    page.keyboard.press("ArrowUp")
    page.keyboard.press("ArrowDown")
    assert opened.read("y") == before
    page.keyboard.press("Escape")
    assert opened.read("deviation") == "–"


def test_the_slider_changes_the_colours_and_reset_brings_them_back(opened):
    page, place = opened.page, (-20.0, 11.0)
    before = opened.colour(*place)
    page.locator("#range").focus()
    for _ in range(12):
        page.keyboard.press("ArrowLeft")
    page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    after = opened.colour(*place)

    assert after != before
    assert sum(after[:3]) < sum(before[:3])  # a narrower range has stronger colours
    assert "beyond the colours" in page.locator("#beyond").text_content()
    assert page.locator("#range").get_attribute("aria-valuetext")
    page.locator("#reset").click()
    assert opened.colour(*place) == before
    page.locator("#limit").fill("3")
    page.keyboard.press("Enter")
    assert opened.colour(*place) != before
    page.locator("#reset").click()


def test_names_are_shown_as_text(opened):
    page = opened.page

    assert page.locator("h1").text_content() == NAME
    assert page.title().startswith(NAME)
    assert page.locator("script").count() == 2
    assert page.locator(".what").nth(2).text_content() == NAME
    assert page.locator("img").get_attribute("alt") == NAME


def test_a_picture_is_enlarged_by_a_click(opened):
    button = opened.page.locator(".enlarge")
    small = button.bounding_box()["width"]
    button.click()
    assert button.get_attribute("aria-expanded") == "true"
    assert button.bounding_box()["width"] >= small
    button.click()
    assert button.get_attribute("aria-expanded") == "false"


@pytest.mark.parametrize("much", [0, 45], ids=["plain", "much to say"])
def test_it_prints_on_one_sheet_of_a4(browser, a_map, tmp_path, much):
    warnings = [f"warning {k}: " + "something that takes a line or two of the page " * 3 for k in range(much)]
    pictures = [PagePicture(str(k), SVG) for k in range(much and 6)]
    window = Opened(browser, write(a_map, tmp_path / "p.html", warnings=warnings, pictures=pictures))
    pdf = window.page.pdf(prefer_css_page_size=True)
    window.page.close()
    box = [float(v) for v in re.search(rb"/MediaBox \[([\d. ]+)\]", pdf)[1].split()]

    assert pages_of(pdf) == 1
    assert box[2:] == pytest.approx([595.0, 842.0], abs=2.0)


@pytest.mark.parametrize("width", [400, 640, 1280])
def test_at_any_width_it_reads_right_and_needs_no_scrolling_sideways(opened, a_map, width):
    opened.page.set_viewport_size({"width": width, "height": 1400})
    opened.page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    iy, ix = np.argwhere(np.isfinite(a_map.deviation_mm))[100 + width // 2]
    opened.point(a_map.x_mm[ix], a_map.y_mm[iy])

    assert opened.page.evaluate("document.documentElement.scrollWidth") <= width
    assert opened.read("deviation") == text_of(a_map.deviation_mm[iy, ix] * 1e3)
    assert opened.complaints == []


def test_on_a_narrow_window_a_fine_map_is_read_with_four_decimals(browser, a_map, tmp_path):
    s = replace(a_map.statistics, max_mm=1e-3, min_mm=-1e-3)
    fine = replace(a_map, deviation_mm=a_map.deviation_mm / 20.0, statistics=s)
    window = Opened(browser, write(fine, tmp_path / "p.html"), 400)
    iy, ix = np.argwhere(np.isfinite(fine.deviation_mm))[77]
    window.point(fine.x_mm[ix], fine.y_mm[iy])
    told, wide = window.read("deviation"), window.page.evaluate("document.documentElement.scrollWidth")
    window.page.close()

    assert wide <= 400
    assert told == text_of(fine.deviation_mm[iy, ix] * 1e3, 4)
