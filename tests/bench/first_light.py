"""The chain's numbers beside their bars: ``python tests/bench/first_light.py [--large]``.

The data are the virtual window's; the real mirror is that of sample_data. ``--large`` adds 1e7 points.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np
from scipy.interpolate import griddata
from table import Row, Stopwatch, run_process, show

import cmm_align as ca
from cmm_align.model import Nominal, PointKind, PointSet
from cmm_align.surfaces.geometry import unit_normal
from cmm_align.virtual.cmm import machine_from_part
from cmm_align.virtual.form_error import form_error
from cmm_align.virtual.window import TIP_RADIUS_MM, window

SAMPLES = Path(__file__).resolve().parents[2] / "sample_data"
POSE = machine_from_part()
SURFACE = window()
NOISE_MM = 3e-4


def measured(x, y, deviation) -> PointSet:
    """Tip centres in the machine's frame over known places with known deviations."""
    jet = SURFACE.jet(x, y)
    height = TIP_RADIUS_MM + np.broadcast_to(deviation, x.shape)
    points = np.stack([x, y, jet.z], axis=1) + height[:, None] * unit_normal(jet, 1)
    return PointSet.of(POSE.apply(points), kind=PointKind.TIP_CENTRE)


def scan(n: int):
    """Places on scan lines over the window, about n of them."""
    nx = round(np.sqrt(n * 102 / 62))
    ny = round(n / nx)
    return np.tile(np.linspace(-50.9, 50.9, nx), ny), np.repeat(np.linspace(-30.9, 30.9, ny), nx)


def noise_free(nominal: Nominal, x, y) -> list[Row]:
    """Points without noise come home; their contact points need no second motion."""
    found = ca.align(measured(x[::16], y[::16], 0.0), nominal)
    contacts = PointSet.of(found.contact_part_mm, kind=PointKind.CONTACT, frame="part")
    again = ca.align(contacts, nominal).part_from_machine.matrix() - np.eye(4)
    return [
        Row("noise-free, 16 x under-sampled: iterations", "<= 10", str(found.report.iterations)),
        Row("  PV after alignment", "<= 1e-6 nm", f"{1e6 * np.ptp(found.deviation_mm):.1e} nm"),
        Row("contact points again: rotation", "<= 1e-9 rad", f"{np.abs(again[:3, :3]).max():.1e} rad"),
        Row("  translation", "<= 1e-8 mm", f"{np.abs(again[:3, 3]).max():.1e} mm"),
    ]


def timings(nominal: Nominal, sizes: list[int]) -> list[Row]:
    """Time the stage and, at 1.2e6 points, the whole process."""
    rows = []
    for n in sizes:
        x, y = scan(n)
        noise = np.random.default_rng(1).normal(0.0, NOISE_MM, x.size)
        data = measured(x, y, 0.01 * np.sin(x / 17.0) * np.cos(y / 11.0) + noise)
        spent = []
        for _ in range(3 if n < 5e6 else 1):
            marks: list[float] = []
            with Stopwatch() as watch:
                ca.align(data, nominal, progress=lambda _what, _share, m=marks, w=watch: m.append(w.so_far()))
            spent.append((watch.wall, marks[-1] - marks[0], watch.cpu))
        wall, loop, cpu = min(spent)
        bar = "loop <= 0.6 s" if n == 1_200_000 else "linear"
        rows.append(
            Row(
                f"align stage, {n:.2g} points", bar, f"{wall:.2f} s, loop {loop:.2f} s, processor {cpu:.2f} s"
            )
        )
        if n == 1_200_000:
            with tempfile.TemporaryDirectory() as folder:
                part, form = Path(folder) / "part.npy", Path(folder) / "nominal.h5"
                ca.write(nominal, form)
                np.save(part, data.points_mm)
                cost = run_process("align", str(part), str(form), "-q", "--overwrite")
            rows.append(
                Row("  whole process", "<= 3 s, <= 1 GB", f"{cost.seconds:.2f} s, {cost.peak_mb:.0f} MB")
            )
    return rows


def mirror() -> list[Row]:
    """Replay the real mirror."""
    nominal = ca.offset(ca.read(SAMPLES / "mirror_m2" / "nominal.toml"), 19.05)
    e = 1e3 * ca.align(ca.read(SAMPLES / "mirror_m2" / "points.csv"), nominal).deviation_mm
    return [
        Row("real mirror: RMS", "39.67976 +- 0.0001 um", f"{np.sqrt(np.mean(e**2)):.5f} um"),
        Row("  PV", "249.860 +- 0.01 um", f"{np.ptp(e):.4f} um"),
    ]


def map_against_truth(nominal: Nominal) -> list[Row]:
    """Map 20 000 noisy points and compare with the same points without noise."""
    x, y = scan(20_000)
    truth = form_error(SURFACE).at(x, y)
    noise = np.random.default_rng(2).normal(0.0, NOISE_MM, x.size)
    chart = ca.error_map(ca.align(measured(x, y, truth + noise), nominal))
    gx, gy = np.meshgrid(chart.x_mm, chart.y_mm)
    known = np.isfinite(chart.deviation_mm)
    there = griddata(np.stack([x, y], axis=1), truth, (gx[known], gy[known]), method="cubic")
    both = np.isfinite(there)
    together = np.corrcoef(there[both], chart.deviation_mm[known][both])[0, 1]
    pv = chart.statistics.pv_mm / np.ptp(truth) - 1.0
    rms = chart.statistics.rms_mm / np.sqrt(np.mean(truth**2)) - 1.0
    return [
        Row("map against truth: PV, RMS", "within 3 %", f"{100 * pv:+.2f} %, {100 * rms:+.2f} %"),
        Row("  correlation", ">= 0.999", f"{together:.5f}"),
    ]


def main() -> None:
    """Print the table."""
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(-51, 51, 1021), np.linspace(-31, 31, 1241)))
    points = np.stack([x, y, SURFACE.jet(x, y).z], axis=1)
    with Stopwatch() as watch:
        nominal = ca.offset(PointSet.of(points, kind=PointKind.NOMINAL, frame="part"), TIP_RADIUS_MM)
    rows = [Row("offset stage, 1021 x 1241 nodes", "-", f"{watch.wall:.2f} s")]
    rows += noise_free(nominal, x, y)
    rows += timings(nominal, [100_000, 1_200_000, *([10_000_000] if "--large" in sys.argv else [])])
    rows += mirror()
    rows += map_against_truth(nominal)
    show("First light", rows)


if __name__ == "__main__":
    main()
