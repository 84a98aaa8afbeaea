"""Figures 7 to 10 of the paper: grind, measure, correct, again; contact points; the radius subtracted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from bench_table import Line, met, write_csv
from paper_pictures import draw_contact_points
from window_cloud import SURFACE, grid_nominal, start

import cmm_align as ca
from cmm_align.config import AlignConfig
from cmm_align.model import PointKind, PointSet
from cmm_align.report.series_picture import draw_series
from cmm_align.stages.reference_methods import reference_pose
from cmm_align.virtual.cmm import scan_lines, tip_centres
from cmm_align.virtual.form_error import form_error
from cmm_align.virtual.grinder import grind
from cmm_align.virtual.window import TIP_RADIUS_MM

UM = 1e3
GROUND_PV_MM = 0.0273
"""What the paper found after the first pass."""


def loop(folder: Path, nodes: tuple[int, int], lines: int, per_line: int) -> list[Line]:
    """Two passes over the virtual window, and the checks on its second measurement."""
    nominal = grid_nominal(nodes)
    truth = form_error(SURFACE, pv_mm=GROUND_PV_MM)
    x, y = scan_lines(SURFACE.bounds, lines=lines, per_line=per_line)

    def measure(deviation_at, seed: int) -> PointSet:
        points = tip_centres(SURFACE, deviation_at, x, y, TIP_RADIUS_MM, seed=seed)
        return PointSet.of(points, kind=PointKind.TIP_CENTRE)

    first = ca.align(measure(truth.at, 3), nominal)
    before = ca.error_map(first)
    correction = ca.compensate(before)
    commanded = commanded_points(correction)
    ground = grind(SURFACE, truth.at, commanded)
    measured = measure(ground, 5)
    second = ca.align(measured, nominal)
    after = ca.error_map(second)
    draw_series(
        [("first pass", before), ("compensated pass", after)],
        folder / "fig9_passes.png",
        "One compensated pass of the virtual grinder",
    )
    a, b = before.statistics, after.statistics
    write_csv(
        folder / "fig7_9_loop.csv",
        (
            "pass",
            "points",
            "map_pv_um",
            "map_rms_um",
            "iterations",
            "objective_start_mm2",
            "objective_end_mm2",
        ),
        [
            (
                k,
                len(x),
                UM * s.pv_mm,
                UM * s.rms_mm,
                f.report.iterations,
                f.report.cost_history_mm2[0],
                f.report.cost_history_mm2[-1],
            )
            for k, (s, f) in enumerate(((a, first), (b, second)), 1)
        ],
    )
    return [
        Line(
            "Fig. 8: objective (mean square) at the start, at the end",
            "paper: 3.2383, 0.0566",
            f"{first.report.cost_history_mm2[0]:.3g}, {first.report.cost_history_mm2[-1]:.1e} mm²",
        ),
        Line(
            "Fig. 9: PV of the map before, after one compensated pass",
            "paper: 27.3, 6.9 µm",
            f"{UM * a.pv_mm:.1f}, {UM * b.pv_mm:.1f} µm",
            met(UM * b.pv_mm, 6.9),
        ),
        Line("Fig. 9: RMS after it", "paper: 1.0 µm", f"{UM * b.rms_mm:.2f} µm", met(UM * b.rms_mm, 1.0)),
        *contact_points(folder, nominal, measured, second, ground(x, y), x, y),
    ]


def commanded_points(correction):
    """Return the points of the commanded surface, shape (n, 3), mm."""
    gx, gy = np.meshgrid(correction.x_mm, correction.y_mm)
    points = np.stack([gx.ravel(), gy.ravel(), correction.commanded_z_mm.ravel()], axis=1)
    return points[np.isfinite(points).all(axis=1)]


def contact_points(folder: Path, nominal, measured, found, truth, x, y) -> list[Line]:
    """Figure 10: contact points come to the same place; the radius subtracted from the distance does harm."""
    plain = AlignConfig(search="never", outliers="keep")
    kept = found.used
    contacts = PointSet.of(found.contact_part_mm[kept], kind=PointKind.CONTACT, frame="part")
    off = start(1.0, 1.0)
    moved = PointSet.of(off.apply(contacts.points_mm), kind=PointKind.CONTACT)
    again = ca.align(moved, nominal, plain)
    left = np.abs((again.part_from_machine @ off).matrix() - np.eye(4))
    turn, shift = float(left[:3, :3].max()), float(left[:3, 3].max())
    bad = reference_pose("xiong", measured, nominal)
    xiong = ca.align(
        measured, nominal, AlignConfig(search="never", max_iterations=0), start=bad.part_from_machine
    ).deviation_mm
    shown = [again.deviation_mm, xiong[kept] - found.deviation_mm[kept]]
    own = bad.own_rms_mm
    harm = float(np.ptp(shown[1]))
    ours = float(np.sqrt(np.mean((found.deviation_mm[kept] - truth[kept]) ** 2)))
    theirs = float(np.sqrt(np.mean((xiong[kept] - truth[kept]) ** 2)))
    draw_contact_points(folder / "fig10_contact_points.png", x[kept], y[kept], *shown)
    write_csv(
        folder / "fig10_contact_points.csv",
        (
            "second_rotation_rad",
            "second_translation_mm",
            "difference_pv_um",
            "error_rms_ours_um",
            "error_rms_subtracted_um",
            "own_rms_subtracted_um",
        ),
        [(turn, shift, UM * harm, UM * ours, UM * theirs, UM * own)],
    )
    return [
        Line(
            "Fig. 10a: contact points laid off by 1 mm and 1°: motion left after their alignment",
            "paper: near identity; ≤ 1e-9 rad, 1e-8 mm",
            f"{turn:.0e} rad, {shift:.0e} mm",
            turn <= 1e-9 and shift <= 1e-8,
        ),
        Line(
            "Fig. 10b: radius subtracted after a vertical look-up, deviations moved by, PV",
            "paper: not feasible",
            f"{UM * harm:.3g} µm; its own residual {UM * own:.3g} µm RMS",
        ),
    ]
