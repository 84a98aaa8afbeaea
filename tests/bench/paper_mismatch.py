"""Figures 5 and 6 of the paper: starts far off, the objective at each step; iterations; time against N."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from bench_table import Line, met, short, write_csv
from paper_pictures import draw_iterations, draw_mismatch, draw_time
from table import Stopwatch
from window_cloud import NOISE_MM, cloud, formed, judged, laid, places, scanned, start

import cmm_align as ca
from cmm_align.config import AlignConfig
from cmm_align.model import Nominal
from cmm_align.pose import Pose
from cmm_align.stages.reference_methods import reference_pose
from cmm_align.virtual.cmm import machine_from_part

NM, UM = 1e6, 1e3
PLAIN = AlignConfig(search="never", outliers="keep")
"""What the reference methods do: no search for a start, no outliers."""
OFFSETS = (0.1, 1.0, 5.0, 20.0, 40.0)
"""mm and degrees, along and about the space diagonal; the paper's own start comes on top."""
METHODS = ("icp", "point-to-plane", "facet")
PAPER_START = "20, 10, 20"
UNDER_SAMPLING = 16
"""Every so many nodes of the nominal are measured, as in the paper."""


def starts() -> dict[str, Pose]:
    """Where the part lies, by words."""
    return {f"{s:g}": start(s, s) for s in OFFSETS} | {PAPER_START: machine_from_part()}


def mismatch(folder: Path, nominal: Nominal) -> list[Line]:
    """Figures 5 and 6: every start comes home, noise-free."""
    part = cloud(*nominal.equidistant.nominal_points_mm[::UNDER_SAMPLING, :2].T)
    between = cloud(*places(len(part.centres_mm), 21))
    rows, runs, worst = [], {}, 0.0
    for words, pose in starts().items():
        found = ca.align(laid(part, pose), nominal)
        worst = max(worst, pv_nm(found))
        runs[words] = objective(ca.align(laid(part, pose), nominal, PLAIN))
        rows += [(words, k, phase, n, cost) for k, (phase, n, cost) in enumerate(runs[words])]
    write_csv(
        folder / "fig6_objective.csv",
        ("start_mm_and_deg", "step", "phase", "n_points", "mean_square_mm2"),
        rows,
    )
    paper = laid(part, machine_from_part()).points_mm
    draw_mismatch(folder / "fig5_6_mismatch.png", part.centres_mm, paper, runs)
    return [
        Line(
            f"Fig. 5, 6: PV left from {len(runs)} starts to 40 mm and 40°",
            "paper: < 1e-6 nm",
            f"{worst:.1e} nm",
            met(worst, 1e-6),
        ),
        Line(
            "the same for points between the nodes, paper's start",
            "",
            f"{pv_nm(ca.align(laid(between, machine_from_part()), nominal)):.1e} nm",
        ),
    ]


def pv_nm(found) -> float:
    """Return the PV of the deviations, nm."""
    return NM * float(np.ptp(found.deviation_mm[np.isfinite(found.deviation_mm)]))


def objective(found) -> list[tuple[str, int, float]]:
    """Return phase, points and mean square (mm^2) of each look at the fit."""
    return [(s.phase, s.n_used, s.cost_mm2) for s in found.report.steps]


def iterations(folder: Path, nominal: Nominal, points: int) -> list[Line]:
    """Iterations, time and error of the methods of the paper and of ours, from the paper's start."""
    part, unseen = formed(points, 31)
    pose = machine_from_part()
    measured = laid(part, pose)
    rows, curves, counts, errors = [], {}, {}, {}
    for method in (*METHODS, "ours"):
        with Stopwatch() as watch:
            if method == "ours":
                found = ca.align(measured, nominal, PLAIN)
                report = found.report
                n, costs, end = report.iterations, report.cost_history_mm2, found.part_from_machine
            else:
                told = reference_pose(method, measured, nominal)
                n, costs, end = told.iterations, told.cost_history_mm2, told.part_from_machine
        error = judged(end, pose, unseen)
        counts[method], errors[method], curves[method] = n, error.rms_mm, costs
        rows.append((method, len(part.centres_mm), n, watch.wall, UM * error.pv_mm, UM * error.rms_mm))
    write_csv(
        folder / "iterations.csv",
        ("method", "points", "iterations", "seconds", "deviation_error_pv_um", "deviation_error_rms_um"),
        rows,
    )
    draw_iterations(folder / "iterations.png", curves, counts)
    ratio = counts["icp"] / counts["ours"]
    return [
        Line("Iterations of point-to-point ICP, same start", "paper: 152", f"{counts['icp']}"),
        Line("Iterations of point-to-triangle (the paper's method)", "paper: 11", f"{counts['facet']}"),
        Line(
            "Iterations of ours, all phases",
            "≤ 11",
            f"{counts['ours']}, {ratio:.0f} × fewer than ICP",
            met(counts["ours"], 11),
        ),
        Line("Error of deviations at unseen points, RMS: ICP", "", f"{UM * errors['icp']:.2g} µm"),
        Line("the same: point-to-triangle", "", f"{UM * errors['facet']:.2g} µm"),
        Line(
            "the same: ours",
            "paper: 0.12 µm",
            f"{UM * errors['ours']:.1e} µm",
            met(UM * errors["ours"], 0.12),
        ),
    ]


def with_noise(nominal: Nominal, points: int) -> list[Line]:
    """What noise leaves of the registration."""
    part, unseen = formed(points, 41, noise_mm=NOISE_MM)
    pose = machine_from_part()
    error = judged(ca.align(laid(part, pose), nominal).part_from_machine, pose, unseen)
    bar = "paper: 0.8, 0.12 µm"
    told = f"{UM * error.pv_mm:.3f}, {UM * error.rms_mm:.4f} µm"
    return [
        Line(
            "Registration with 0.3 µm noise: error of deviations, PV, RMS",
            bar,
            told,
            error.pv_mm <= 8e-4 and error.rms_mm <= 1.2e-4,
        )
    ]


def time_against_n(folder: Path, nominal: Nominal, sizes: list[int], repeats: int) -> list[Line]:
    """Time of ours and of the paper's method against the number of points."""
    rows, spent = [], {"ours": [], "facet": []}
    pose = machine_from_part()
    for n in sizes:
        part = cloud(*scanned(n, 51))
        measured = laid(part, pose)
        walls = {"ours": [], "facet": []}
        for _ in range(repeats):
            with Stopwatch() as watch:
                ca.align(measured, nominal)
            walls["ours"].append(watch.wall)
        with Stopwatch() as watch:
            reference_pose("facet", measured, nominal)
        walls["facet"].append(watch.wall)
        for name, seconds in walls.items():
            spent[name].append(min(seconds))
        rows.append((n, spent["ours"][-1], spent["facet"][-1]))
    slope = float(np.polyfit(np.log(sizes[-2:]), np.log(spent["ours"][-2:]), 1)[0])
    write_csv(folder / "time.csv", ("points", "ours_s", "point_to_triangle_s"), rows)
    draw_time(folder / "time.png", np.array(sizes), spent)
    per = spent["ours"][-1] * 1.2e6 / sizes[-1]
    return [
        Line(
            f"Time of the align stage, {short(sizes[-1])} points",
            "paper: 8.7 s for 1.2e6, its machine",
            f"{spent['ours'][-1]:.2f} s ({8.7 / per:.1f} × faster per point)",
            met(per, 8.7),
        ),
        Line(
            "Growth of the time with N at the large end, exponent", "≤ 1.1", f"{slope:.2f}", met(slope, 1.1)
        ),
    ]
