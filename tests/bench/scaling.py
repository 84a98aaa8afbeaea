"""How time and memory grow, and where they go: ``python tests/bench/scaling.py [FOLDER]``.

    [--large] [--small] [--readme]

Whole processes, best of three, peak memory of each: 1e4 to 1e6 points (--large: 1e7) on 1e4 to 1.27e6
nominal points (--large: 1e7), from 20, 10, 20 mm and 20, 10, 20 degrees, HDF5 in and out; the chain of four
commands; small jobs; and the limit program (limit_program.py) on the same files. The folder
(cmm-align-scaling unless given) gets CSV tables and two pictures.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np
from bench_table import Line, Table, markdown, met, put_into_readme, short, write_csv
from first_light import measured, scan
from limit_program import layout_of
from scaling_pictures import draw_growth, draw_parts
from table import ProcessCost, run_process
from window_cloud import NOISE_MM, SURFACE, grid_nominal, grid_points

import cmm_align as ca
from cmm_align.virtual.form_error import form_error

HERE = Path(__file__).resolve().parent
COMMAND = "python tests/bench/scaling.py"
FOLDER = "cmm-align-scaling"
PAPER = 1_200_000
PARTS = ("import", "read", "checksum", "locate", "solve", "check", "write", "other")
BIG = 2e6
"""From here on a run is not repeated."""


class Sizes(NamedTuple):
    """How much is measured: points; nodes of the nominal along x and y; the part the bars are for."""

    points: tuple[int, ...] = (10_000, 100_000, 1_000_000)
    nodes: tuple[tuple[int, int], ...] = ((128, 78), (406, 247), (1021, 1241))
    paper: int = PAPER
    paper_nodes: tuple[int, int] = (1021, 1241)
    repeats: int = 3


LARGE = Sizes(points=(10_000, 100_000, 1_000_000, 10_000_000), nodes=(*Sizes().nodes, (4056, 2466)))
SMALL = Sizes(
    points=(2000, 20_000), nodes=((64, 39), (128, 78)), paper=20_000, paper_nodes=(128, 78), repeats=1
)


def write_part(path: Path, n: int) -> Path:
    """Write tip centres in the machine's frame, with form error and noise, in the order of a scan."""
    if not path.exists():
        x, y = scan(n)
        noise = NOISE_MM * np.random.default_rng(1).standard_normal(x.size)
        points = measured(x, y, form_error(SURFACE).at(x, y) + noise).points_mm
        with h5py.File(path, "w") as file:
            data = file.create_dataset("points_mm", data=points)
            data.attrs.update(units="mm", kind="tip_centre", frame="machine")
    return path


def write_nominal(path: Path, nodes: tuple[int, int]) -> Path:
    """Write what `offset` makes of the window on a grid."""
    if not path.exists():
        ca.write(grid_nominal(nodes), path)
    return path


def aligned(part: Path, nominal: Path, output: Path, repeats: int) -> ProcessCost:
    """Run `align` as a whole process."""
    return run_process(
        "align", str(part), str(nominal), "-o", str(output), "-q", "--overwrite", repeats=repeats
    )


def limit(part: Path, nominal: Path, output: Path, repeats: int) -> ProcessCost:
    """Run the limit program on the same files, after `align` made `output`."""
    layout = output.with_suffix(".json")
    layout.write_text(json.dumps(layout_of(output)), encoding="utf-8")
    code = (
        "import subprocess, sys, time, resource\n"
        "begin = time.perf_counter()\n"
        "subprocess.run([sys.executable, *sys.argv[1:]], check=True)\n"
        "wall = time.perf_counter() - begin\n"
        "used = resource.getrusage(resource.RUSAGE_CHILDREN)\n"
        "print(wall, used.ru_maxrss / 1024, used.ru_utime + used.ru_stime)\n"
    )
    program = [
        str(HERE / "limit_program.py"),
        str(part),
        str(nominal),
        str(layout),
        str(output.with_suffix(".lim")),
    ]
    costs = []
    for _ in range(repeats):
        done = subprocess.run(
            [sys.executable, "-c", code, *program], check=True, capture_output=True, text=True
        )
        costs.append(ProcessCost(*map(float, done.stdout.split())))
    output.with_suffix(".lim").unlink()
    return min(costs, key=lambda cost: cost.seconds)


def parts_of(part: Path, nominal: Path, output: Path, repeats: int) -> dict[str, float]:
    """Return where the time of one run goes, s; the quickest of some."""
    command = [
        sys.executable,
        str(HERE / "align_parts.py"),
        "align",
        str(part),
        str(nominal),
        "-o",
        str(output),
    ]
    runs = []
    for _ in range(repeats):
        environment = {**os.environ, "BEGIN": repr(time.time())}
        done = subprocess.run(
            [*command, "-q", "--overwrite"], check=True, capture_output=True, text=True, env=environment
        )
        told = json.loads(done.stdout.strip().splitlines()[-1])
        runs.append({name: told.get(name, 0.0) for name in PARTS})
    return min(runs, key=lambda run: sum(run.values()))


