"""Fixed gain against Wiener gain on twenty spectra: ``python tests/bench/gain_rules.py [SEEDS]``.

Form errors of known spectrum (white up to a corner, then falling with a power), measured by 6000 points
with noise, and corrected once by a process that does what it is told. What counts is the RMS of the true
error that is left, over the part, against that of the best fixed gain of this very case (which nobody knows
beforehand)."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from scipy.ndimage import map_coordinates
from table import Row, show

from cmm_align.config import CompensateConfig
from cmm_align.numerics.grid_field import interpolated
from cmm_align.stages.compensate import compensate
from cmm_align.stages.error_map import error_map

sys.path.append(str(Path(__file__).resolve().parents[1]))
from truth_maps import WINDOW, aligned, random_places

SPECTRA = [
    (power, corner, rms_mm, noise_mm)
    for power in (3, 4, 6)
    for corner in (0.01, 0.03)
    for rms_mm, noise_mm in ((5e-3, 0.3e-3), (1e-3, 0.5e-3), (0.4e-3, 0.5e-3))
] + [(4, 0.02, 0.2e-3, 0.5e-3), (6, 0.02, 20e-3, 0.3e-3)]
"""Power of the fall, corner in 1/mm, RMS of form and noise."""

QUIET = {"repeatability_um": 0.0, "u_transfer": 0.0, "transfer": "1", "max_slope_mrad": 100.0}
PLACES = tuple(a.ravel() for a in np.meshgrid(np.linspace(-50, 50, 101), np.linspace(-30, 30, 61)))


def field(power: float, corner: float, rms_mm: float, seed: int):
    """Return a random field of a spectrum as a function of the place."""
    rng, step = np.random.default_rng(seed), 0.5
    shape = 400, 512
    f = np.hypot(np.fft.rfftfreq(shape[1], step), np.fft.fftfreq(shape[0], step)[:, None])
    root = (1.0 + (f / corner) ** 2) ** (-0.25 * power)
    values = np.fft.irfft2(np.fft.rfft2(rng.standard_normal(shape)) * root, s=shape)
    values *= rms_mm / values[130:255, 150:355].std()
    return lambda x, y: map_coordinates(values, [(y + 31.0) / step + 130, (x + 51.0) / step + 150])


def left(kind: tuple[float, float, float, float], seed: int) -> tuple[float, float, float]:
    """Return the RMS left by gain 1, by the best fixed gain, and by the Wiener gain, mm."""
    error = field(*kind[:3], seed)
    measured = aligned(WINDOW, error, random_places(WINDOW, 6000, seed), noise_mm=kind[3], seed=seed + 100)
    deviation_map, true = error_map(measured), error(*PLACES)
    corrections = [
        compensate(deviation_map, CompensateConfig(gain_rule=r, **QUIET)) for r in ("fixed", "wiener")
    ]
    fixed, wiener = (interpolated(c.x_mm, c.y_mm, c.correction_mm, *PLACES) for c in corrections)
    best = min(max(-(fixed @ true) / (fixed @ fixed), 0.0), 1.2)
    return tuple(float(np.sqrt(np.mean((true + q) ** 2))) for q in (fixed, best * fixed, wiener))


def main(seeds: int) -> None:
    """Show the table."""
    rows, ratios = [], []
    for kind in SPECTRA:
        one, best, wiener = np.sqrt(np.mean(np.square([left(kind, s) for s in range(seeds)]), axis=0))
        ratios.append((one / best, wiener / best))
        rows.append(
            Row(
                f"power {kind[0]}, corner {1 / kind[1]:.3g} mm, form {1e3 * kind[2]:g} um, "
                f"noise {1e3 * kind[3]:g} um",
                "1.03",
                f"best {1e3 * best:.3f} um; gain 1: {one / best:.3f}, Wiener: {wiener / best:.3f} of it",
            )
        )
    worst = np.max(ratios, axis=0)
    rows.append(Row("worst of them", "1.03", f"gain 1: {worst[0]:.3f}, Wiener: {worst[1]:.3f}"))
    show(f"gain rules, {seeds} fields each", rows)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 5)
