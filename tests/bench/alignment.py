"""The alignment's numbers beside their bars: ``python tests/bench/alignment.py [MIRROR_FOLDER] [STARTS]``.

Without the folder of the real mirror (nominal.toml and points.csv) its rows are left out; 100 starts unless
said otherwise.
"""

from __future__ import annotations

import hashlib
import subprocess
import sys
from pathlib import Path

import numpy as np
from fit_doctor import nominal as with_side
from minimum_zone import exact
from scipy.spatial.transform import Rotation
from table import Row, Stopwatch, show

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from known_alignments import (
    CAP_DEG,
    HOME,
    SCALES,
    SYMMETRIES,
    aligned_symmetry,
    cap_measured,
    cap_theory,
    far_start,
    measured,
    motion_between,
    named,
    nominal_of,
    tips,
    with_strays,
    without_search,
)

import cmm_align as ca
from cmm_align.config import AlignConfig
from cmm_align.errors import CmmAlignError
from cmm_align.model import PointKind, PointSet
from cmm_align.pose import Pose
from cmm_align.surfaces.geometry import unit_normal
from cmm_align.surfaces.prescription import prescription_from_toml
from cmm_align.virtual.form_error import form_error
from cmm_align.virtual.window import window

SURFACE = window()
NOMINAL = nominal_of(SURFACE)
MIRROR_BALL_MM = 19.05
MIRROR_REACH_MM = 2000.0
LARGE = 100_000
NOISE_MM = 3e-4


def bar(limit: str, *, met: bool) -> str:
    """Say beside a bar whether it was missed."""
    return limit if met else f"{limit}  MISSED"


def scan(n: int):
    """Places on scan lines all over the window, about n of them."""
    nx = round(np.sqrt(n * 102 / 62))
    ny = round(n / nx)
    return np.tile(np.linspace(-50.9, 50.9, nx), ny), np.repeat(np.linspace(-30.9, 30.9, ny), nx)


def real_points(n: int):
    """Tip centres with form error and noise."""
    x, y = scan(n)
    return tips(
        SURFACE, x, y, form_error(SURFACE).at(x, y) + np.random.default_rng(2).normal(0, NOISE_MM, x.size)
    )


def caps() -> list[Row]:
    """A ball of the wrong radius on a spherical cap."""
    rows = []
    for angle in CAP_DEG:
        theory, found = cap_theory(angle), cap_measured(angle)
        off = max(abs(found.shift / theory.shift - 1.0), abs(found.pv / theory.pv - 1.0))
        rows.append(
            Row(
                f"radius error on a cap of {angle:g} deg: tz/dr, PV/dr",
                bar(f"{theory.shift:.3f}, {theory.pv:.3f} +- 1 %", met=off <= 0.01),
                f"{found.shift:.4f}, {found.pv:.4f}",
            )
        )
    return rows


def null_space(n: int = 2000, size_mm: float = 0.005) -> list[Row]:
    """Deviations in the null space of J^T: the pose and every residual are known exactly."""
    x, y = np.random.default_rng(3).uniform(-1.0, 1.0, (2, n)) * [[50.0], [30.0]]
    jet = SURFACE.jet(x, y)
    normal, feet = unit_normal(jet, 1), np.stack([x, y, jet.z], axis=1)
    basis, _ = np.linalg.qr(np.hstack([np.cross(feet, normal), normal]))
    deviation = np.random.default_rng(4).normal(0.0, size_mm, n)
    for _ in range(2):
        deviation = deviation - basis @ (basis.T @ deviation)
    pose = far_start(1, np.array([20.0, 10.0, 20.0]), np.array([20.0, 10.0, 20.0]))
    found = ca.align(measured(tips(SURFACE, x, y, deviation), pose), NOMINAL)
    left = np.abs((found.part_from_machine @ pose).matrix() - np.eye(4))
    shift, turn = left[:3, 3].max(), left[:3, :3].max()
    residual = np.abs(found.deviation_mm - deviation).max()
    limit = "1e-11 mm, 1e-13 rad"
    return [
        Row(
            "null-space data: pose",
            bar(limit, met=shift <= 1e-11 and turn <= 1e-13),
            f"{shift:.1e} mm, {turn:.1e} rad",
        ),
        Row("  residuals", bar("1e-12 mm", met=residual <= 1e-12), f"{residual:.1e} mm"),
    ]


