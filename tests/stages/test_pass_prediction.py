"""What a prediction is worth: its mean and its interval over some virtual passes."""

import numpy as np
import pytest
from truth_maps import WINDOW, aligned, form_error_mm, random_places

from cmm_align.config import CompensateConfig
from cmm_align.numerics.grid_field import interpolated
from cmm_align.stages.compensate import compensate
from cmm_align.stages.error_map import error_map
from cmm_align.virtual.grinder import Grinder, grind

PLACES = random_places(WINDOW, 1200, 3)
SCATTER_MM = 0.5e-3


def measured(part, seed):
    return error_map(aligned(WINDOW, part, PLACES, noise_mm=3e-4, seed=seed))


def one_pass(seed):
    """The prediction, and the RMS of the points after a pass with a transfer of 0.9 +- 0.05."""
    transfer = float(np.random.default_rng(seed).normal(0.9, 0.05))
    machine = Grinder(repeatability_mm=SCATTER_MM)
    first = measured(grind(WINDOW, form_error_mm, None, machine, seed=2 * seed), 2 * seed)
    config = CompensateConfig(transfer="0.9", u_transfer=0.05, repeatability_um=1e3 * SCATTER_MM)
    c = compensate(first, config)
    again = grind(WINDOW, form_error_mm, None, machine, seed=2 * seed + 1)
    told = np.nan_to_num(c.correction_mm)

    def part(x, y):
        return again(x, y) + transfer * interpolated(c.x_mm, c.y_mm, told, x, y)

    return c.prediction, measured(part, 2 * seed + 1).point_statistics.rms_mm


def test_the_interval_holds_the_outcome_and_the_mean_is_right():
    passes = [one_pass(seed) for seed in range(8)]
    held = [p.rms_low_mm <= rms <= p.rms_high_mm for p, rms in passes]
    ratio = np.array([(rms / p.rms_mm) ** 2 for p, rms in passes])
    assert sum(held) >= 6  # of 8 at 95 %: 5 or fewer in 1 of 2000
    assert ratio.mean() == pytest.approx(1.0, abs=3.0 * ratio.std() / len(ratio) ** 0.5)


def test_at_the_floor_another_pass_is_not_worth_it_and_the_sentence_says_why():
    m = measured(grind(WINDOW, lambda x, y: 0.0 * x, None, Grinder(repeatability_mm=SCATTER_MM), seed=5), 5)
    c = compensate(m)
    assert not c.worth_another_pass
    assert c.reason.startswith(f"RMS {1e3 * c.before.rms_mm:.2f} -> {1e3 * c.prediction.rms_mm:.2f} +- ")
    assert "not worth it" in c.reason
    assert "the process scatters by 0.5 um" in c.reason
    assert c.prediction.rms_mm > c.before.rms_mm  # chance ground in: the funnel
    gentle = compensate(m, CompensateConfig(gain_rule="wiener"))
    assert gentle.gain < 0.6
    assert gentle.prediction.rms_mm < c.prediction.rms_mm


def test_parts_of_the_mean_square_add_up():
    m = measured(form_error_mm, 8)
    p = compensate(m, CompensateConfig(transfer="0.9", u_transfer=0.0, repeatability_um=0.0)).prediction
    scatter = (
        p.rms_mm**2 - p.left_rms_mm**2
    ) ** 0.5  # only the noise that the correction took from these points
    assert 0.05 * p.noise_mm < scatter < 0.5 * p.noise_mm
    more = compensate(m, CompensateConfig(transfer="0.9", u_transfer=0.0, repeatability_um=1.0)).prediction
    chased = (more.rms_mm**2 - p.rms_mm**2) / (2.0 * 0.9 * 1e-6)
    assert 0.9 < chased < 1.0  # all of it but what the low-pass holds back of waves under two cutoffs
