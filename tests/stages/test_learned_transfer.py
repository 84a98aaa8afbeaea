"""What a ledger learns: the combination of passes and parts, the gain made of it, the wear of the wheel."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from cmm_align.model import (
    BandRecord,
    BandResponse,
    Dressing,
    LearnedBand,
    LearnedTransfer,
    Ledger,
    LedgerPass,
    PassOutcome,
    WaveBand,
)
from cmm_align.numerics.areal_filter import gaussian_transmission
from cmm_align.stages.learned_transfer import (
    LARGEST_STEP,
    USUAL_SCATTER,
    USUAL_WEIGHT,
    gain_of,
    gains_at,
    learned_transfer,
    process_of,
    stepped_gain,
)
from cmm_align.stages.wheel_wear import wheel_wear

BANDS = (WaveBand(30.0, math.inf), WaveBand(15.0, 30.0), WaveBand(7.5, 15.0))


def passed(part: str, number: int, *answers, constant=None) -> LedgerPass:
    """Return a pass whose bands answered with (transfer, u), or None."""
    bands = tuple(None if a is None else BandResponse(1.0, *a) for a in answers)
    constant, u, told = constant or (None, None, None)
    return LedgerPass(
        part, number, "", f"{part} {number}", "", "", "", 100, 20.0, 4.0, 20.0, 4.0, 0.1, 5.0,
        constant, u, told, "fixed", 1.0, 1.0, 0.5, 1.5, 6.0, 5.0, 8.0, 0.6,
        (BandRecord(4.0, 4.0), BandRecord(2.0, 2.0), BandRecord(1.0, 1.0)),
        PassOutcome("", "", 1.0, 6.0, bands) if bands else None,
    )  # fmt: skip


def ledger_of(*passes: LedgerPass, dressings=()) -> Ledger:
    return Ledger("", "", "", "", BANDS, passes, tuple(dressings))


def learned(*pairs) -> LearnedTransfer:
    bands = (LearnedBand(band, c, u, 0.0, 1, 1) for band, (c, u) in zip(BANDS, pairs, strict=True))
    return LearnedTransfer(tuple(bands), 0.05)


def test_nothing_is_learned_of_nothing():
    assert learned_transfer(ledger_of()) is None
    assert learned_transfer(ledger_of(passed("A", 1))) is None
    assert learned_transfer(ledger_of(passed("A", 1, (0.5, 0.6), None, None))) is None


def test_passes_that_agree_are_weighted_by_their_uncertainties():
    found = learned_transfer(
        ledger_of(passed("A", 1, (0.5, 0.04), None, None), passed("A", 2, (0.52, 0.08), None, None))
    )
    w = 1.0 / (np.array([0.04, 0.08]) ** 2 + USUAL_SCATTER**2 * 4 / 5)
    first = found.bands[0]
    assert first.transfer == pytest.approx(np.average([0.5, 0.52], weights=w), rel=1e-12)
    assert first.u == pytest.approx(math.sqrt(1.0 / w.sum() + USUAL_SCATTER**2 * 4 / 5 * 5 / 3), rel=1e-12)
    assert (first.n_passes, first.n_parts) == (2, 1)


def test_scatter_between_parts_is_found_and_counts_for_the_next_part():
    """Two parts with equal u: Q = (c1 - c2)^2 / (2 u^2), so t^2 = (c1 - c2)^2 / 2 - u^2, of weight 1 in 5."""
    found = learned_transfer(
        ledger_of(passed("A", 1, (0.7, 0.02), None, None), passed("B", 1, (0.9, 0.02), None, None))
    )
    tau2 = (USUAL_WEIGHT * USUAL_SCATTER**2 + 0.2**2 / 2.0 - 0.02**2) / (USUAL_WEIGHT + 1.0)
    assert found.bands[0].scatter == pytest.approx(math.sqrt(tau2), rel=1e-12)
    assert found.bands[0].transfer == pytest.approx(0.8)
    assert found.bands[0].u == pytest.approx(math.sqrt((0.02**2 + tau2) / 2.0 + tau2 * 5 / 3), rel=1e-12)


def test_the_stated_uncertainty_holds_the_next_part():
    rng = np.random.default_rng(1)
    held = []
    for _ in range(600):
        parts = rng.normal(0.7, 0.06, 9)
        rows = [passed(str(k), 1, (rng.normal(c, 0.05), 0.05), None, None) for k, c in enumerate(parts[:-1])]
        one = learned_transfer(ledger_of(*rows)).bands[0]
        held.append(abs(parts[-1] - one.transfer) < 2.0 * one.u)
    assert 0.90 < np.mean(held) < 0.985  # 95.4 %; tau comes of 8 parts, so its tails are thin


def test_bands_without_knowledge_are_taken_on_the_safe_side():
    found = learned_transfer(ledger_of(passed("A", 1, None, (0.6, 0.03), None)))
    assert [band.n_passes for band in found.bands] == [0, 1, 0]
    assert found.bands[0].transfer == 1.0
    assert found.bands[2].transfer == pytest.approx(0.6)
    assert found.bands[2].u == pytest.approx(2.0 * found.bands[1].u)


def test_a_process_that_hardly_answers_is_not_chased_with_a_large_gain():
    assert learned_transfer(ledger_of(passed("A", 1, (0.1, 0.02), None, None))) is None


@pytest.mark.parametrize(("c", "u"), [(0.5, 0.0), (0.5, 0.05), (0.9, 0.2), (1.1, 0.03), (0.4, 0.2)])
def test_the_gain_leaves_least_and_keeps_the_loop_in_its_limits(c, u):
    one = LearnedBand(BANDS[0], c, u, 0.0, 1, 1)
    gains = np.linspace(0.0, 3.0, 30_001)
    left = (1.0 - gains * c) ** 2 + (gains * u) ** 2
    allowed = gains * (c + 2.0 * u) <= LARGEST_STEP
    assert gain_of(one) == pytest.approx(gains[allowed][np.argmin(left[allowed])], abs=2e-4)


def test_steps_of_gain_have_the_gain_of_each_band_in_its_middle():
    """Against the transmissions of ideal filters; a Gaussian of order 2 reaches 1 or 0 two octaves away."""
    same = learned((0.5, 0.0), (0.5, 0.0), (0.5, 0.0))
    cutoffs, shares = stepped_gain(same, 0.8, 6.0, 100.0)
    np.testing.assert_allclose(shares, [1.6, 0.0, 0.0], atol=1e-12)
    assert cutoffs[0] == 6.0
    falling = learned((0.8, 0.0), (0.5, 0.0), (0.4, 0.0))
    cutoffs, shares = stepped_gain(falling, 1.0, 7.5, 100.0)
    at = sum(
        s * gaussian_transmission(np.array([1e3, 21.2]), c) for c, s in zip(cutoffs, shares, strict=True)
    )
    assert at[0] == pytest.approx(1.25, rel=1e-3)
    assert at[1] == pytest.approx(2.0, rel=0.06)
    assert sum(shares) == pytest.approx(1.25)
    one_band = stepped_gain(falling, 1.0, 40.0, 100.0)
    np.testing.assert_allclose(one_band[1], [1.25])


def test_the_curve_over_the_wavelength_is_that_of_the_bands():
    found = learned((0.8, 0.01), (0.5, 0.01), (0.4, 0.01))
    curve = process_of(found)
    middles = np.array([60.0, math.sqrt(450.0), math.sqrt(112.5)])
    np.testing.assert_allclose(curve.at(1.0 / middles), [0.8, 0.5, 0.4])
    np.testing.assert_allclose(gains_at(found, 1.0 / middles), [gain_of(one) for one in found.bands])
    assert curve.known


def worn(slope: float, seed: int, *, dressed=(), transfer=0.7, u=0.1, n=10) -> Ledger:
    """Return a ledger of a wheel whose constant grows from pass to pass; chains of two passes each."""
    rng = np.random.default_rng(seed)
    rows, since = [], 0
    for k in range(n):
        since = 0 if k in dressed else since + (k > 0)
        told = 0.0 if k % 2 == 0 else -4.0
        value = (
            5.0 + 2.0 * sum(k >= d for d in dressed) + slope * since + transfer * told + rng.normal(0.0, u)
        )
        answers = ((0.7, 0.03), None, None) if k % 2 == 0 else ()
        rows.append(passed(str(k // 2), k % 2 + 1, *answers, constant=(value, u, told)))
    return ledger_of(*rows, dressings=[Dressing("", "", d) for d in dressed])


def test_the_slope_of_wear_comes_out_within_its_uncertainty():
    pulls = []
    for seed in range(100):
        ledger = worn(0.25, seed)
        wear = wheel_wear(ledger, learned_transfer(ledger))
        pulls.append((wear.um_per_pass - 0.25) / wear.u_um_per_pass)
    assert np.mean(np.abs(pulls) < 2.0) > 0.90
    assert abs(np.mean(pulls)) < 0.35


def test_a_dressed_wheel_starts_anew():
    ledger = worn(0.25, 1, dressed=(4, 7), u=0.001)
    wear = wheel_wear(ledger, learned_transfer(ledger))
    assert wear.n_dressings == 2
    assert wear.um_per_pass == pytest.approx(0.25, abs=3.0 * wear.u_um_per_pass)
    forgotten = wheel_wear(replace(ledger, dressings=()), learned_transfer(ledger))
    assert abs(forgotten.um_per_pass - 0.25) > 0.1


def test_wear_is_not_told_of_planes_or_of_one_pass():
    assert wheel_wear(ledger_of(passed("A", 1), passed("A", 2))) is None
    assert wheel_wear(ledger_of(passed("A", 1, constant=(1.0, 0.1, 0.0)))) is None