def strays(seeds: int = 10) -> list[Row]:
    """Three tenths of the points wrong by 0.1 to 5 mm."""
    worst, missed, accused, missed_small, small = 0.0, 0, 0, 0, 0
    for seed in range(seeds):
        x, y, clean, spoilt, stray = with_strays(SURFACE, seed=seed)
        points = tips(SURFACE, x, y, clean)
        best = ca.align(measured(points), NOMINAL)
        found = ca.align(measured(tips(SURFACE, x, y, spoilt)), NOMINAL)
        moved = motion_between(found.part_from_machine, best.part_from_machine, points)
        values, axes = np.linalg.eigh(best.covariance)
        worst = max(worst, float(np.max(np.abs(axes.T @ moved) / np.sqrt(values))))
        missed += np.count_nonzero(found.used & stray)
        accused += np.count_nonzero(~found.used & ~stray)
        *_, spoilt, stray = with_strays(SURFACE, seed=seed, low_mm=10 * NOISE_MM, high_mm=0.1)
        found = ca.align(measured(tips(SURFACE, x, y, spoilt)), NOMINAL)
        over = stray & (np.abs(spoilt) > 6 * NOISE_MM)
        small, missed_small = (
            small + np.count_nonzero(over),
            missed_small + np.count_nonzero(found.used & over),
        )
    return [
        Row(
            "30 % strays of 0.1 to 5 mm: pose against clean",
            bar("<= 3 sigma", met=worst <= 3.0),
            f"{worst:.2f} sigma",
        ),
        Row(
            "  strays not listed, others listed",
            bar("0, 0", met=missed + accused == 0),
            f"{missed}, {accused}",
        ),
        Row("  of 3 to 100 um, over 6 sigma: not listed", "-", f"{missed_small} of {small}"),
    ]


def symmetries() -> list[Row]:
    """Free motions of parts whose symmetry is known, in three sizes."""
    right, wrong = 0, []
    for name, (_, words) in SYMMETRIES.items():
        for by in SCALES:
            good = named(aligned_symmetry(name, by).report.unobservable) == tuple(sorted(words))
            right += good
            wrong += [] if good else [f"{name} x {by:g}"]
    total = right + len(wrong)
    return [
        Row(
            f"free motions named: {len(SYMMETRIES)} kinds, x 0.001, 1, 1000",
            bar(f"{total} of {total}", met=not wrong),
            f"{right} of {total} {', '.join(wrong)}".strip(),
        )
    ]


def starts(count: int) -> list[Row]:
    """Iterations and success from far starts, without search."""
    rows = []
    x, y = scan(20_000)
    for kind, points in (
        ("noise-free", tips(SURFACE, x, y)),
        ("27 um form, 0.3 um noise", real_points(20_000)),
    ):
        best = ca.align(measured(points), NOMINAL).part_from_machine
        for reach in (np.array([20.0, 10.0, 20.0]), np.full(3, 40.0)):
            steps, spent, pv = [], [], 0.0
            for seed in range(count):
                pose = far_start(seed, reach, reach)
                try:
                    with Stopwatch() as watch:
                        found = without_search(points, NOMINAL, pose)
                except CmmAlignError as error:
                    print(f"start {seed}: {error}")
                    continue
                spent.append(watch.wall)
                pv = max(pv, 1e6 * float(np.ptp(found.deviation_mm)))
                home = np.abs(found.part_from_machine.apply(pose.apply(points)) - best.apply(points)).max()
                if home < 1e-6:
                    steps.append(found.report.iterations)
            told = "20, 10, 20" if reach[1] < 20 else "40, 40, 40"
            few = len(steps) == count and (reach[1] > 20 or np.mean(steps) <= 7)
            limit = f"{count} of {count}" + ("" if reach[1] > 20 else ", mean <= 7")
            rows.append(
                Row(
                    f"{kind}, {told} mm and deg: iterations",
                    bar(limit, met=bool(few)),
                    f"{len(steps)} of {count}, mean {np.mean(steps):.2f}, most {max(steps)}; "
                    f"{np.mean(spent):.2f} s",
                )
            )
            if kind == "noise-free":
                rows.append(Row("  largest PV left", bar("<= 1e-6 nm", met=pv <= 1e-6), f"{pv:.1e} nm"))
    return rows


def timings(repeats: int = 5) -> list[Row]:
    """The whole stage with 1e5 points; the first time with the minimum zone, with and without a search."""
    points = real_points(LARGE)
    near, turned = (
        far_start(1, 20.0, 20.0),
        Pose(np.diag([-1.0, 1.0, -1.0]), np.full(3, 300.0), "machine", "part"),
    )
    cases = (
        ("align, 1e5 points, without search", 0.6, near, AlignConfig(search="never")),
        ("  search where the start may have led astray", 2.0, near, AlignConfig()),
        ("  laid anywhere, searched", 2.0, turned, AlignConfig(search="always")),
        ("  minimum zone", 5.0, near, AlignConfig(search="never", criterion="minimum-zone")),
    )
    rows = []
    for what, limit, pose, config in cases:
        data, spent = measured(points, pose), []
        for _ in range(repeats):
            with Stopwatch() as watch:
                found = ca.align(data, NOMINAL, config)
            spent.append((watch.wall, watch.cpu))
        proof = found.report.certificate
        told = f", certificate {proof['residual']:.0e}" if proof else ""
        best, worst = min(spent), max(spent)
        told = f"{best[0]:.2f} to {worst[0]:.2f} s, processor {best[1]:.2f} s{told}"
        rows.append(Row(what, bar(f"<= {limit:g} s", met=best[0] <= limit), told))
    return rows


