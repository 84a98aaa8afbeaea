"""Open registration libraries beside ours: ``python tests/bench/peers.py [FOLDER] [--small] [--readme]``.

    pip install 'cmm-align[bench]'

The same clouds, starts and threads for all; each library in a process of its own (peer_run.py), on data
centred on the target, with exact normals where it takes any, tolerances so tight that they do not stop it
early. A method that goes on after it has settled is not charged for it: its time ends at the first look
whose error is within 1 % of its last. What it does once for a target is told apart, and so is what we do
once for a nominal (`offset`). A pose is judged by deviations on the true surface, at points that no
method saw and that are no vertices. Libraries that are not installed are said to be, and the rest goes on.
"""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
import tempfile
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

import numpy as np
from bench_table import Line, Table, markdown, put_into_readme, short, write_csv
from table import Stopwatch, run_process
from window_cloud import NOISE_MM, PAPER_NODES, Cloud, Judgement, formed, grid_nominal, judged, laid, start

import cmm_align as ca
from cmm_align.config import AlignConfig
from cmm_align.errors import CmmAlignError
from cmm_align.model import Nominal
from cmm_align.pose import Pose

HERE = Path(__file__).resolve().parent
COMMAND = "python tests/bench/peers.py"
FOLDER = "cmm-align-peers"
UM = 1e3
THREADS = os.cpu_count() or 1
PLAIN = AlignConfig(search="never", outliers="keep")
"""No search and no outliers: what the others do."""
SETTLED = 1.01
HOME_MM = 0.01
"""A start has failed where a deviation is wrong by more than this in the end."""
WORDS = {
    "open3d": "Open3D point-to-plane",
    "small_gicp": "small_gicp GICP",
    "small_gicp-plane": "small_gicp PLANE_ICP",
    "trimesh": "trimesh, closest points on triangles",
    "simpleicp": "simpleICP",
}
MODULES = {"small_gicp-plane": ("small_gicp",), "trimesh": ("trimesh", "rtree")}
DISTRIBUTIONS = ("open3d-cpu", "small-gicp", "trimesh", "simpleicp")
BARS = {"open3d": (30.0, 100.0), "small_gicp": (20.0, 1.0)}
"""Times as slow, times as large an error, that the other is to be at least."""


class Sizes(NamedTuple):
    """How much is measured."""

    points: int = 1_200_000
    nodes: tuple[int, int] = PAPER_NODES
    few: int = 5000
    few_nodes: tuple[int, int] = (253, 155)
    starts: int = 100
    repeats: int = 3
    large: tuple[str, ...] = ("open3d", "small_gicp", "small_gicp-plane")
    """The others would take hours for it."""


SMALL = Sizes(points=20_000, nodes=(128, 78), few=1500, few_nodes=(64, 39), starts=3, repeats=1)


class Outcome(NamedTuple):
    """What a method did with one case; one entry a start."""

    set_up_s: float
    seconds: np.ndarray
    looks: np.ndarray
    rms_mm: np.ndarray
    worst_mm: np.ndarray
    peak_mb: float


class Problem(NamedTuple):
    """Points, what they are judged by, their nominal, and where they lie."""

    part: Cloud
    unseen: Cloud
    nominal: Nominal
    starts: list[Pose]


def available(name: str) -> str:
    """Return what is missing; empty if the library can be imported."""
    modules = MODULES.get(name, (name,))
    for module in modules:
        if importlib.util.find_spec(module) is None:
            return f"not installed: {module}" if len(modules) > 1 else "not installed"
    code = f"import {', '.join(modules)}"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    return "" if done.returncode == 0 else "cannot be imported"