class Cost(NamedTuple):
    """One pair of sizes."""

    points: int
    nodes: int
    seconds: float
    peak_mb: float


def matrix(folder: Path, scratch: Path, sizes: Sizes) -> tuple[list[Cost], dict[int, dict[str, float]]]:
    """Run all pairs of sizes, and take the runs on the paper's nominal apart."""
    costs, parts = [], {}
    for nodes in sizes.nodes:
        nominal = write_nominal(scratch / f"nominal-{nodes[0]}.h5", nodes)
        for n in sizes.points:
            part = write_part(scratch / f"part-{n}.h5", n)
            output = scratch / "scaling.align.h5"
            repeats = 1 if n > BIG or nodes[0] * nodes[1] > BIG else sizes.repeats
            cost = aligned(part, nominal, output, repeats)
            costs.append(Cost(len(scan(n)[0]), nodes[0] * nodes[1], cost.seconds, cost.peak_mb))
            told = f"{cost.seconds:.2f} s, {cost.peak_mb:.0f} MB"
            print(f"  {short(n)} points, {short(nodes[0] * nodes[1])} nodes: {told}", file=sys.stderr)
            if nodes == sizes.paper_nodes:
                parts[n] = parts_of(part, nominal, output, repeats)
    write_csv(folder / "scaling.csv", Cost._fields, [tuple(c) for c in costs])
    write_csv(
        folder / "parts.csv",
        ("points", *(f"{p}_s" for p in PARTS)),
        [(n, *(run[p] for p in PARTS)) for n, run in parts.items()],
    )
    draw_growth(folder / "scaling.png", costs)
    draw_parts(folder / "parts.png", parts, PARTS)
    return costs, parts


def exponent(pairs: list[tuple[float, float]]) -> float:
    """Return the exponent of growth between the two largest sizes."""
    (a, first), (b, second) = sorted(pairs)[-2:]
    return float(np.log(second / first) / np.log(b / a))


def growth(costs: list[Cost], sizes: Sizes) -> list[Line]:
    """Return the exponents, and 1e7 points against 1e6."""
    most_points, paper = max(c.points for c in costs), sizes.paper_nodes[0] * sizes.paper_nodes[1]
    on_paper = [c for c in costs if c.nodes == paper]
    of_most = [c for c in costs if c.points == most_points]
    by_n = [
        exponent([(c.points, v) for c, v in zip(on_paper, values, strict=True)])
        for values in ([c.seconds for c in on_paper], [c.peak_mb for c in on_paper])
    ]
    by_m = [
        exponent([(c.nodes, v) for c, v in zip(of_most, values, strict=True)])
        for values in ([c.seconds for c in of_most], [c.peak_mb for c in of_most])
    ]
    large = {round(np.log10(c.points)): c for c in on_paper}
    told, kept = "not run (--large)", None
    memory, small = "not run (--large)", None
    if 7 in large and 6 in large:
        ratio = large[7].seconds / large[6].seconds
        told, kept = f"{ratio:.1f} ×", met(ratio, 10.0)
        memory, small = f"{large[7].peak_mb / 1000:.2f} GB", met(large[7].peak_mb, 3000.0)
    return [
        Line("10⁷ points: time, in times of that of 10⁶", "≤ 10 ×", told, kept),
        Line("10⁷ points: peak memory", "≤ 3 GB", memory, small),
        Line(
            "growth with the points, time and memory, exponents",
            "≤ 1, ≤ 1",
            f"{by_n[0]:.2f}, {by_n[1]:.2f}",
            max(by_n) <= 1.05,
        ),
        Line(
            "growth with the nodes of the nominal, time and memory",
            "≤ 1, ≤ 1",
            f"{by_m[0]:.2f}, {by_m[1]:.2f}",
            max(by_m) <= 1.05,
        ),
    ]