def digest() -> str:
    """One digest of all that an alignment of a part laid anywhere returns."""
    data = PointSet.of(far_start(5, 300.0, 180.0).apply(real_points(30_000)), kind=PointKind.TIP_CENTRE)
    found = ca.align(data, NOMINAL)
    total = hashlib.sha256()
    for array in (found.part_from_machine.matrix(), found.covariance, found.deviation_mm, found.used):
        total.update(np.ascontiguousarray(array).tobytes())
    return total.hexdigest()


def two_processes() -> list[Row]:
    """The same input in three processes."""
    command = [sys.executable, str(Path(__file__).resolve()), "--digest"]
    found = {subprocess.run(command, check=True, capture_output=True, text=True).stdout for _ in range(3)}
    return [
        Row(
            "bits of three processes",
            bar("equal", met=len(found) == 1),
            "equal" if len(found) == 1 else "differ",
        )
    ]


def mirror(folder: Path, poses: int = 5) -> list[Row]:
    """The real mirror: one optimum from everywhere, how well it is known, and the three mistakes."""
    surface = prescription_from_toml((folder / "nominal.toml").read_text(), "mirror")
    points = np.loadtxt(folder / "points.csv", delimiter=",", skiprows=2)
    nominal = nominal_of(surface, MIRROR_BALL_MM)
    home = ca.align(measured(points), nominal)
    e = 1e3 * home.deviation_mm
    laid = [HOME]
    for seed in range(poses):
        shift = np.random.default_rng(seed).uniform(-MIRROR_REACH_MM, MIRROR_REACH_MM, 3)
        laid.append(Pose(Rotation.random(random_state=seed).as_matrix(), shift, "machine", "part"))
    turned, moved, ends = 0.0, 0.0, 0
    for pose in laid[1:]:
        try:
            found = ca.align(measured(points, pose), nominal).part_from_machine
        except CmmAlignError as error:
            print(f"mirror: {error}")
            continue
        apart = motion_between(found @ pose, home.part_from_machine @ HOME, points)
        turned, moved = max(turned, np.linalg.norm(apart[:3])), max(moved, np.linalg.norm(apart[3:]))
        ends += 1
    sigma = home.report.pose_sigma
    rows = [
        Row(
            "real mirror, its own frame: RMS, PV",
            "39.67976, 249.860 um",
            f"{np.sqrt(np.mean(e**2)):.5f}, {np.ptp(e):.4f} um",
        ),
        Row(
            f"  {poses} random poses: the same optimum",
            bar("1 um, 1 urad", met=ends == poses and moved <= 1e-3 and turned <= 1e-6),
            f"{ends} of {poses}, within {1e3 * moved:.1e} um, {1e6 * turned:.1e} urad",
        ),
        Row(
            "  sigma of tx, ty, tz",
            "-",
            ", ".join(f"{sigma[k]:.3g}" for k in ("tx_um", "ty_um", "tz_um")) + " um",
        ),
        Row(
            "  sigma of rx, ry, rz",
            "-",
            ", ".join(f"{sigma[k]:.3g}" for k in ("rx_urad", "ry_urad", "rz_urad")) + " urad",
        ),
    ]
    normals = home.part_from_machine.inverse().rotate(home.normals)
    touched = points - MIRROR_BALL_MM * normals
    return rows + mistakes(surface, points, touched, laid)


def mistakes(surface, points, touched, laid) -> list[Row]:
    """What is said of the three usual mistakes, in the part's own frame and elsewhere."""
    asked = {
        "wrong side": (points, with_side(surface, MIRROR_BALL_MM, -1)),
        "diameter as radius": (points, with_side(surface, 2 * MIRROR_BALL_MM)),
        "contacts for centres": (touched, with_side(surface, MIRROR_BALL_MM)),
    }
    rows = []
    for name, (cloud, nominal) in asked.items():
        for place, poses in (("own frame", laid[:1]), ("random poses", laid[1:])):
            said = [outcome(measured(cloud, pose), nominal) for pose in poses]
            counts = ", ".join(f"{said.count(word)} {word}" for word in dict.fromkeys(said))
            rows.append(
                Row(f"  {name}, {place}", bar("stopped or said", met="unnoticed" not in said), counts)
            )
    return rows


def outcome(data, nominal) -> str:
    """Say whether an alignment was stopped, warned of, said to be beyond what the data tell, or passed."""
    try:
        warnings = ca.align(data, nominal).report.warnings
    except CmmAlignError:
        return "stopped"
    if not warnings:
        return "unnoticed"
    return "said to be untold" if all("cannot tell" in w for w in warnings) else "noticed"


def main() -> None:
    """Print the table."""
    if "--digest" in sys.argv:
        print(digest())
        return
    folders = [Path(a) for a in sys.argv[1:] if not a.isdigit()]
    count = next((int(a) for a in sys.argv[1:] if a.isdigit()), 100)
    rows = caps() + null_space() + exact(3000, 1) + strays() + symmetries() + starts(count) + timings()
    rows += two_processes()
    for folder in folders:
        rows += mirror(folder)
    show("Alignment", rows)


if __name__ == "__main__":
    main()
