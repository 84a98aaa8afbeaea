"""Minimax fits beside their bars: ``python tests/bench/minimum_zone.py``.

Data of the virtual window: exact ones made from multipliers, and 1e5 points with form error and noise.
"""

from __future__ import annotations

import numpy as np
from table import Row, Stopwatch, show

from cmm_align.numerics.fit_steps import FitSettings, stepped
from cmm_align.numerics.linearisation import Placement
from cmm_align.numerics.minimum_zone import ZoneResult, least_stock, minimum_zone, within_tolerance
from cmm_align.numerics.rigid_fit import FitResult, fit
from cmm_align.numerics.rotations import rotation_from_vector
from cmm_align.surfaces.distance import smooth_measure
from cmm_align.surfaces.geometry import unit_normal
from cmm_align.virtual.window import TIP_RADIUS_MM, window

SURFACE = window()
MEASURE = smooth_measure(SURFACE, 1, TIP_RADIUS_MM)
TURN = rotation_from_vector(np.array([0.3, -0.2, 0.35]))
NOISE_MM = 3e-4
MANY = 100_000


def start(x, y, deviation) -> tuple[np.ndarray, Placement, FitSettings, FitResult]:
    """The points as a machine saw them, the truth, and the least-squares fit."""
    jet = SURFACE.jet(x, y)
    height = TIP_RADIUS_MM + deviation
    tips = np.stack([x, y, jet.z], axis=1) + height[:, None] * unit_normal(jet, 1)
    truth = Placement(TURN, tips.mean(axis=0))
    points = (tips - truth.position_mm) @ TURN
    length = float(np.sqrt(np.mean(np.sum(points**2, axis=1))))
    settings = FitSettings(SURFACE.bounds.diagonal_mm, length, 1e-14, 50, 0.3, 1e-8)
    off = stepped(truth, 0.01 * length * np.array([1.0, -0.5, 0.3, 0.2, 0.4, -0.3]), length)
    return points, truth, settings, fit(MEASURE, points, off, settings, used=np.ones(len(x), dtype=bool))


def exact(n: int, seed: int, t: float = 0.005) -> list[Row]:
    """Data made from multipliers: the zone is known exactly."""
    rng = np.random.default_rng(seed)
    while True:
        x, y = rng.uniform(-48, 48, n), rng.uniform(-28, 28, n)
        jet = SURFACE.jet(x[:7], y[:7])
        normal = unit_normal(jet, 1)
        rows = np.hstack([np.cross(np.stack([x[:7], y[:7], jet.z], axis=1), normal) / 30.0, normal])
        weight = np.linalg.svd(rows.T)[2][6]
        if np.abs(weight).min() > 0.05:
            break
    deviation = rng.uniform(-0.9 * t, 0.9 * t, n)
    deviation[:7] = np.sign(weight) * t
    points, truth, settings, begun = start(x, y, deviation)
    with Stopwatch() as watch:
        found = minimum_zone(MEASURE, points, begun.placement, settings, used=begun.evaluation.used)
    turn = np.abs(found.placement.rotation @ truth.rotation.T - np.eye(3)).max()
    shift = np.abs(found.placement.position_mm - truth.position_mm).max()
    return [
        Row(f"exact data, {n} points: t", "1e-9 relative", f"{abs(found.t_mm / t - 1.0):.1e}"),
        Row("  certificate residual", "<= 1e-9", f"{found.certificate_residual:.1e}"),
        Row("  pose", "exact", f"{shift:.1e} mm, {turn:.1e} rad"),
        Row("  time", "<= 5 s", f"{watch.wall:.2f} s"),
    ]


def told(name: str, found: ZoneResult, seconds: float) -> list[Row]:
    """What a fit of many points came to."""
    return [
        Row(f"{name}, {MANY:.0e} points", "<= 5 s", f"{seconds:.2f} s, {found.programmes} programmes"),
        Row("  t", "-", f"{1e3 * found.t_start_mm:.4f} -> {1e3 * found.t_mm:.4f} um"),
        Row(
            "  certificate residual, gap",
            "<= 1e-9",
            f"{found.certificate_residual:.1e}, {found.gap_mm:.1e} mm",
        ),
    ]


def many() -> list[Row]:
    """1e5 points with form error and noise, all three questions."""
    rng = np.random.default_rng(1)
    x, y = rng.uniform(-50, 50, MANY), rng.uniform(-30, 30, MANY)
    deviation = 0.01 * np.sin(x / 17.0) * np.cos(y / 11.0) + rng.normal(0.0, NOISE_MM, MANY)
    points, _, settings, begun = start(x, y, deviation)
    band = np.full(MANY, 0.008)
    questions = (
        ("minimum zone", minimum_zone, {}),
        ("least stock", least_stock, {}),
        ("inside -8 / +16 um", within_tolerance, {"lower_mm": -band, "upper_mm": 2.0 * band}),
    )
    rows = []
    for name, function, limits in questions:
        with Stopwatch() as watch:
            found = function(MEASURE, points, begun.placement, settings, used=begun.evaluation.used, **limits)
        rows += told(name, found, watch.wall)
    return rows


def main() -> None:
    """Print the table."""
    show("Minimum zone", [*exact(3000, 1), *exact(MANY, 2), *many()])


if __name__ == "__main__":
    main()
