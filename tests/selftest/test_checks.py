"""The self-test finds what it should find: it passes here, and it fails where the software is wrong."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from cmm_align.selftest import checks, closed_forms, null_space, parts
from cmm_align.selftest.checks import CHECKS, Check, run
from cmm_align.selftest.finding import MPE_NM, Finding
from cmm_align.surfaces import distance


def test_a_number_past_its_limit_or_none_at_all_does_not_pass() -> None:
    good = Finding("x", 0.5 * MPE_NM, "nm", 1)

    assert good.passed
    assert not replace(good, error=1.01 * MPE_NM).passed
    assert not replace(good, error=math.nan).passed
    assert Check("a", (good,), 0.0).passed
    assert not Check("a", (good,), 0.0, trouble="it broke").passed
    assert math.isnan(Check("a", (good, replace(good, error=math.nan)), 0.0).largest("nm"))


def test_an_exception_is_a_check_that_did_not_pass_and_the_others_still_run(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def broken() -> list[Finding]:
        raise ZeroDivisionError("of\nours")

    cases = (checks._Case("broken", broken), checks._Case("good", lambda: [Finding("x", 0.0, "nm", 1)]))
    monkeypatch.setattr(checks, "CHECKS", cases)
    found = list(run())

    assert [check.passed for check in found] == [False, True]
    assert found[0].trouble == "ZeroDivisionError: of ours"


@pytest.mark.parametrize("case", [c for c in CHECKS if "cap" not in c.name], ids=lambda c: c.name)
def test_a_check_passes_with_room(case: checks._Case) -> None:
    for finding in case.measure():
        assert finding.error <= 0.01 * finding.limit, finding


def test_the_cap_of_sixty_degrees_passes_with_room() -> None:
    from cmm_align.selftest import caps

    assert all(f.error <= 0.01 * f.limit for f in caps._cap(60.0))


def test_a_distance_that_is_off_by_two_nanometres_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    true = distance.foot_points

    def off(*arguments, **settings):
        feet = true(*arguments, **settings)
        return feet._replace(distance_mm=feet.distance_mm + 2e-6)

    monkeypatch.setattr(distance, "foot_points", off)

    assert not any(finding.passed for finding in closed_forms.closed_form_distances())


def test_a_pose_that_is_off_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    true = null_space.align

    def tilted(*arguments, **settings):
        found = true(*arguments, **settings)
        turned = parts.Pose(
            parts.rotation_from_vector(np.array([0.0, 0.0, 2e-9])), np.zeros(3), "part", "part"
        )
        return replace(found, part_from_machine=turned @ found.part_from_machine)

    monkeypatch.setattr(null_space, "align", tilted)
    bad = [f.what for f in null_space.least_squares() if not f.passed]

    assert bad == ["least squares: turn", "least squares, many: turn"]


def test_a_wrong_carried_step_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    true = distance.shifted_feet

    def wrong(side, radius_mm, feet, shift_mm):
        found = true(side, radius_mm, feet, shift_mm)
        return found._replace(distance_mm=feet.distance_mm + 0.8 * (found.distance_mm - feet.distance_mm))

    monkeypatch.setattr(distance, "shifted_feet", wrong)
    bad = [f.what for f in null_space.least_squares() if not f.passed]

    assert bad
    assert all(what.startswith("least squares, many") for what in bad)


def test_places_fill_the_rectangle_evenly() -> None:
    x, y = parts.even_places(1024, 48.0, 28.0)
    counts, *_ = np.histogram2d(x, y, bins=8, range=[[-48, 48], [-28, 28]])

    assert counts.min() >= 12
    assert counts.max() <= 20
