"""`cmm-align error-map`: deviations on a grid, their statistics, picture and verdict."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Final

import click

from cmm_align.cli import options
from cmm_align.cli.job import Job, Outcome, beside
from cmm_align.cli.options import FILE, Length, output_option
from cmm_align.config import ErrorMapConfig
from cmm_align.units import UM_PER_MM

TEXT = """Map of the deviations of ALIGNED, with statistics, a picture and a verdict.

Positive is excess material, along the outward normal. With a tolerance the exit code tells the
verdict: 0 within, 5 out, 6 undecided because the tolerance lies inside the uncertainty. (A machine's
own "error map" of 21 geometric components is another thing.)
"""

EXIT_OF_VERDICT: Final = {"pass": 0, "none": 0, "fail": 5, "undecided": 6}


@options.command("error-map", TEXT)
@click.argument("aligned", type=FILE)
@click.option(
    "--spacing", type=Length(), metavar="L", help="Spacing of the grid.  [default: from the points]"
)
@click.option("--tolerance-pv", type=Length(), metavar="L", help="Tolerance on PV, as 5um.")
@click.option("--tolerance-rms", type=Length(), metavar="L", help="Tolerance on RMS, as 1um.")
@click.option("--no-picture", is_flag=True, help="Write no picture.")
@output_option("<measured>.map.h5")
def command(
    job: Job,
    *,
    aligned: Path,
    spacing: float | None,
    tolerance_pv: float | None,
    tolerance_rms: float | None,
    no_picture: bool,
    output: Path | None,
) -> int:
    """Parse, call, show."""
    from cmm_align.cli.show import finish

    config = job.config.error_map
    if spacing is not None:
        config = replace(config, spacing_mm=spacing)
    if tolerance_pv is not None:
        config = replace(config, tolerance_pv_um=tolerance_pv * UM_PER_MM)
    if tolerance_rms is not None:
        config = replace(config, tolerance_rms_um=tolerance_rms * UM_PER_MM)
    return finish(job, make_map(job, aligned, config, picture=not no_picture, output=output))


def make_map(
    job: Job, aligned: Path, config: ErrorMapConfig, *, picture: bool = True, output: Path | None = None
) -> Outcome:
    """Read an alignment, map its deviations, write map and picture.

    Parameters
    ----------
    job : Job
    aligned : Path
        What `align` wrote.
    config : ErrorMapConfig
    picture : bool
        Whether to draw the map, beside the output and with its stem.
    output : Path, optional
        Beside the input unless given.
    """
    from cmm_align import io
    from cmm_align.cli import cautions, record, results
    from cmm_align.io.atomic import atomic_path
    from cmm_align.report import summary
    from cmm_align.stages.error_map import error_map

    if output is None:
        output = beside(aligned, ".map.h5")
    drawing = output.with_suffix(".png")
    outputs = [output, drawing] if picture else [output]
    record.check_outputs(job, outputs, [aligned])
    deviation_map = error_map(io.read_alignment(aligned), config)
    steps = record.steps(job, [aligned], after=[aligned], error_map=config)
    io.write(deviation_map, output, steps, overwrite=job.overwrite)
    if picture:
        from cmm_align.report.map_picture import draw_map

        with atomic_path(drawing, job.overwrite) as path:
            draw_map(deviation_map, path, title=beside(aligned, "").name)
    return Outcome(
        command=job.command,
        noun=deviation_map,
        inputs=steps[-1].inputs,
        outputs=outputs,
        result=results.of_map(deviation_map),
        rows=[results.probe_row(deviation_map.alignment.nominal), *summary.of_map(deviation_map)],
        warnings=cautions.of_map(deviation_map),
        next_command=f"cmm-align compensate {output}",
        exit_code=EXIT_OF_VERDICT[deviation_map.verdict],
    )
