"""What a map of 1.2e6 points costs: ``python tests/bench/map_speed.py [big.align.h5]``.

The whole process (map, statistics, picture) beside its bars, the processor time that it took (for a machine
that others use too), and where its time goes. The alignment is made of the virtual window, unless one is
given.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from first_light import NOISE_MM, SURFACE, TIP_RADIUS_MM, form_error, measured, scan
from table import Row, run_process, show

import cmm_align as ca
from cmm_align.model import PointKind, PointSet

POINTS = 1_200_000

SHARES = """
import functools, importlib, runpy, sys, time

spent = {}

def timed(name, module, attribute):
    owner = importlib.import_module(module)
    work = getattr(owner, attribute)
    @functools.wraps(work)
    def watched(*args, **kwargs):
        begin = time.perf_counter()
        try:
            return work(*args, **kwargs)
        finally:
            spent[name] = spent.get(name, 0.0) + time.perf_counter() - begin
    setattr(owner, attribute, watched)

begin = time.perf_counter()
import cmm_align.cli.error_map, cmm_align.io, cmm_align.stages.error_map, cmm_align.report.map_picture
import cmm_align.files
spent["imports"] = time.perf_counter() - begin
timed("read", "cmm_align.io", "read_alignment")
timed("map", "cmm_align.stages.error_map", "error_map")
timed("write", "cmm_align.io", "write")
timed("checksum", "cmm_align.provenance", "sha256_of_file")
timed("draw", "cmm_align.report.map_picture", "draw_map")
try:
    runpy.run_module("cmm_align", run_name="__main__")
except SystemExit:
    pass
print("shares", *(f"{name}={seconds:.3f}" for name, seconds in spent.items()))
"""
"""A run with its parts timed; parts that run at the same time add up to more than the whole."""


def make(path: Path) -> None:
    """Write an alignment of 1.2e6 points over the window, with its form error and noise."""
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(-51, 51, 1021), np.linspace(-31, 31, 1241)))
    points = np.stack([x, y, SURFACE.jet(x, y).z], axis=1)
    nominal = ca.offset(PointSet.of(points, kind=PointKind.NOMINAL, frame="part"), TIP_RADIUS_MM)
    x, y = scan(POINTS)
    noise = np.random.default_rng(1).normal(0.0, NOISE_MM, x.size)
    ca.write(ca.align(measured(x, y, form_error(SURFACE).at(x, y) + noise), nominal), path)


def shares(arguments: list[str]) -> list[Row]:
    """Return the time of each part of one run."""
    done = subprocess.run(
        [sys.executable, "-c", SHARES, *arguments], check=True, capture_output=True, text=True
    )
    parts = (word.split("=") for word in done.stdout.strip().splitlines()[-1].split()[1:])
    return [Row(f"  {name}", "", f"{float(seconds):.2f} s") for name, seconds in parts]


def main() -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as folder:
        os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # as installed: bytecode is there
        os.environ["PYTHONPYCACHEPREFIX"] = str(Path(folder) / "bytecode")
        aligned = Path(folder) / "big.align.h5"
        if len(sys.argv) > 1:
            aligned = Path(sys.argv[1])
        else:
            make(aligned)
        arguments = ["error-map", str(aligned), "-q", "--overwrite", "-o", str(Path(folder) / "big.map.h5")]
        cost = run_process(*arguments, repeats=5)
        rows = [
            Row(
                "1.2e6 points to map, numbers, PNG",
                "<= 4 s",
                f"{cost.seconds:.2f} s, processor {cost.processor_s:.2f} s",
            ),
            Row("  peak memory", "<= 800 MB", f"{cost.peak_mb:.0f} MB"),
            *shares(arguments),
        ]
    show("Map of a large alignment", rows)


if __name__ == "__main__":
    main()