def theirs(name: str, problem: Problem, scratch: Path) -> Outcome | str:
    """Run a library on a problem, in a process of its own; a text if it cannot."""
    missing = available(name)
    if missing:
        return missing
    net = problem.nominal.equidistant
    centre = net.points_mm.mean(axis=0)
    starts = []
    for pose in problem.starts:  # the source stays in the part's frame: laying it off is the start's motion
        matrix = pose.matrix()
        matrix[:3, 3] += matrix[:3, :3] @ centre - centre
        starts.append(matrix)
    np.savez(
        scratch / "case.npz",
        source=problem.part.centres_mm - centre,
        target=net.points_mm - centre,
        normals=net.normals,
        source_normals=problem.part.normals,
        triangles=net.triangles,
        starts=np.array(starts),
        n_threads=THREADS,
    )
    environment = {**os.environ, "OMP_NUM_THREADS": str(THREADS)}
    done = subprocess.run(
        [
            sys.executable,
            str(HERE / "peer_run.py"),
            name,
            str(scratch / "case.npz"),
            str(scratch / "result.npz"),
        ],
        capture_output=True,
        text=True,
        check=False,
        env=environment,
    )
    if done.returncode:
        print(done.stderr, file=sys.stderr)
        return "stopped with an error"
    told = np.load(scratch / "result.npz")
    seconds, looks, rms, worst = [], [], [], []
    for spent, motions in zip(told["times_s"], told["motions"], strict=True):
        errors = [error_of(motion, centre, problem.unseen) for motion in motions]
        at = int(np.argmax([e.rms_mm <= SETTLED * errors[-1].rms_mm for e in errors]))
        seconds.append(spent[at])
        looks.append(at + 1)
        rms.append(errors[at].rms_mm)
        worst.append(errors[at].worst_mm)
    return Outcome(
        float(told["set_up_s"]),
        np.array(seconds),
        np.array(looks),
        np.array(rms),
        np.array(worst),
        float(told["peak_mb"]),
    )


def error_of(motion, centre, unseen: Cloud) -> Judgement:
    """Judge a motion, shape (4, 4), about the centre of the target; one that is no number lies far off."""
    turn = motion[:3, :3]
    there = FAR
    if np.isfinite(motion).all():
        there = Pose(turn, motion[:3, 3] + centre - turn @ centre, "part", "machine")
    return judged(there, Pose.identity("machine", "part"), unseen)


FAR = Pose(np.eye(3), np.array([1e6, 0.0, 0.0]), "part", "machine")
"""Where a method ends that gave up."""


def ours(problem: Problem, set_up_s: float, repeats: int) -> Outcome:
    """Run our fit; the time is that of the solver, from looking for the way to the last step."""
    seconds, looks, rms, worst = [], [], [], []
    for pose in problem.starts:
        measured, spent = laid(problem.part, pose), []
        for _ in range(repeats):
            marks: dict[str, float] = {}
            with Stopwatch() as watch:
                try:
                    found = ca.align(
                        measured,
                        problem.nominal,
                        PLAIN,
                        progress=lambda what, _share, m=marks, w=watch: m.setdefault(what, w.so_far()),
                    )
                except CmmAlignError as error:
                    print(f"ours: {error}", file=sys.stderr)
                    found = None
            spent.append(marks.get("looking for mistakes", watch.wall) - marks.get("finding the way", 0.0))
        error = judged(FAR if found is None else found.part_from_machine, pose, problem.unseen)
        seconds.append(min(spent))
        looks.append(0 if found is None else found.report.iterations)
        rms.append(error.rms_mm)
        worst.append(error.worst_mm)
    return Outcome(set_up_s, np.array(seconds), np.array(looks), np.array(rms), np.array(worst), 0.0)


def process_peak_mb(problem: Problem, scratch: Path) -> float:
    """Return the peak memory of our whole process, `align` on the stored nominal, MB."""
    nominal, part = scratch / "nominal.h5", scratch / "part.npy"
    ca.write(problem.nominal, nominal)
    np.save(part, laid(problem.part, problem.starts[0]).points_mm)
    cost = run_process(
        "align", str(part), str(nominal), "-o", str(scratch / "part.align.h5"), "-q", repeats=1
    )
    return cost.peak_mb


