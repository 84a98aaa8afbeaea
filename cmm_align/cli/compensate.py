"""`cmm-align compensate`: the surface to command next."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from cmm_align.cli import options
from cmm_align.cli.job import Job, Outcome, beside
from cmm_align.cli.options import FILE, output_option
from cmm_align.config import CompensateConfig

if TYPE_CHECKING:
    from cmm_align.model import Correction
    from cmm_align.surfaces.protocol import Array

TEXT = """The surface to grind next: what was commanded last, less the deviations of MAP.

Writes the correction as HDF5 and the commanded surface as x, y, z text. From the second pass on give
the correction of the pass before with --previous: the machine needs the sum, not the last piece.
"""


@options.command("compensate", TEXT)
@click.argument("map_file", type=FILE, metavar="MAP")
@click.option("--gain", type=float, metavar="G", help="Share to take off.  [default: 1.0]")
@click.option("--previous", type=FILE, metavar="FILE", help="Correction that this part was ground with.")
@click.option("--text-decimals", type=click.IntRange(5, 12), help="Decimals of the text, mm.  [default: 6]")
@click.option("--no-picture", is_flag=True, help="Write no picture.")
@output_option("<measured>.comp.h5")
def command(
    job: Job,
    *,
    map_file: Path,
    gain: float | None,
    previous: Path | None,
    text_decimals: int | None,
    no_picture: bool,
    output: Path | None,
) -> int:
    """Parse, call, show."""
    from cmm_align.cli.show import finish

    config = job.config.compensate
    if gain is not None:
        config = replace(config, gain=gain)
    if text_decimals is not None:
        config = replace(config, text_decimals=text_decimals)
    return finish(
        job, make_correction(job, map_file, config, previous=previous, picture=not no_picture, output=output)
    )


def make_correction(
    job: Job,
    map_file: Path,
    config: CompensateConfig,
    *,
    previous: Path | None = None,
    picture: bool = True,
    output: Path | None = None,
) -> Outcome:
    """Read a map, compute the correction, write it and its exports.

    Parameters
    ----------
    job : Job
    map_file : Path
        What `error-map` wrote.
    config : CompensateConfig
    previous : Path, optional
        What `compensate` wrote before this part was ground.
    picture : bool
        Whether to draw the correction, beside the output and with its stem.
    output : Path, optional
        Beside the input unless given.
    """
    from cmm_align import files, io
    from cmm_align.cli import cautions, record, results
    from cmm_align.io.atomic import atomic_path
    from cmm_align.model import PointKind, PointSet
    from cmm_align.report import summary
    from cmm_align.stages.compensate import compensate

    if output is None:
        output = beside(map_file, ".comp.h5")
    text, drawing = output.with_suffix(".xyz"), output.with_suffix(".png")
    outputs = [output, text, drawing] if picture else [output, text]
    inputs = [map_file] if previous is None else [map_file, previous]
    record.check_outputs(job, outputs, inputs)
    before = None if previous is None else io.read_correction(previous)
    correction = compensate(io.read_map(map_file), config, before)
    steps = record.steps(job, inputs, after=inputs, compensate=config)
    io.write(correction, output, steps, overwrite=job.overwrite)
    commanded = PointSet.of(
        commanded_points(correction), kind=PointKind.COMMANDED, frame="part", source=str(text)
    )
    files.write_points(text, commanded, decimals=config.text_decimals, overwrite=job.overwrite)
    if picture:
        from cmm_align.report.correction_picture import draw_correction

        with atomic_path(drawing, job.overwrite) as path:
            draw_correction(
                correction, path, title=f"{beside(map_file, '').name}: correction of the next pass"
            )
    return Outcome(
        command=job.command,
        noun=correction,
        inputs=steps[-1].inputs,
        outputs=outputs,
        result=results.of_correction(correction, [text]),
        rows=[results.probe_row(correction.nominal), *summary.of_correction(correction)],
        warnings=cautions.of_correction(correction),
        next_command=f"grind {text}, measure, align and map; then compensate with --previous {output}",
    )


def commanded_points(correction: Correction) -> Array:
    """Return the commanded surface as points, row by row, nodes outside the aperture left out.

    Returns
    -------
    ndarray, shape (n, 3), mm, frame `part`
    """
    import numpy as np

    x, y = np.meshgrid(correction.x_mm, correction.y_mm)
    inside = np.isfinite(correction.commanded_z_mm)
    points = np.column_stack([x[inside], y[inside], correction.commanded_z_mm[inside]])
    return correction.nominal.surface_from_part.inverse().apply(points)
