"""Root causes from the command line: on the screen, in JSON and file, before a compensation, as a picture."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from truth_maps import Quadric, aligned, random_places

from cmm_align import io
from cmm_align.cli import cautions
from cmm_align.model import DeviationMap
from cmm_align.provenance import Step
from cmm_align.report import summary
from cmm_align.report.pictures import draw
from cmm_align.stages.error_map import error_map
from cmm_align.surfaces.geometry import unit_normal
from cmm_align.virtual.window import window

PLACES = random_places(Quadric(half_x=50.0, half_y=30.0), 2500, 1)


def ogive(x, y):
    n = unit_normal(window().jet(x, y), 1)
    return 20e-3 * (x * n[:, 0] + y * n[:, 1]) / np.hypot(x, y)


@pytest.fixture(scope="module")
def alignment():
    return aligned(window(), ogive, PLACES, noise_mm=3e-4)


@pytest.fixture(scope="module")
def file(alignment, tmp_path_factory):
    path = tmp_path_factory.mktemp("causes") / "part.align.h5"
    io.write(alignment, path, (Step("align", "0.1.0", "2026-01-31T12:00:00Z", {}, ()),))
    return path


def test_a_cause_is_on_the_screen_in_json_in_the_file_and_warns_before_compensation(cli, file, tmp_path):
    out = tmp_path / "part.map.h5"
    shown = cli("error-map", file, "-o", out, "--no-picture")
    assert shown.code == 0, shown.err
    text = " ".join(shown.out.split())
    assert "wheel offset" in text
    assert "set that first, then measure again" in text
    told = cli("error-map", file, "-o", out, "--overwrite", "--no-picture", "--json")
    cause = told.json["result"]["root_causes"]["causes"][0]
    assert cause["name"] == "wheel offset"
    assert cause["value"] == pytest.approx(-20.0, abs=3.5 * cause["u"])
    assert cause["unit"] == "um"
    found = io.read_map(out).root_causes
    assert found is not None
    assert found.dominant is not None
    assert found.causes[0].value == cause["value"]
    assert "wheel offset" in cli("info", out).out
    then = cli("compensate", out, "--first-pass", "--no-picture", "--json", "-o", tmp_path / "a.comp.h5")
    assert then.code == 0, then.err
    assert any("a single cause may explain most of this map" in w for w in then.json["warnings"])


def test_the_axis_must_be_two_lengths(cli, file, tmp_path):
    wrong = cli("error-map", file, "-o", tmp_path / "m.h5", "--cause-axis", "1,2,3")
    assert wrong.code == 2
    assert "two lengths" in wrong.err
    assert not (tmp_path / "m.h5").exists()
    right = cli("error-map", file, "-o", tmp_path / "m.h5", "--cause-axis=-1,2", "--no-picture", "--json")
    assert right.json["result"]["root_causes"]["axis_mm"] == [-1.0, 2.0]


def test_every_cause_is_told_with_its_sign_and_without_one_nothing_warns(alignment):
    m = error_map(alignment)
    rows = summary.details_of_map(m)
    text = " ".join(value for _, value in rows)
    assert "+ = move the wheel that much further from the axis" in text
    assert text.isascii()
    plain = error_map(aligned(window(), lambda x, _: 0 * x, PLACES, noise_mm=3e-4))
    assert cautions.of_causes(plain) == []
    assert dict(summary.details_of_map(plain))["causes"] == "no single setting explains the deviations"
    assert "cause" not in dict(summary.of_map(plain))


def test_the_picture_is_drawn_with_causes_without_and_from_old_files(alignment, tmp_path):
    m = error_map(alignment)
    maps: list[DeviationMap] = [m, replace(m, root_causes=None)]
    assert m.root_causes is not None
    maps.append(replace(m, root_causes=replace(m.root_causes, causes=())))
    for k, each in enumerate(maps):
        draw("causes", each, tmp_path / f"{k}.svg")
        assert (tmp_path / f"{k}.svg").stat().st_size > 1000