def times(value: float) -> str:
    """Write a ratio."""
    return f"{value:.2g} ×" if value < 10 else f"{value:.0f} ×" if value < 1e4 else f"{value:.0e} ×"


def against(name: str, other: Outcome | str, us: Outcome, n: str) -> list[Line]:
    """Return the ratios of one library on the large case."""
    slower, less_exact = BARS.get(name, (None, None))
    head = f"{WORDS[name]}, {n} points"
    bars = (f"≥ {slower:.0f} ×" if slower else "", f"≥ {less_exact:.0f} ×" if less_exact else "")
    if isinstance(other, str):
        return [
            Line(f"{head}: solver", bars[0], other),
            Line(f"{head}: error of deviations", bars[1], other),
            Line(f"{head}: set-up, peak memory", "", other),
        ]
    speed, error = other.seconds[0] / us.seconds[0], other.rms_mm[0] / us.rms_mm[0]
    memory = f"{times(other.peak_mb / us.peak_mb)} ({other.peak_mb:.0f} MB)"
    return [
        Line(
            f"{head}: solver",
            bars[0],
            f"{times(speed)}, settled at look {other.looks[0]}",
            None if slower is None else bool(speed >= slower),
        ),
        Line(
            f"{head}: error of deviations",
            bars[1],
            f"{times(error)} ({UM * other.rms_mm[0]:.1e} µm RMS)",
            None if less_exact is None else bool(error >= less_exact),
        ),
        Line(
            f"{head}: set-up, peak memory",
            "",
            f"{times(other.set_up_s / us.set_up_s)}, {memory}",
        ),
    ]


def failures(outcome: Outcome) -> int:
    """Count the starts that did not come home."""
    return int(np.count_nonzero(~(outcome.worst_mm <= HOME_MM)))


def measure(folder: Path, *, small: bool) -> Table:
    """Run all libraries; return the ratios."""
    sizes = SMALL if small else Sizes()
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as name:
        scratch = Path(name)
        lines, rows = large_case(sizes, scratch)
        more, others = small_case(sizes, scratch)
    write_csv(
        folder / "peers.csv",
        (
            "case",
            "method",
            "points",
            "starts",
            "set_up_s",
            "solver_s_median",
            "looks_median",
            "error_rms_um_median",
            "failures",
            "peak_mb",
        ),
        rows + others,
    )
    installed = [f"{d} {version(d)}" for d in DISTRIBUTIONS if has(d)]
    found = ", ".join(installed) or "nothing installed"
    table = Table(
        "peers",
        ("library and work, in times of ours", "bar", "measured"),
        tuple(lines + more),
        COMMAND + (" --small" if small else ""),
        (
            f"Start 1 mm, 1° unless said; {THREADS} threads for all; {found}.",
            "Solver only: trees and covariances (theirs) and `offset` (ours) are set-up. PLANE_ICP of "
            "small_gicp does not minimise distances to planes (its residual is a product by components): the "
            "bars are for its GICP.",
        ),
    )
    (folder / "peers.md").write_text(
        f"# Other libraries\n\n{__doc__}\n\n{markdown(table)}\n", encoding="utf-8"
    )
    return table


def has(distribution: str) -> bool:
    """Return whether a distribution is installed."""
    try:
        return bool(version(distribution))
    except ImportError:
        return False


