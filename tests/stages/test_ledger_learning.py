"""A ledger finds out that a process does half of what it is told, and the loop is at its floor in time."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1] / "bench"))
from ledger_learning import chain

from cmm_align.stages.learned_transfer import learned_transfer
from cmm_align.virtual.grinder import Grinder


def test_a_transfer_of_one_half_is_learned_and_the_floor_reached_within_four_passes():
    rms, ledger = chain(Grinder(0.5, repeatability_mm=5e-4), 3, 1, learn=True, points=2500)
    long = learned_transfer(ledger).bands[0]
    assert abs(long.transfer - 0.5) < 2.0 * long.u
    # noise of 0.3 um; chance of 0.5 um comes twice, as that of one pass is ground into the next. Over
    # 10 mm it has A / (4 pi l^2) = 5 independent values: the RMS of one pass scatters by 1 / sqrt(2 * 5)
    floor_um = (0.3**2 + 2.0 * 0.5**2) ** 0.5
    assert rms[1] > 2.0 * floor_um  # nobody knew
    assert rms[2] < 1.32 * floor_um
    assert rms[3] < 1.32 * floor_um
