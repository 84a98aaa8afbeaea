"""A ledger that learns the transfer of a process: ``python tests/bench/ledger_learning.py [SEEDS]``.

A window with a form error of 27.3 um PV is ground by a machine that does half of what it is told, and
scatters by 0.5 um RMS from pass to pass. Nobody tells the software; with a ledger it finds out after the
first pass. The floor is what a machine that is known leaves in its late passes.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from table import Row, show

from cmm_align.config import CompensateConfig
from cmm_align.model import Ledger
from cmm_align.stages.compensate import compensate
from cmm_align.stages.error_map import error_map
from cmm_align.stages.learned_transfer import learned_transfer
from cmm_align.stages.ledger_entry import ledger_entry, pass_outcome, with_outcome
from cmm_align.stages.spatial_bands import wave_bands
from cmm_align.virtual.form_error import form_error
from cmm_align.virtual.grinder import Grinder, grind
from cmm_align.virtual.window import window

sys.path.append(str(Path(__file__).resolve().parents[1]))
from truth_maps import aligned

SURFACE = window()
TRUST = CompensateConfig(trust_me=True)
NOISE_MM = 3e-4
EMPTY = Ledger("0" * 64, "", "", "", wave_bands(SURFACE.bounds))


def measured(part, seed: int, points: int):
    """Return the map of a part at random places, rigid motions left in: the loop takes them off."""
    rng, b = np.random.default_rng(seed), SURFACE.bounds
    places = rng.uniform(b.x_min, b.x_max, points), rng.uniform(b.y_min, b.y_max, points)
    return error_map(aligned(SURFACE, part, places, noise_mm=NOISE_MM, seed=seed))


def commanded(correction):
    """Return the points of the commanded surface."""
    x, y = np.meshgrid(correction.x_mm, correction.y_mm)
    inside = np.isfinite(correction.commanded_z_mm)
    return np.column_stack([x[inside], y[inside], correction.commanded_z_mm[inside]])


def chain(grinder: Grinder, passes: int, seed: int, *, learn: bool, config=TRUST, points=4000):
    """Return the RMS of the points, um, before each pass and after the last, and the ledger."""
    truth = form_error(SURFACE, pv_mm=0.0273, seed=seed)
    part = grind(SURFACE, truth.at, None, grinder, seed=1000 * seed)
    previous, rms, ledger = None, [], EMPTY
    for k in range(passes + 1):
        m = measured(part, 1000 * seed + 100 + k, points)
        rms.append(m.point_statistics.rms_mm * 1e3)
        if previous is not None:
            ledger = with_outcome(
                ledger, previous.map_digest, pass_outcome(m, previous, ledger.bands, config, "")
            )
        correction = compensate(m, config, previous, learned_transfer(ledger) if learn else None)
        row = ledger_entry(f"part {seed}", m, correction, previous, ledger.bands, config, "")
        ledger, previous = replace(ledger, passes=(*ledger.passes, row)), correction
        part = grind(SURFACE, truth.at, commanded(correction), grinder, seed=1000 * seed + k + 1)
    return rms, ledger


def main(seeds: int) -> None:
    """Show the table."""
    half = Grinder(0.5, repeatability_mm=0.5e-3)
    runs = {}
    for name, learn, config in (
        ("ledger", True, TRUST),
        ("nothing known", False, TRUST),
        ("told", False, replace(TRUST, gain_rule="wiener", transfer="0.5", u_transfer=0.05)),
    ):
        chains = [chain(half, 4, seed, learn=learn, config=config) for seed in range(seeds)]
        runs[name] = np.array([rms for rms, _ in chains])
        if learn:
            ledgers = [ledger for _, ledger in chains]
    mean = {name: np.sqrt(np.mean(rms**2, axis=0)) for name, rms in runs.items()}
    floor = float(np.sqrt(np.mean(runs["told"][:, 3:] ** 2)))
    pulls, held = [], []
    for ledger in ledgers:
        for one in ledger.passes[:-1]:
            held.append(bool(one.interval_held))
            pulls += [
                (b.transfer - 0.5) / b.u_transfer
                for b in one.came.bands[:2]
                if b is not None and b.u_transfer < 0.5
            ]
    rows = [
        Row("floor: told the transfer, late passes", "", f"{floor:.3f} um RMS"),
        *(
            Row(
                f"after {k} compensations: ledger (nothing known)",
                "",
                f"{mean['ledger'][k]:.3f} um ({mean['nothing known'][k]:.3f})",
            )
            for k in range(5)
        ),
        Row("compensations until within 10 % of the floor", "<= 4", str(_reached(mean["ledger"], floor))),
        Row("the same, nothing known", "", str(_reached(mean["nothing known"], floor))),
        Row(
            "transfer of long waves within 2 u",
            ">= 95 %",
            f"{100 * np.mean(np.abs(pulls) < 2):.1f} % of {len(pulls)}",
        ),
        Row("predicted RMS: 95 % interval holds", "", f"{100 * np.mean(held):.1f} % of {len(held)}"),
    ]
    show(f"a process that does half of what it is told, {seeds} seeds", rows)


def _reached(rms, floor: float) -> int | None:
    """Return the first pass whose RMS is within a tenth of the floor."""
    good = np.flatnonzero(rms <= 1.1 * floor)
    return int(good[0]) if len(good) else None


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 20)
