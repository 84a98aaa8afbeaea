"""Programs and grids: what stands in them, what they refuse to be, and damage that is found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.io import loadmat
from truth_corrections import ON_ITS_SIDE, Bowl, Rippled, correction_to
from truth_maps import Quadric

from cmm_align import posts
from cmm_align.config import ExportConfig
from cmm_align.errors import CmmAlignError, MalformedInputError, OutputExistsError, UsageError
from cmm_align.numerics.wheel import Wheel

WHEEL = Wheel(30.0)
BOWL = Bowl(60.0, 10.0, 8.0)
CORRECTION = correction_to(Rippled(BOWL, 0.005, 20.0), BOWL, step_mm=1.0)


def written(tmp_path, name, correction=CORRECTION, wheel=WHEEL, **settings):
    path = tmp_path / f"part{posts.suffix_of(name)}"
    posts.write_export(
        path,
        name,
        posts.ExportJob(correction, ExportConfig(**{"chord_um": 100.0} | settings), 6, wheel, "Part 7"),
    )
    return path


def test_a_raster_program_begins_and_ends_as_it_should(tmp_path):
    lines = written(tmp_path, "gcode-raster", feed_mm_min=350.0).read_text().splitlines()
    assert lines[0] == lines[-1] == "%"
    assert lines[1] == "(PART_7)"
    assert lines[4] == "G21 G90 G94"
    assert lines[5].startswith("G0 X")
    assert lines[6].startswith("G1 X")
    assert lines[6].endswith(" F350")
    assert lines[-2] == "M30"
    assert max(map(len, lines)) < 80
    highest = max(float(line.split("Z")[1].split()[0]) for line in lines if line[:1] == "X")
    assert float(lines[5].split("Z")[1]) == pytest.approx(highest + 10.0, abs=1e-5)


@pytest.mark.parametrize("side", [1, -1])
def test_the_tool_is_lifted_out_of_the_material(tmp_path, side):
    correction = correction_to(
        Bowl(side * 60.0, 8.0, 8.0), side=side, step_mm=1.0, surface_from_part=ON_ITS_SIDE
    )
    path = written(tmp_path, "gcode-raster", correction)
    lines = path.read_text().splitlines()
    above, start = (np.array([float(word[1:]) for word in lines[k].split()[1:4]]) for k in (5, 6))
    np.testing.assert_allclose((above - start)[1:], 0.0, atol=2e-6)  # along x of a part on its side
    assert side * (above - start)[0] >= 10.0 - 1e-6


def test_a_klartext_program_numbers_its_blocks(tmp_path):
    lines = written(tmp_path, "heidenhain").read_text().splitlines()
    assert [int(line.split()[0]) for line in lines] == list(range(len(lines)))
    assert lines[0] == "0 BEGIN PGM PART_7 MM"
    assert lines[-1].endswith("END PGM PART_7 MM")
    assert sum(" LN X" in line for line in lines) == 21 * 17
    assert sum("FMAX" in line for line in lines) == 2


@pytest.mark.parametrize("name", ["gcode-raster", "gcode-spiral", "heidenhain"])
def test_more_lines_than_a_control_takes_are_refused(tmp_path, name):
    with pytest.raises(UsageError, match=r"at most 100 \(max_lines\)"):
        written(tmp_path, name, max_lines=100)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["xyz", "xyzijk", "zemax", "heidenhain", "gcode-raster", "gcode-spiral"])
@pytest.mark.filterwarnings("ignore:loadtxt")
def test_a_file_that_is_cut_off_or_changed_is_refused(tmp_path, name):
    path = written(tmp_path, name)
    whole = path.read_bytes()
    found = posts.read_back(path, name, WHEEL)
    middle = len(whole) // 2
    for damaged in (whole[: middle + 4], whole[:middle] + b"x" + whole[middle:], b"", b"hello\n" * 20):
        path.write_bytes(damaged)
        try:
            cut = posts.read_back(path, name, WHEEL)
        except CmmAlignError:
            continue
        # a text without an end cannot know that lines are missing: its number of points tells
        assert name in {"xyz", "xyzijk"}
        assert len(cut.points_mm) < len(found.points_mm)


def test_an_existing_file_is_kept(tmp_path):
    path = written(tmp_path, "heidenhain")
    before = path.read_bytes()
    with pytest.raises(OutputExistsError):
        written(tmp_path, "heidenhain")
    assert path.read_bytes() == before


def test_a_dwell_grid_comes_back_and_is_laid_out_as_it_says(tmp_path):
    round_part = Bowl(60.0, 10.0, 10.0, round=True)
    correction = correction_to(Rippled(round_part, 0.005, 20.0), round_part, step_mm=0.5)
    path = written(tmp_path, "dwell", correction, footprint_radius_mm=3.2)
    found = posts.read_dwell(path)
    assert found.removal_mm.min() == 0.0
    assert found.x_mm[0] <= -13.2
    assert found.y_mm[-1] >= 13.2
    assert found.box_mm == pytest.approx((-10.0, 10.0, -10.0, 10.0))
    inner = (slice(7, -7), slice(7, -7))
    np.testing.assert_allclose(found.correction_mm[inner], correction.correction_mm, atol=1e-15)
    raw = loadmat(path, squeeze_me=True)
    assert raw["pixel_m"] == pytest.approx(5e-4)
    assert raw["Y"][0, 0] > raw["Y"][-1, 0]
    box = raw["ca_range"]
    v, u = slice(int(box["v_s"]) - 1, int(box["v_e"])), slice(int(box["u_s"]) - 1, int(box["u_e"]))
    assert raw["X"][v, u].min() == pytest.approx(-0.010)
    assert raw["Y"][v, u].max() == pytest.approx(0.010)
    assert raw["inside"][v, u].sum() == np.isfinite(correction.correction_mm).sum()
    with pytest.raises(UsageError, match="no points"):
        posts.read_back(path, "dwell")
    path.write_bytes(path.read_bytes()[:2000])
    with pytest.raises(MalformedInputError, match="no dwell grid"):
        posts.read_dwell(path)


def test_a_dwell_grid_has_square_pixels_although_the_map_has_none(tmp_path):
    flat = Quadric(12.0, 9.0)
    wave = correction_to(Rippled(flat, 0.005, 20.0), flat, step_mm=0.5)
    thin = replace(
        wave,
        **{
            name: getattr(wave, name)[::2] for name in ("y_mm", "correction_mm", "commanded_z_mm", "extended")
        },
    )
    found = posts.read_dwell(written(tmp_path, "dwell", thin, footprint_radius_mm=2.0))
    assert np.diff(found.x_mm) == pytest.approx(0.5)
    assert np.diff(found.y_mm) == pytest.approx(0.5)
    inner = (slice(4, -4), slice(4, -4))
    # degree five through 20 steps to a wave: (k h)^6 / 100 of 5 um, and ten times that at the border
    np.testing.assert_allclose(found.correction_mm[inner], wave.correction_mm, atol=5e-7)
