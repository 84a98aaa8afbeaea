"""The gate: good files pass, and every usual mistake is refused, named and numbered."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from truth_gate import GOOD, MISTAKES, WORDS, example, read_of

from cmm_align.config import CompensateConfig
from cmm_align.errors import GateError
from cmm_align.numerics.wheel import Wheel, centre_from_contact
from cmm_align.pose import Pose
from cmm_align.stages.compensate import compensate
from cmm_align.stages.gate import Gate, ReadBackField, refuse


@pytest.fixture(scope="module")
def steep():
    return example(1)


def judged(case, change=None, **fields):
    gate = Gate(case.map, case.correction)
    return gate.judge(replace(read_of(case, change), **fields))


def check_of(found, name):
    return next(check for check in found.checks if check.name == name)


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("turn", [False, True])
def test_a_good_file_passes_and_its_numbers_are_right(side, turn):
    case = example(2, side=side, turned=turn)
    found = judged(case)
    assert found.passed, found
    assert found.looks_like == ""
    assert check_of(found, "sign").value == pytest.approx(1.0, abs=1e-5)
    assert abs(check_of(found, "Z against normal").value) < 1e-3
    assert check_of(found, "rounding").value <= 0.9
    # Independent: what is left is what the filter left of the points, without the gate's own fields.
    assert found.rms_mm < 0.25 * found.rms_before_mm
    refuse(found, "x")


@pytest.mark.parametrize("name", list(MISTAKES))
def test_a_mistake_is_refused_and_named(steep, name):
    found = judged(steep, MISTAKES[name])
    assert not found.passed
    assert WORDS[name] in found.looks_like
    with pytest.raises(GateError, match="nothing was written") as caught:
        refuse(found, "part.xyz")
    assert caught.value.exit_code == 5
    assert WORDS[name] in str(caught.value)


def test_e_n_as_dz_shows_its_slope_and_its_price(steep):
    found = judged(steep, MISTAKES["e_n as dz"])
    check = check_of(found, "Z against normal")
    assert check.value == pytest.approx(1.0, abs=0.01)
    assert not check.passed
    assert check_of(found, "sign").value < 0.95


def test_on_a_flat_part_e_n_as_dz_is_harmless_and_said():
    case = example(3, flat=True)
    found = judged(case, MISTAKES["e_n as dz"])
    assert found.passed
    assert "harmless" in check_of(found, "Z against normal").words


def test_too_few_decimals_are_a_staircase(steep):
    def coarse(points, _case):
        return np.round(points, 4)

    found = judged(steep, coarse)
    assert not check_of(found, "rounding").passed
    assert not check_of(found, "ripple").passed
    assert check_of(found, "sign").passed
    # z alone is rounded to 0.1 um: a uniform error of 29 nm RMS along z, less along the normal.
    assert 10.0 < check_of(found, "ripple").value < 30.0


def test_a_file_that_is_cut_off_is_refused(steep):
    found = judged(steep, lambda points, _case: points[:-1])
    assert [check.name for check in found.checks if not check.passed] == ["coverage"]


def test_old_normals_are_refused(steep):
    old = steep.nominal_normals
    assert judged(steep, normals=steep.normals).passed
    found = judged(steep, normals=old)
    check = check_of(found, "normals")
    assert not check.passed
    assert "normals" in check.words


def test_a_correction_of_the_wrong_sign_is_refused_though_the_file_says_what_was_meant():
    case = example(4)
    c = case.correction
    wrong = replace(c, correction_mm=-c.correction_mm, total_correction_mm=-c.total_correction_mm)
    found = judged(replace(case, correction=wrong))
    names = [check.name for check in found.checks if not check.passed]
    assert names == ["sign", "RMS"]


def test_waves_that_are_not_to_be_corrected_are_seen(steep):
    c = steep.correction
    ripple = 0.002 * (-1.0) ** np.add.outer(np.arange(len(c.y_mm)), np.arange(len(c.x_mm)))
    rough = replace(
        c, correction_mm=c.correction_mm + ripple, total_correction_mm=c.total_correction_mm + ripple
    )
    found = judged(replace(steep, correction=rough))
    assert not check_of(found, "band").passed
    assert check_of(judged(steep), "band").value < 1.0


def test_the_second_pass_is_judged_by_what_it_changes():
    case = example(5)
    left = case.reground()
    second = compensate(left, CompensateConfig(repeatability_um=0.1), case.correction)
    again = replace(case, map=left, correction=second)
    found = judged(again)
    assert found.passed, found
    forgot = judged(again, MISTAKES["without this pass"])
    assert not forgot.passed
    assert forgot.looks_like == "a file without the correction of this pass"


def test_a_removal_grid_is_judged_too(steep):
    c = steep.correction
    x, y = np.meshgrid(c.x_mm, c.y_mm)
    on = np.isfinite(c.correction_mm)
    good = ReadBackField("dwell", x[on], y[on], c.correction_mm[on], 1e-9)
    gate = Gate(steep.map, c)
    assert gate.judge(good).passed
    bad = gate.judge(replace(good, correction_mm=-good.correction_mm))
    assert not bad.passed
    assert "sign" in bad.looks_like


@pytest.mark.parametrize("name", list(GOOD))
def test_points_between_the_nodes_are_judged_at_every_kind_of_border(name):
    gate, file = example(6, **GOOD[name]).between()
    found = gate.judge(file)
    assert found.passed, [check for check in found.checks if not check.passed]
    moved = file.points_mm + np.array([0.0, 0.0, 1e-5])
    assert not check_of(gate.judge(replace(file, points_mm=moved)), "rounding").passed


@pytest.mark.parametrize("wheel", [Wheel(60.0), Wheel(60.0, 9.0, (0.6, 0.8, 0.0))], ids=["sphere", "torus"])
def test_tool_centres_are_judged_by_where_their_wheel_touches(wheel):
    case = example(7, turned=True)
    c, points = case.correction, case.on_nodes(case.correction.total_correction_mm)
    rng = np.random.default_rng(1)

    def file(centres):
        near = points + 0.01 * rng.standard_normal(points.shape)  # as well as contacts are recovered
        return replace(
            read_of(case), points_mm=near, centres_mm=np.round(centres, 6), wheel=wheel, reach_mm=5.0
        )

    gate = Gate(case.map, c)
    found = gate.judge(file(points + centre_from_contact(wheel, case.normals)))
    # At the border the normals of the correction are one-sided differences: some um aside, 1 nm deep.
    assert check_of(found, "rounding").value < 15.0
    inner = gate.judge(file(points + centre_from_contact(wheel, case.told_normals(gate))))
    assert inner.passed, [check for check in inner.checks if not check.passed]
    old = gate.judge(file(points + centre_from_contact(wheel, case.nominal_normals)))
    assert not check_of(old, "rounding").passed  # R |grad e|^2 / 2 too deep


def test_a_pose_that_is_not_undone_is_named(steep):
    pose = Pose(np.eye(3), np.array([0.0, 0.0, 5.0]), "surface", "file")
    found = judged(steep, surface_from_file=pose)
    assert not check_of(found, "frame").passed
    assert "frame" in found.looks_like
