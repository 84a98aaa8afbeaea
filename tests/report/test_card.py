"""The operator card: one A5 page, readable from a metre away."""

import re
from dataclasses import replace

import pytest
from truth_maps import WINDOW, aligned, form_error_mm, random_places

from cmm_align.config import ErrorMapConfig
from cmm_align.model import Verdict
from cmm_align.report.card import draw_card
from cmm_align.report.instruction import instruction
from cmm_align.report.summary import verdict_of
from cmm_align.stages.error_map import error_map

POINTS_PER_MM = 72.0 / 25.4


@pytest.fixture(scope="module")
def a_map():
    return error_map(aligned(WINDOW, form_error_mm, random_places(WINDOW, 800), noise_mm=3e-4))


def test_it_is_one_page_of_a5_and_the_same_every_time(a_map, tmp_path):
    told = instruction(a_map, "cmm-align compensate part.map.h5")
    for name in ("a.pdf", "b.pdf"):
        draw_card(a_map, tmp_path / name, title="part", advice=told, pass_number=2, date="2026-01-31")
    first, second = ((tmp_path / name).read_bytes() for name in ("a.pdf", "b.pdf"))
    box = [float(v) for v in re.search(rb"/MediaBox \[ ?([\d. ]+) ?\]", first)[1].split()]

    assert first == second
    assert len(re.findall(rb"/Type /Page\b", first)) == 1
    assert box == pytest.approx([0.0, 0.0, 148.0 * POINTS_PER_MM, 210.0 * POINTS_PER_MM], abs=0.5)


@pytest.mark.parametrize("verdict", [Verdict.UNDECIDED, Verdict.NONE])
def test_names_are_shown_as_they_are_and_nothing_runs_over_the_edge(a_map, tmp_path, verdict, monkeypatch):
    from matplotlib.figure import Figure

    boxes = []
    save = Figure.savefig

    def look(figure, *args, **kwargs):
        save(figure, *args, **kwargs)
        renderer = figure.canvas.get_renderer() if hasattr(figure.canvas, "get_renderer") else None
        size = figure.get_size_inches() * figure.dpi
        boxes.extend((t.get_text(), t.get_window_extent(renderer), size) for t in figure.texts)

    monkeypatch.setattr(Figure, "savefig", look)
    m = replace(a_map, verdict=verdict, verdict_lines=("PV 26.3 um > 10 um (u 0.46 um): fail",) * 3)
    long = "cmm-align compensate " + "a-very-long-name-" * 9 + ".map.h5"
    title = "W$12_<b>$ ä \udcff and a name that is far too long for a card"
    draw_card(m, tmp_path / "c.pdf", title=title, advice=instruction(m, long))

    assert any("pass not known" in text for text, _, _ in boxes)
    for text, box, (width, height) in boxes:
        assert box.x0 >= 0.02 * width, text
        assert box.x1 <= 0.98 * width, text
        assert box.y0 >= 0.02 * height, text


def test_what_counts_is_legible_from_a_metre(a_map, tmp_path, monkeypatch):
    from matplotlib.figure import Figure

    sizes = {}
    monkeypatch.setattr(Figure, "text", lambda _, x, y, s, **look: sizes.update({s: look["fontsize"]}))
    m = replace(a_map, verdict=Verdict.PASS)
    draw_card(m, tmp_path / "c.pdf", title="part", advice=instruction(m, ""), pass_number=1)
    cap_mm = {text: 0.73 * size / POINTS_PER_MM for text, size in sizes.items()}  # DejaVu: capitals 0.73 em

    for text in ("PASS", "Clean and ship", "part", "pass 1"):
        assert cap_mm[text] >= 5.0, text
    assert sum(size >= 30.0 for size in sizes.values()) == 4  # the verdict and three numbers


def test_the_one_line_under_the_verdict_is_what_decided_it(a_map, tmp_path, monkeypatch):
    from matplotlib.figure import Figure

    texts = []
    monkeypatch.setattr(Figure, "text", lambda _, x, y, s, **look: texts.append(s))
    lines = ("PV 26.3 um <= 30 um (u 0.46 um): pass", "RMS 4.5 um > 4 um (u 0.01 um): fail")
    m = replace(a_map, verdict=Verdict.FAIL, verdict_lines=lines)
    draw_card(m, tmp_path / "c.pdf", title="part", advice=instruction(m, ""))

    assert any(text.startswith("RMS 4.5") for text in texts)


def test_outliers_alone_ask_for_a_clean_part_not_for_more_points(a_map):
    judged = error_map(a_map.alignment, ErrorMapConfig(tolerance_pv_um=100.0))
    m = replace(judged, verdict=Verdict.UNDECIDED)

    assert instruction(m, "").order == "Clean, then measure again"
    assert not any("guard band" in reason for reason in verdict_of(m)[1])


def test_it_says_that_the_map_is_filtered_or_of_a_region(a_map, tmp_path, monkeypatch):
    from matplotlib.figure import Figure

    texts = []
    monkeypatch.setattr(Figure, "text", lambda _, x, y, s, **look: texts.append(s))
    m = error_map(a_map.alignment, ErrorMapConfig(low_pass_mm=30.0, tolerance_pv_um=100.0))
    draw_card(m, tmp_path / "c.pdf", title="part", advice=instruction(m, ""))
    assert "filtered: gaussian, low pass 30 mm" in texts
    assert "of the filtered map" in m.verdict_lines[0]

    texts.clear()
    m = error_map(a_map.alignment, ErrorMapConfig(report_region="circle:0,0,20"))
    draw_card(m, tmp_path / "c.pdf", title="part", advice=instruction(m, ""))
    assert any(text.startswith("only the circle of radius 20 mm") for text in texts)
