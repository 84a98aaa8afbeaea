"""How fast exports are written and read back: ``python tests/bench/exports.py [NAME...]``.

A grid of 1021 x 1241 nodes, a bowl with a ripple. Needs Linux for the memory. Without names all exports are
measured; the three texts that the bound of 4 s is about are xyz, xyzijk and heidenhain. Seconds are of the
processor. Found on a shared machine with two cores, November 2026 (seconds to write, to read back; largest
error after reading back): xyz 0.4, 0.9, 0.5 nm; xyzijk 0.9, 2.0, 0.5 nm; heidenhain 1.2, 2.8, 0.5 nm;
zemax 0.4, 2.4; gcode-raster 1.1, 5.4, 0.8 nm; gcode-spiral 2.6, 66, 0.8 nm; template 0.8, 1.7, 0.5 nm; dwell
0.9, 0.0; peak 955 MB. For 1.2e6 x 3 numbers ``%`` on tuples takes 1.5 s and np.savetxt 6 s.
"""

from __future__ import annotations

import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from truth_corrections import Bowl, Rippled, correction_to

from cmm_align import posts
from cmm_align.config import ExportConfig
from cmm_align.numerics.wheel import Wheel
from cmm_align.posts.template import template_of
from cmm_align.stages.wheel_check import check_wheel
from cmm_align.surfaces.geometry import unit_normal

WHEEL = Wheel(50.0)
clock = time.process_time  # of this process: the machine may be shared
TEXTS = ("xyz", "xyzijk", "heidenhain")
NM = 1e-6


def peak_mb() -> float:
    """Peak memory of this process so far, MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def main(names: list[str]) -> None:
    """Write, read back, compare with the closed form, and tell the times."""
    nominal = Bowl(150.0, 62.0, 51.0)
    corrected = Rippled(nominal, 0.005, 20.0)
    correction = correction_to(corrected, nominal, step_mm=0.1)
    print(f"{correction.commanded_z_mm.shape} nodes, {peak_mb():.0f} MB before")
    start = clock()
    check_wheel(correction, WHEEL)
    print(f"wheel check  {clock() - start:6.2f} s, {peak_mb():.0f} MB")
    post = template_of({"schema": "cmm-align/post/1", "line": "N{n} X{x} Y{y} Z{z} I{i} J{j} K{k}"}, "post")
    config = ExportConfig(footprint_radius_mm=5.0)
    total = 0.0
    with tempfile.TemporaryDirectory() as folder:
        for name in names or [*posts.SUFFIXES, "template"]:
            path = Path(folder) / f"part{posts.suffix_of(name, post)}"
            start = clock()
            posts.write_export(path, name, posts.ExportJob(correction, config, wheel=WHEEL), post)
            wrote = clock() - start
            total += wrote if name in TEXTS else 0.0
            start = clock()
            if name == "dwell":
                posts.read_dwell(path)
                told = ""
            else:
                found = posts.read_back(path, name, WHEEL, post=post)
                seconds = clock() - start
                x, y, z = found.points_mm.T
                jet = corrected.jet(x, y)
                off = np.abs((z - jet.z) * unit_normal(jet, 1)[:, 2]).max()
                told = f"off by {off / NM:.2f} nm at most, {found.accuracy_mm / NM:.2f} nm stated"
                start = clock() - seconds
            read = clock() - start
            size = path.stat().st_size / 1e6
            print(
                f"{name:13s} {wrote:6.2f} s, back {read:6.2f} s, {size:4.0f} MB, peak {peak_mb():5.0f} MB",
                told,
            )
            path.unlink()
    print(f"three texts   {total:6.2f} s")


if __name__ == "__main__":
    main(sys.argv[1:])
