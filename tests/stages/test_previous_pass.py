"""What came of the pass before: learned transfer, passes never ground, passes that did harm."""

from dataclasses import replace

import numpy as np
import pytest
from truth_maps import WINDOW, aligned, form_error_mm, random_places

from cmm_align.config import CompensateConfig
from cmm_align.errors import NumericsError, WrongStageError
from cmm_align.numerics.grid_field import interpolated
from cmm_align.stages.compensate import compensate
from cmm_align.stages.error_map import error_map

TRUST = CompensateConfig(trust_me=True)


def measured(error, seed):
    return error_map(aligned(WINDOW, error, random_places(WINDOW, 2500, seed), noise_mm=3e-4, seed=seed + 50))


@pytest.fixture(scope="module")
def one():
    return compensate(measured(form_error_mm, 1))


def after(one, share, *, turn=(1, 1)):
    """The part after a share of the correction was ground, in a frame that may be turned."""
    told = np.where(np.isfinite(one.correction_mm), one.correction_mm, 0.0)

    def error(x, y):
        return form_error_mm(x, y) + share * interpolated(one.x_mm, one.y_mm, told, turn[0] * x, turn[1] * y)

    return measured(error, 2)


@pytest.mark.parametrize("share", [0.5, 0.9, 1.1])
def test_the_transfer_is_learned_within_its_uncertainty(one, share):
    r = compensate(after(one, share), previous=one).response
    assert abs(r.transfer - share) < 3.0 * r.u_transfer
    assert r.u_transfer < 0.1
    assert f"did {100 * r.transfer:.0f} +-" in r.words


def test_a_pass_that_was_never_ground_is_refused(one):
    again = after(one, 0.0)
    with pytest.raises(WrongStageError, match="shows nothing of pass 1"):
        compensate(again, previous=one)
    assert compensate(again, TRUST, previous=one).pass_number == 2


def test_a_wrong_sign_is_named(one):
    with pytest.raises(NumericsError, match=r"the wrong sign"):
        compensate(after(one, -1.0), previous=one)


@pytest.mark.parametrize(
    ("turn", "words"),
    [((-1, -1), "turned by 180 deg"), ((-1, 1), "mirrored in x"), ((1, -1), "mirrored in y")],
)
def test_a_swapped_frame_is_named(one, turn, words):
    with pytest.raises(NumericsError, match=words):
        compensate(after(one, 1.0, turn=turn), previous=one)


def test_another_part_is_not_taken_for_a_turned_one(one):
    other = measured(lambda x, y: 0.03 * np.cos(x / 8.0) * np.cos(y / 6.0), 2)
    with pytest.raises(NumericsError, match="wrong file, another part"):
        compensate(other, previous=one)


def test_a_chain_with_a_gap_is_refused(one):
    with pytest.raises(WrongStageError, match="without a gap"):
        compensate(after(one, 0.9), previous=replace(one, pass_number=3))


def test_at_the_floor_nothing_is_judged(one):
    two = compensate(after(one, 1.0), previous=one)
    third = measured(lambda x, y: 2e-4 * np.sin(x / 5.0), 9)
    r = compensate(third, previous=two).response
    assert r.u_transfer > 0.3