def large_case(sizes: Sizes, scratch: Path) -> tuple[list[Line], list[tuple[object, ...]]]:
    """The part of the paper from 1 mm and 1 degree, with form error; without and with noise."""
    with Stopwatch() as watch:
        nominal = grid_nominal(sizes.nodes)
    n = short(sizes.points)
    lines, rows = [], []
    clean = Problem(*formed(sizes.points, 61), nominal, [start(1.0, 1.0)])
    noisy = Problem(*formed(sizes.points, 61, noise_mm=NOISE_MM), nominal, [start(1.0, 1.0)])
    us = ours(clean, watch.wall, sizes.repeats)._replace(peak_mb=process_peak_mb(clean, scratch))
    us_noisy = ours(noisy, watch.wall, 1)
    lines.append(
        Line(
            f"ours, {n} points: iterations, error of deviations",
            "",
            f"{us.looks[0]}, {UM * us.rms_mm[0]:.1e} µm RMS",
        )
    )
    rows.append(row("large", "ours", sizes.points, us))
    rows.append(row("large, noise", "ours", sizes.points, us_noisy))
    for name in sizes.large:
        print(f"  {name} ...", file=sys.stderr, flush=True)
        other = theirs(name, clean, scratch)
        lines += against(name, other, us, n)
        if not isinstance(other, str):
            rows.append(row("large", name, sizes.points, other))
    other = theirs("open3d", noisy, scratch)
    told = other
    if not isinstance(other, str):
        rows.append(row("large, noise", "open3d", sizes.points, other))
        told = f"{times(other.rms_mm[0] / us_noisy.rms_mm[0])} ({UM * us_noisy.rms_mm[0]:.1e} µm RMS ours)"
    lines.append(Line(f"{WORDS['open3d']}, {n} points, 0.3 µm noise: error of deviations", "", str(told)))
    return lines, rows


def row(case: str, name: str, points: int, o: Outcome) -> tuple[object, ...]:
    """Return a line of the CSV table."""
    return (
        case,
        name,
        points,
        len(o.seconds),
        o.set_up_s,
        float(np.median(o.seconds)),
        float(np.median(o.looks)),
        float(UM * np.median(o.rms_mm)),
        failures(o),
        o.peak_mb,
    )


SLOW = {"trimesh": 2, "simpleicp": 10, "small_gicp-plane": 20}
"""Most starts for methods that need minutes for one."""


def small_case(sizes: Sizes, scratch: Path) -> tuple[list[Line], list[tuple[object, ...]]]:
    """A small part from many starts, to 20 mm and 20 degrees in any direction."""
    with Stopwatch() as watch:
        nominal = grid_nominal(sizes.few_nodes)
    rng = np.random.default_rng(71)
    reach = 20.0 * rng.uniform(0.0, 1.0, sizes.starts)
    starts = [start(r, r, seed) for seed, r in enumerate(reach)]
    problem = Problem(*formed(sizes.few, 72), nominal, starts)
    us = ours(problem, watch.wall, 1)
    n = f"{sizes.few} points"
    lines = [
        Line(
            f"ours, {n}, starts to 20 mm and 20°: failures",
            "0",
            f"{failures(us)} of {len(starts)}",
            failures(us) == 0,
        )
    ]
    rows = [row("small", "ours", sizes.few, us)]
    for name, words in WORDS.items():
        count = min(SLOW.get(name, sizes.starts), sizes.starts)
        print(f"  {name}, {count} starts ...", file=sys.stderr)
        other = theirs(name, problem._replace(starts=starts[:count]), scratch)
        told = other
        if not isinstance(other, str):
            rows.append(row("small", name, sizes.few, other))
            good = other.worst_mm <= HOME_MM
            error = UM * float(np.median(other.rms_mm))
            longer = times(float(np.median(other.seconds) / np.median(us.seconds)))
            told = f"{failures(other)} of {count}; {longer} as long, {error:.1e} µm RMS" + (
                "" if good.any() else " (none came home)"
            )
        lines.append(Line(f"{words}, {n}: failures, time, error", "", str(told)))
    return lines, rows


def main() -> None:
    """Measure and write."""
    names = [a for a in sys.argv[1:] if not a.startswith("--")]
    folder = Path(names[0] if names else FOLDER)
    table = measure(folder, small="--small" in sys.argv)
    print(markdown(table))
    if "--readme" in sys.argv:
        put_into_readme([table])


if __name__ == "__main__":
    main()
