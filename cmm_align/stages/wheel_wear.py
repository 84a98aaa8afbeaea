"""Wear of the wheel: what a part has too much of everywhere, and how that grows from pass to pass.

A wheel that got smaller by d leaves ``d`` along the normal everywhere. The best fit hides what of it looks
like a motion of the part; the rest shows in the constant

    L(f) = <p, f> / <p, p>,   p = 1 less its part in the motions,

which no motion changes (a plane has no such rest: there wear and a shift are one). Noise and chance hand it
``u^2 = (C + 2 pi l^2 s_rep^2) / (dA <p, p>)``. Over the passes of a ledger

    L(e_i) = a + b i + c L(t_i),

i the number of passes since the wheel was dressed, a a constant for each dressing, t_i the total correction
that the part was ground with and c the transfer of long waves, which enters with what is known of it. All are
fitted at once, weighted by 1/u^2; the uncertainty of b is raised by the scatter about the line where that is
larger than the u tell (R. T. Birge, Physical Review 40, 1932). Parts are taken to have one form error in
common, that of the machine.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from cmm_align.config import CompensateConfig
from cmm_align.model import Correction, DeviationMap, LearnedTransfer, Ledger, WheelWear
from cmm_align.stages.correction_grid import total_so_far
from cmm_align.stages.map_nodes import pose_rows
from cmm_align.stages.map_noise import MapNoise, step_of
from cmm_align.stages.repeatability import repeatability_length_mm
from cmm_align.stages.spatial_bands import thinned, thinning, wave_bands
from cmm_align.units import UM_PER_MM

HIDDEN: Final = 1e-4
"""Where motions hide all but this share of the square of a constant, it is not told."""


class Constant(NamedTuple):
    """What is too much everywhere, its standard uncertainty, and the same of the command; None if hidden."""

    um: float | None
    u_um: float | None
    told_um: float | None


def constant_part(
    deviation_map: DeviationMap,
    noise: MapNoise,
    previous: Correction | None,
    config: CompensateConfig,
) -> Constant:
    """Return what a part has too much of everywhere along the normal, and what it was told of that.

    Parameters
    ----------
    deviation_map : DeviationMap
    noise : MapNoise
        Of the map.
    previous : Correction or None
        What the part was ground with.
    config : CompensateConfig
        Repeatability.
    """
    m, alignment = deviation_map, deviation_map.alignment
    block = thinning(wave_bands(alignment.nominal.surface.bounds), max(step_of(m.x_mm), step_of(m.y_mm)))
    x_mm, y_mm = (thinned(axis[None], 1, block)[0] for axis in (m.x_mm, m.y_mm))
    deviation = thinned(m.deviation_mm, block, block)
    known = np.isfinite(deviation)
    if not known.any():
        return Constant(None, None, None)
    x, y = (a[known] for a in np.meshgrid(x_mm, y_mm))
    rows = pose_rows(alignment.nominal, alignment.centroid_mm, x, y)
    rows = rows / np.linalg.norm(rows, axis=0).clip(1e-300)
    ones = np.ones(len(rows))
    rest = ones - rows @ np.linalg.lstsq(rows, ones, rcond=1e-9)[0]
    square = float(rest @ rest)
    if square <= HIDDEN * len(rows):
        return Constant(None, None, None)
    told = float(rest @ total_so_far(previous, x_mm, y_mm)[known]) / square
    value = float(rest @ deviation[known]) / square
    length = repeatability_length_mm(config, alignment.nominal.surface.bounds)
    chance = 2.0 * np.pi * (length * config.repeatability_um / UM_PER_MM) ** 2
    per_area = float(np.nan_to_num(noise.psd.noise_floor_mm4)) + chance
    u = float(np.sqrt(per_area / (step_of(x_mm) * step_of(y_mm) * square)))
    return Constant(value * UM_PER_MM, u * UM_PER_MM, told * UM_PER_MM)


def wheel_wear(ledger: Ledger, learned: LearnedTransfer | None = None) -> WheelWear | None:
    """Return how the constant grows from pass to pass; None if there is no telling.

    Parameters
    ----------
    ledger : Ledger
    learned : LearnedTransfer, optional
        What is known of the transfer; without it, that of long waves is taken as 1 +- 0.5.
    """
    found = [
        (*_since_dressed(ledger, k), p.constant_um, p.u_constant_um, p.told_constant_um)
        for k, p in enumerate(ledger.passes)
        if p.constant_um is not None and p.u_constant_um and p.told_constant_um is not None
    ]
    if not found:
        return None
    dressing, since, constant, u, told = (
        np.array(column, dtype=np.float64) for column in zip(*found, strict=True)
    )
    kinds = np.unique(dressing)
    share, u_share = (1.0, 0.5) if learned is None else (learned.bands[0].transfer, learned.bands[0].u)
    unknowns = [since, *(dressing == kind for kind in kinds), told]
    rows = np.vstack([np.column_stack(unknowns) / u[:, None], [*[0.0] * (1 + len(kinds)), 1.0 / u_share]])
    wanted = np.append(constant / u, share / u_share)
    if np.linalg.matrix_rank(rows) < rows.shape[1]:
        return None
    fit, *_ = np.linalg.lstsq(rows, wanted, rcond=None)
    spare = len(rows) - rows.shape[1]
    chi2 = float(np.sum((wanted - rows @ fit) ** 2)) / spare if spare > 0 else 1.0
    variance = float(np.linalg.inv(rows.T @ rows)[0, 0])
    return WheelWear(
        um_per_pass=float(fit[0]),
        u_um_per_pass=float(np.sqrt(variance * max(chi2, 1.0))),
        n_passes=len(u),
        n_dressings=len(kinds) - 1,
    )


def _since_dressed(ledger: Ledger, k: int) -> tuple[int, int]:
    """Return how often the wheel was dressed before pass k of the ledger, and how many passes ago."""
    before = [one.after_passes for one in ledger.dressings if one.after_passes <= k]
    return len(before), k - max(before, default=0)
