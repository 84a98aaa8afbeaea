"""Coefficients of low orders beside their intervals: ``python tests/bench/low_orders.py [SEEDS]``.

A known form error of 27 um is measured by 20 000 points with 0.3 um of noise, 300 times. The truth is its own
projection on the shapes. Beside the coefficients from the nodes of the map stand those fitted to the points.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from table import Row, Stopwatch, show

from cmm_align.numerics.aperture_basis import (
    low_order_shapes,
    node_widths,
    orthonormalised,
    outline_of,
)
from cmm_align.numerics.handed_noise import handed_noise
from cmm_align.numerics.local_regression import local_regression
from cmm_align.stages.error_map import error_map
from cmm_align.stages.low_orders import _on_nominal, low_orders
from cmm_align.stages.told_motions import motion_columns

sys.path.append(str(Path(__file__).resolve().parents[1]))
from truth_maps import WINDOW, Quadric, aligned, form_error_mm, random_places

POINTS = 20_000
NOISE_MM = 0.3e-3
BOWL = Quadric(half_x=40.0, half_y=40.0, c=0.005, d=0.003, round=True)


def scan_places(surface, n):
    """Scan lines over the aperture, about n points, five times as dense along as across."""
    along = int(np.sqrt(5 * n * surface.half_x / surface.half_y))
    x = np.linspace(-surface.half_x, surface.half_x, along)
    y = np.linspace(-surface.half_y, surface.half_y, n // along)
    xg, yg = (a.ravel() for a in np.meshgrid(x, y))
    inside = surface.contains(xg, yg)
    return xg[inside], yg[inside]


def to_points(bare, x, y, known, weights, places):
    """What turns deviations of points into coefficients by least squares, and the variance for s = 1."""
    field = np.where(known, 0.0, np.nan)
    nodes = _on_nominal(bare, x, y, field, weights)
    shapes = low_order_shapes(outline_of(x, y, known), *nodes.points_mm.T[:2])
    raw = np.hstack([motion_columns(bare, nodes.points_mm, nodes.normals), shapes.columns])
    root = np.sqrt(nodes.weight)[:, None]
    q, fresh = orthonormalised(raw * root)
    q /= root
    back = np.linalg.lstsq(raw[:, fresh], q[:, fresh], rcond=None)[0]
    foot = np.stack([*places, bare.nominal.surface.jet(*places).z], axis=1)
    arm = foot - nodes.points_mm.mean(axis=0)
    length = np.sqrt(np.mean(np.sum((nodes.points_mm - nodes.points_mm.mean(axis=0)) ** 2, axis=1)))
    rows = np.hstack([np.cross(arm, bare.normals) / length, bare.normals])
    at_nodes = np.hstack(
        [np.cross(nodes.points_mm - nodes.points_mm.mean(axis=0), nodes.normals) / length, nodes.normals]
    )
    motions = rows @ np.linalg.lstsq(at_nodes, raw[:, :6], rcond=None)[0]
    there = np.hstack([motions, low_order_shapes(outline_of(x, y, known), *places).columns])[:, fresh] @ back
    return there, np.linalg.inv(there.T @ there)


def coverage(name, surface, places, seeds):
    """Share of 95 % intervals that hold the truth, worst RMS, and what points would have given."""
    bare = aligned(surface, form_error_mm, places)
    m = error_map(bare)
    x, y, known = m.x_mm, m.y_mm, np.isfinite(m.deviation_mm)
    wx, wy = (node_widths(a, p.min(), p.max()) for a, p in zip((x, y), places, strict=True))
    weights = np.outer(wy, wx)
    truth = low_orders(
        bare, x, y, np.where(known, form_error_mm(*np.meshgrid(x, y)), np.nan), m.sigma_mm**2, weights
    )
    there, unscaled = to_points(bare, x, y, known, weights, places)
    rng = np.random.default_rng(11)
    terms, by_points, kinds, rms, took = [], [], [], [], []
    for _ in range(seeds):
        e = bare.deviation_mm + NOISE_MM * rng.standard_normal(len(bare.deviation_mm))
        fit = local_regression(*places, e, x, y)
        with Stopwatch() as watch:
            noise2 = handed_noise(fit, known)
            found = low_orders(bare, x, y, np.where(known, fit.value, np.nan), noise2, weights)
        took.append(watch.wall)
        value = np.array([t.coefficient_um for t in found.terms])
        u = np.array([t.u_um for t in found.terms])
        terms.append((value - [t.coefficient_um for t in truth.terms]) / u)
        both = list(zip(found.kinds, truth.kinds, strict=True))
        kinds.append([(f.amplitude_um - t.amplitude_um) / f.u_um for f, t in both])
        kinds[-1] += [(f.angle_deg - t.angle_deg) / f.u_angle_deg for f, t in both if f.angle_deg is not None]
        rms.append(found.rungs[0].rms_um)
        solution = unscaled @ (there.T @ e)
        s2 = np.sum((e - there @ solution) ** 2) / (len(e) - len(solution))
        last = slice(len(solution) - len(value), None)
        spread = np.sqrt(s2 * np.diag(unscaled))[last] * 1e3
        by_points.append((solution[last] * 1e3 - [t.coefficient_um for t in truth.terms]) / spread)
    z, points = np.array(terms), np.array(by_points)
    dense = random_places(surface, 1_000_000, 99)
    true_um = np.sqrt(np.mean(form_error_mm(*dense) ** 2)) * 1e3
    each = np.mean(np.abs(z) <= 1.96, axis=0)
    return [
        Row(f"{name}: coefficients within", "93-97 %", f"{100 * np.mean(np.abs(z) <= 1.96):.1f} %"),
        Row("  least and most covered single one", "-", f"{100 * each.min():.1f}, {100 * each.max():.1f} %"),
        Row(
            "  rms error, in u; largest bias, in u",
            "1; 0",
            f"{np.sqrt(np.mean(z**2)):.3f}; {np.abs(z.mean(0)).max():.2f}",
        ),
        Row(
            "  amplitudes and angles within",
            "93-97 %",
            f"{100 * np.mean(np.abs(np.array(kinds)) <= 1.96):.1f} %",
        ),
        Row(
            "  RMS of the map, worst seed",
            "<= 1 %",
            f"{100 * np.abs(np.array(rms) / true_um - 1).max():.2f} %",
        ),
        Row("  fitted to the points instead: within", "-", f"{100 * np.mean(np.abs(points) <= 1.96):.1f} %"),
        Row(f"  time, {found.n_nodes} nodes", "-", f"{1e3 * np.median(took):.0f} ms"),
        Row("  words", "-", found.words),
    ]


def largest():
    """Time of the largest map that the settings allow by default."""
    x, y = np.linspace(-50.9, 50.9, 512), np.linspace(-30.9, 30.9, 311)
    bare = aligned(WINDOW, form_error_mm, random_places(WINDOW, 100))
    e = form_error_mm(*np.meshgrid(x, y))
    with Stopwatch() as watch:
        low_orders(bare, x, y, e, np.full(e.shape, 1e-4))
    return [Row(f"time, {e.size} nodes", "-", f"{watch.wall:.2f} s ({watch.cpu:.2f} s of cores)")]


def main() -> None:
    """Print the table."""
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 300
    rows = largest()
    rows += coverage("window, at random", WINDOW, random_places(WINDOW, POINTS), seeds)
    rows += coverage("window, scan lines", WINDOW, scan_places(WINDOW, POINTS), seeds)
    rows += coverage("bowl, at random", BOWL, random_places(BOWL, POINTS), seeds)
    show(f"Low orders, {seeds} seeds", rows)


if __name__ == "__main__":
    main()
