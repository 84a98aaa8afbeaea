"""Makes everything in this folder but the mirror's own files: `python sample_data/make_sample_data.py`.

A virtual CMM measures the window twice; between the passes a virtual grinder cuts what `compensate` told
it. The truth behind the points goes to `truth.npz`; the README's pictures are drawn at the end.
"""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import numpy as np
from make_chain_picture import draw_chain

from cmm_align import PointKind, PointSet, files
from cmm_align.cli.alignment_run import Ball, make_alignment
from cmm_align.cli.compensate import make_correction
from cmm_align.cli.error_map import make_map
from cmm_align.cli.job import Job
from cmm_align.cli.measured import Sources
from cmm_align.cli.offset import make_nominal
from cmm_align.report.map_picture import draw_map
from cmm_align.virtual.cmm import machine_from_part, scan_lines, tip_centres
from cmm_align.virtual.form_error import form_error
from cmm_align.virtual.grinder import grind
from cmm_align.virtual.window import PRESCRIPTION, TIP_RADIUS_MM, window, window_grid

SPACING_MM = 0.6
MIRROR_RADIUS_MM = 19.05
"""Of the tracker's ball; the Probe column of its export, 38.1, is the diameter."""


def main() -> None:
    """Make the folder's files, in the order in which they would come to be."""
    os.environ.setdefault("SOURCE_DATE_EPOCH", "1767225600")  # 2026-01-01: the same bytes on every run
    os.chdir(Path(__file__).parent)  # provenance holds paths as they are given
    job = Job("offset", overwrite=True)
    surface, error = window(), form_error(window())

    Path("nominal.toml").write_text(PRESCRIPTION, encoding="utf-8")
    grid = PointSet.of(window_grid(SPACING_MM), kind=PointKind.NOMINAL, frame="part")
    files.write_points("nominal.csv", grid, decimals=6, overwrite=True)
    make_nominal(job, Path("nominal.csv"), TIP_RADIUS_MM, job.config.offset)

    x_mm, y_mm = scan_lines(surface.bounds)
    passes = {}
    deviation_at = error.at
    with tempfile.TemporaryDirectory() as scratch:
        for number, name in enumerate(("part", "part2")):
            centres = tip_centres(surface, deviation_at, x_mm, y_mm, TIP_RADIUS_MM, seed=3 + 2 * number)
            files.write_points(
                f"{name}.csv", PointSet.of(centres, kind=PointKind.TIP_CENTRE), decimals=5, overwrite=True
            )
            passes[name] = deviation_at(x_mm, y_mm)
            mapped = map_of(job, Path(f"{name}.csv"), Path("nominal.h5"), Path(scratch))
            if number == 0:
                draw_map(mapped.noun, "window_map.png", title="Window, first pass", source="part.csv")
                correction = make_correction(
                    job, mapped.outputs[0], job.config.compensate, first_pass=True, picture=False
                )
                commanded = files.read(correction.outputs[1])
                deviation_at = grind(surface, error.at, commanded.points_mm)
        mirror = map_of(
            job,
            Path("mirror_m2/points.csv"),
            Path("mirror_m2/nominal.toml"),
            Path(scratch),
            ball=Ball(MIRROR_RADIUS_MM),
            initial="identity",
        )
        draw_map(mirror.noun, "mirror_map.png", title="Telescope mirror M2", source="points.csv")

    np.savez_compressed(
        "truth.npz",
        foot_mm=np.column_stack([x_mm, y_mm, surface.jet(x_mm, y_mm).z]),
        deviation_mm=passes["part"],
        deviation2_mm=passes["part2"],
        machine_from_part=machine_from_part().matrix(),
        tip_radius_mm=TIP_RADIUS_MM,
    )
    draw_chain(Path("chain.png"))


def map_of(job, points, nominal, scratch, *, ball=None, initial=None):
    """Align and map points, with the files in between in a scratch folder."""
    aligned = make_alignment(
        job,
        Sources((str(points),)),
        nominal,
        job.config.align,
        ball or Ball(),
        initial=initial,
        output=scratch / f"{points.stem}.align.h5",
    )
    return make_map(job, aligned.outputs[0], job.config.error_map)


if __name__ == "__main__":
    main()
