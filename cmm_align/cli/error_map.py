"""`cmm-align error-map`: deviations on a grid, their statistics, picture and verdict."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from cmm_align.cli import options
from cmm_align.cli.job import EXIT_OF_VERDICT, Job, Outcome, beside, typed
from cmm_align.cli.options import FILE, Length, output_option
from cmm_align.config import FILTERS, ErrorMapConfig
from cmm_align.errors import UsageError
from cmm_align.units import UM_PER_MM

if TYPE_CHECKING:
    from cmm_align.model import DeviationMap

TEXT = """Map of the deviations of ALIGNED, with statistics, a picture and a verdict.

Positive is excess material, along the outward normal. With a tolerance the exit code tells the
verdict: 0 within, 5 out, 6 undecided because the tolerance lies inside the uncertainty. (A machine's
own "error map" of 21 geometric components is another thing.)
"""


@options.command("error-map", TEXT)
@click.argument("aligned", type=FILE)
@click.option(
    "--spacing", type=Length(), metavar="L", help="Spacing of the grid.  [default: from the points]"
)
@click.option("--tolerance-pv", type=Length(), metavar="L", help="Tolerance on PV, as 5um.")
@click.option("--tolerance-rms", type=Length(), metavar="L", help="Tolerance on RMS, as 1um.")
@click.option(
    "--filter",
    "kind",
    type=click.Choice(FILTERS),
    help="With a cutoff: Gaussian regression of order 2, of order 0, robust, or spline.  [default: gaussian]",
)
@click.option("--low-pass", type=Length(), metavar="L", help="Take waves shorter than L away.")
@click.option("--high-pass", type=Length(), metavar="L", help="Take waves longer than L away.")
@click.option("--no-picture", is_flag=True, help="Write no picture.")
@output_option("<measured>.map.h5")
def command(
    job: Job,
    *,
    aligned: Path,
    spacing: float | None,
    tolerance_pv: float | None,
    tolerance_rms: float | None,
    kind: str | None,
    low_pass: float | None,
    high_pass: float | None,
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
    if kind is not None and low_pass is None and high_pass is None:
        raise UsageError("--filter without a cutoff", expected="--low-pass 5mm or --high-pass 30mm")
    if kind is not None:
        config = replace(config, filter=kind)
    config = replace(
        config,
        low_pass_mm=config.low_pass_mm if low_pass is None else low_pass,
        high_pass_mm=config.high_pass_mm if high_pass is None else high_pass,
    )
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
    from cmm_align.cli import cautions, opening, record, results
    from cmm_align.io.atomic import atomic_path
    from cmm_align.io.schema import ALIGNMENT
    from cmm_align.report import summary
    from cmm_align.stages.error_map import error_map

    opening.check_stage(aligned, ALIGNMENT, job.command, job.units)
    if output is None:
        output = beside(aligned, ".map.h5")
    drawing = output.with_suffix(".png")
    outputs = [output, drawing] if picture else [output]
    alignment = io.read_alignment(aligned)
    record.check_outputs(job, outputs, [aligned])
    deviation_map = error_map(alignment, config)
    steps = record.steps(job, [aligned], after=[aligned], error_map=config)
    io.write(deviation_map, output, steps, overwrite=job.overwrite)
    if picture:
        from cmm_align.report.map_picture import draw_map

        with atomic_path(drawing, job.overwrite) as path:
            draw_map(deviation_map, path, title=beside(aligned, "").name, source=aligned.name)
    verdict, reasons = summary.verdict_of(deviation_map)
    within = verdict == "PASS"
    command, advice = ("", "") if within else _compensation(deviation_map, output)
    return Outcome(
        command=job.command,
        noun=deviation_map,
        inputs=steps[-1].inputs,
        outputs=outputs,
        result=results.of_map(deviation_map),
        rows=[
            ("tolerance", tolerances(config)),
            *summary.of_map(deviation_map),
            results.probe_row(deviation_map.alignment.nominal),
        ],
        details=summary.details_of_map(deviation_map),
        verdict=verdict,
        reasons=reasons,
        warnings=[*cautions.of_tolerances(deviation_map, config), *cautions.of_map(deviation_map)],
        advice="nothing: within tolerance" if within else advice,
        next_command="" if within else command,
        exit_code=EXIT_OF_VERDICT[deviation_map.verdict],
    )


def tolerances(config: ErrorMapConfig) -> str:
    """Return the tolerances in words."""
    both = (("PV", config.tolerance_pv_um), ("RMS", config.tolerance_rms_um))
    given = ", ".join(f"{name} {value:g} um" for name, value in both if value > 0.0)
    return given or "none given, so no verdict (--tolerance-pv, --tolerance-rms)"


def _compensation(deviation_map: DeviationMap, output: Path) -> tuple[str, str]:
    """Return the command that takes the map, and what to add where a correction of this nominal lies here."""
    from cmm_align.io.earlier_passes import earlier_passes
    from cmm_align.stages.compensate import map_digest

    found = earlier_passes(
        output.parent,
        deviation_map.alignment.nominal.digest,
        map_digest(deviation_map),
        [beside(output, ".comp.h5")],
    )
    command = typed("cmm-align", "compensate", output)
    if not found:
        return command, ""
    earlier = typed("--previous", found[0].path)
    return command, f"if this part was ground with {found[0].path}, add {earlier}; if not, --first-pass"
