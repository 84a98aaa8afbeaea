"""`cmm-align offset`: the equidistant surface of a nominal."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import click

from cmm_align.cli import options
from cmm_align.cli.job import Job, Outcome, beside
from cmm_align.cli.options import FILE, Length, output_option
from cmm_align.config import OffsetConfig

TEXT = """Equidistant surface of NOMINAL, one tip radius out on the probe's side.

NOMINAL holds points (on a grid or scattered), a triangle mesh or a prescription. The result says how
steep it is, where the ball does not fit, and how well a smooth surface through its points knows the
part: keep the file, it serves every measurement made with this tip.
"""


@options.command("offset", TEXT)
@click.argument("nominal", type=FILE)
@click.option("--tip-radius", type=Length(), required=True, metavar="R", help="Effective tip radius.")
@click.option(
    "--side", type=click.Choice(["+z", "-z"]), help="Side of the nominal the probe is on.  [default: +z]"
)
@click.option(
    "--degree", type=click.Choice(["3", "5"]), help="Degree of the spline.  [default: by its error]"
)
@output_option("<nominal>.h5")
def command(
    job: Job, *, nominal: Path, tip_radius: float, side: str | None, degree: str | None, output: Path | None
) -> int:
    """Parse, call, show."""
    from cmm_align.cli.show import finish

    config = job.config.offset
    if side is not None:
        config = replace(config, side=side)
    if degree is not None:
        config = replace(config, degree=int(degree))
    return finish(job, make_nominal(job, nominal, tip_radius, config, output))


def make_nominal(
    job: Job, source: Path, tip_radius_mm: float, config: OffsetConfig, output: Path | None = None
) -> Outcome:
    """Read a nominal, offset it and write the result.

    Parameters
    ----------
    job : Job
    source : Path
        Points, mesh or prescription.
    tip_radius_mm : float
        Effective tip radius, mm.
    config : OffsetConfig
    output : Path, optional
        Beside the source unless given.

    Raises
    ------
    WrongStageError
        If the source is a nominal that was offset already.
    """
    from cmm_align import files, io
    from cmm_align.cli import cautions, record, results
    from cmm_align.errors import WrongStageError
    from cmm_align.model import Nominal
    from cmm_align.report import summary
    from cmm_align.stages.offset import offset

    if output is None:
        output = beside(source, ".offset.h5" if source.suffix == ".h5" else ".h5")
    record.check_outputs(job, [output], [source])
    raw = files.read_nominal_any(source, job.units, False)
    if isinstance(raw, Nominal):
        raise WrongStageError(
            f"it is offset already, by {raw.tip_radius_mm:g} mm",
            where=str(source),
            expected="a nominal as designed",
        )
    nominal = offset(raw, tip_radius_mm, config)
    steps = record.steps(job, [source], tip_radius_mm=tip_radius_mm, offset=config)
    io.write(nominal, output, steps, overwrite=job.overwrite)
    return Outcome(
        command=job.command,
        noun=nominal,
        inputs=steps[-1].inputs,
        outputs=[output],
        result=results.of_nominal(nominal),
        rows=summary.of_nominal(nominal),
        warnings=cautions.of_nominal(nominal),
        next_command=f"cmm-align align MEASURED {output}",
    )
