"""What the gate lets through and what it refuses, and its time: ``python tests/bench/gate.py [SEEDS]``.

SEEDS random parts (100), slopes over 30 degrees, form error of some um, noise of 0.3 um. Each correction is
written by every post, read back and judged; then with each mistake that a writer can make. ``python
tests/bench/gate.py time`` measures 1021 x 1241 nodes: compensation, gate and three exports; needs Linux for
the memory.
"""

from __future__ import annotations

import resource
import sys
import tempfile
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from truth_gate import MISTAKES, WORDS, Example, example, read_of
from truth_maps import Quadric, aligned, form_error_mm, random_places

from cmm_align.cli import exporting, gating
from cmm_align.config import CompensateConfig, ExportConfig
from cmm_align.model import DeviationMap
from cmm_align.posts.template import template_of
from cmm_align.stages.compensate import compensate
from cmm_align.stages.error_map import error_map
from cmm_align.stages.gate import Gate
from cmm_align.stages.wheel_check import wheel_of

KINDS = ("xyz", "xyzijk", "zemax", "heidenhain", "gcode-raster", "gcode-spiral", "template", "dwell")
POST = {"schema": "cmm-align/post/1", "line": "N{n} X{cx} Y{cy} Z{cz}"}
WHEEL_MM = 6.0


def main(seeds: int) -> None:
    """Count what passes and what is refused."""
    passed: Counter[str] = Counter()
    refused: Counter[str] = Counter()
    named: Counter[str] = Counter()
    worst: dict[str, float] = {}
    for seed in range(seeds):
        case = example(seed, turned=seed % 3 == 1, side=-1 if seed % 3 == 2 else 1, ellipse=seed % 2 == 1)
        gate = Gate(case.map, case.correction)
        with tempfile.TemporaryDirectory() as folder:
            for kind, found in of_files(case, gate, Path(folder)):
                passed[kind] += found.passed
                off = next(c.value for c in found.checks if c.name == "rounding")
                worst[kind] = max(worst.get(kind, 0.0), off or 0.0)
                if not found.passed:
                    print(seed, kind, [(c.name, c.words) for c in found.checks if not c.passed])
        for name, change in MISTAKES.items():
            found = gate.judge(read_of(case, change))
            refused[name] += not found.passed
            named[name] += WORDS[name] in found.looks_like
    for kind in KINDS:
        print(f"{kind:20s} {passed[kind]:4d} of {seeds} pass, at most {worst.get(kind, 0.0):.2f} nm off")
    for name in MISTAKES:
        print(f"{name:20s} {refused[name]:4d} of {seeds} refused, {named[name]} named rightly")


def of_files(case: Example, gate: Gate, folder: Path):
    """Give what the gate finds in the file of each kind."""
    config = CompensateConfig(wheel_radius_mm=WHEEL_MM)
    for kind in KINDS:
        post = template_of(POST, "post") if kind == "template" else None
        plan = exporting.Plan((kind,), (folder / kind,), ExportConfig(footprint_radius_mm=4.0), post)
        ((path, one),) = exporting.prepared(plan, case.correction, config, "P")
        one.write(path)
        read = gating.read_back(path, path, kind, plan, case.correction, wheel_of(config))
        yield kind, gate.judge(read)


def timed() -> None:
    """Tell time and memory of a large grid."""
    deviation_map = large_map()
    config = CompensateConfig(wheel_radius_mm=50.0, max_slope_mrad=50.0)
    print(f"{deviation_map.deviation_mm.shape} nodes, {peak_mb():.0f} MB before")
    clock = time.process_time  # of this process: the machine may be shared
    start = clock()
    correction = compensate(deviation_map, config)
    print(f"compensate {clock() - start:6.2f} s, {peak_mb():.0f} MB")
    from contextlib import ExitStack

    with tempfile.TemporaryDirectory() as folder:
        names = ("xyz", "xyzijk", "zemax")
        plan = exporting.Plan(names, tuple(Path(folder) / n for n in names), ExportConfig(), None)
        exports = exporting.prepared(plan, correction, config, "P")
        with ExitStack() as stack:
            report = gating.written(
                stack,
                plan,
                exports,
                deviation_map,
                correction,
                correction,
                wheel_of(config),
                overwrite=False,
                skip=False,
            )
        print(f"all        {clock() - start:6.2f} s, {peak_mb():.0f} MB, passed {len(report.exports)}")


def large_map() -> DeviationMap:
    """Return the map of a bowl on 1021 x 1241 nodes, one measured point to a node."""
    surface = Quadric(62.0, 51.0, c=0.003, d=0.003)
    x, y = np.linspace(-62.0, 62.0, 1241), np.linspace(-51.0, 51.0, 1021)
    xg, yg = np.meshgrid(x, y)
    small = error_map(aligned(surface, form_error_mm, random_places(surface, 3000)))
    points = aligned(surface, form_error_mm, (xg.ravel(), yg.ravel()), noise_mm=0.0003)
    noise = 0.0001 * np.random.default_rng(1).standard_normal(xg.shape)
    return replace(
        small, alignment=points, x_mm=x, y_mm=y, deviation_mm=form_error_mm(xg, yg) + noise, spacing_mm=0.1
    )


def peak_mb() -> float:
    """Peak memory of this process so far, MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


if __name__ == "__main__":
    if sys.argv[1:] == ["time"]:
        timed()
    else:
        main(int(sys.argv[1]) if sys.argv[1:] else 100)