def paper_part(scratch: Path, sizes: Sizes) -> list[Line]:
    """The part of the bars: its process, and the limit program beside it."""
    nominal = write_nominal(scratch / f"nominal-{sizes.paper_nodes[0]}.h5", sizes.paper_nodes)
    part = write_part(scratch / f"part-{sizes.paper}.h5", sizes.paper)
    output = scratch / "paper.align.h5"
    ours = aligned(part, nominal, output, 2 * sizes.repeats)
    least = limit(part, nominal, output, 2 * sizes.repeats)
    nodes = f"{sizes.paper_nodes[0]} × {sizes.paper_nodes[1]}"
    ratio = ours.seconds / least.seconds
    return [
        Line(
            f"align {short(sizes.paper)} points on {nodes} nodes, whole process",
            "≤ 1.5 s",
            f"{ours.seconds:.2f} s (processor {ours.processor_s:.2f} s)",
            met(ours.seconds, 1.5),
        ),
        Line("the same: peak memory", "≤ 600 MB", f"{ours.peak_mb:.0f} MB", met(ours.peak_mb, 600.0)),
        Line(
            "the same: in times of the limit program",
            "≤ 3 ×",
            f"{ratio:.1f} × ({least.seconds:.2f} s)",
            met(ratio, 3.0),
        ),
    ]


def chain(scratch: Path, sizes: Sizes) -> list[Line]:
    """All four commands on the part of the bars, points of the nominal as .npy."""
    design = scratch / "design.npy"
    np.save(design, grid_points(sizes.paper_nodes))
    part = write_part(scratch / f"part-{sizes.paper}.h5", sizes.paper)
    steps = (
        ("offset", design, "--tip-radius", "1.5", "-o", scratch / "chain.h5"),
        ("align", part, scratch / "chain.h5", "-o", scratch / "chain.align.h5"),
        ("error-map", scratch / "chain.align.h5", "-o", scratch / "chain.map.h5"),
        ("compensate", scratch / "chain.map.h5", "-o", scratch / "chain.comp.h5"),
    )
    spent = [
        run_process(*map(str, step), "-q", "--overwrite", repeats=sizes.repeats).seconds for step in steps
    ]
    told = " + ".join(f"{s:.1f}" for s in spent)
    return [
        Line(
            f"whole chain, {short(sizes.paper)} points, four commands",
            "≤ 12 s",
            f"{sum(spent):.1f} s ({told})",
            met(sum(spent), 12.0),
        )
    ]


def small_jobs(scratch: Path, repeats: int) -> list[Line]:
    """A small part as text, and the help."""
    x, y = scan(5000)
    nominal = write_nominal(scratch / "nominal-small.h5", (205, 125))
    text = scratch / "small.csv"
    noise = NOISE_MM * np.random.default_rng(1).standard_normal(x.size)
    from cmm_align.files import write_points

    write_points(text, measured(x, y, form_error(SURFACE).at(x, y) + noise), overwrite=True)
    part = aligned(text, nominal, scratch / "small.align.h5", 2 * repeats)
    told = run_process("--help", repeats=3 * repeats)
    return [
        Line(
            f"align {len(x)} points, text, whole process",
            "≤ 0.7 s",
            f"{part.seconds:.2f} s",
            met(part.seconds, 0.7),
        ),
        Line("cmm-align --help", "≤ 0.15 s", f"{told.seconds:.2f} s", met(told.seconds, 0.15)),
    ]


def measure(folder: Path, *, small: bool, large: bool = False) -> Table:
    """Run everything; return the numbers beside their bars."""
    sizes = SMALL if small else LARGE if large else Sizes()
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as name:
        scratch = Path(name)
        kept = {k: os.environ.get(k) for k in ("PYTHONDONTWRITEBYTECODE", "PYTHONPYCACHEPREFIX")}
        os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # as installed: bytecode is there
        os.environ["PYTHONPYCACHEPREFIX"] = str(scratch / "bytecode")
        try:
            lines = paper_part(scratch, sizes)
            costs, _ = matrix(folder, scratch, sizes)
            lines += growth(costs, sizes) + small_jobs(scratch, sizes.repeats) + chain(scratch, sizes)
        finally:
            os.environ.update({k: v for k, v in kept.items() if v is not None})
            for k, v in kept.items():
                if v is None:
                    os.environ.pop(k, None)
    table = Table(
        "scaling",
        ("work", "bar", "measured"),
        tuple(lines),
        COMMAND + (" --small" if small else " --large" if large else ""),
        (
            "Whole processes, best of some; start 20, 10, 20 mm and 20, 10, 20°. The limit program imports "
            "NumPy and h5py, reads the same two files, makes one pass over the points and writes the same "
            "output.",
        ),
    )
    (folder / "scaling.md").write_text(
        f"# Time and memory\n\n{markdown(table)}\n\n![growth](scaling.png)\n\n![parts](parts.png)\n",
        encoding="utf-8",
    )
    return table


def main() -> None:
    """Measure and write."""
    names = [a for a in sys.argv[1:] if not a.startswith("--")]
    folder = Path(names[0] if names else FOLDER)
    table = measure(folder, small="--small" in sys.argv, large="--large" in sys.argv)
    print(markdown(table))
    if "--readme" in sys.argv:
        put_into_readme([table])


if __name__ == "__main__":
    main()
