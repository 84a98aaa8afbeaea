"""`cmm-align error-map`: deviations on a grid, their statistics, picture and verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from cmm_align.cli import options
from cmm_align.cli.job import EXIT_OF_VERDICT, Job, Outcome, beside, typed
from cmm_align.cli.map_exports import EXPORTS
from cmm_align.cli.options import FILE, Length, output_option
from cmm_align.cli.papers import Papers
from cmm_align.cli.tolerances import ToleratedLength, ToleratedSlope, in_words, limits_of_points, with_band
from cmm_align.config import DECISIONS, FILTERS, ErrorMapConfig
from cmm_align.errors import CmmAlignError, OutputError, UsageError
from cmm_align.report.pictures import FORMATS, PICTURES
from cmm_align.units import UM_PER_MM

if TYPE_CHECKING:
    from cmm_align.cli.drawing import Drawings
    from cmm_align.model import Alignment, DeviationMap

TEXT = """Map of the deviations of ALIGNED, with statistics, a picture and a verdict.

Positive is excess material, along the outward normal. With a tolerance the exit code tells the
verdict: 0 within, 5 out, 6 undecided: the tolerance lies inside the uncertainty, too little was
measured, or points left out as outliers would break it. 8 is a picture or file that could not be
written. (A machine's own "error map" of 21 geometric components is another thing.)
"""


HEADINGS = {
    "Verdict": (
        "--tolerance-pv",
        "--tolerance-rms",
        "--tolerance-profile",
        "--tolerance-slope",
        "--tolerance-band",
        "--decision",
    ),
    "Papers and files": ("--report", "--card", "--pass", "--export", "--output", "--overwrite"),
    "Pictures": ("--pictures", "--picture-format", "--section", "--scale", "--no-picture"),
    "Which points and waves count": ("--report-region", "--spacing", "--low-pass", "--high-pass", "--filter"),
    "What changed, and why": ("--compare", "--cause-axis"),
}


@options.command("error-map", TEXT, headings=HEADINGS)
@click.argument("aligned", type=FILE)
@click.option(
    "--spacing", type=Length(), metavar="L", help="Spacing of the grid.  [default: from the points]"
)
@click.option(
    "--report-region",
    metavar="REGION",
    help="Only points there count in numbers, map and verdict: circle:X,Y,R rectangle:X,Y,W,H"
    " annulus:X,Y,R1,R2 polygon:X1,Y1,... aperture:-MARGIN or a TOML file.  [default: that of align]",
)
@click.option("--tolerance-pv", type=ToleratedLength(), metavar="L", help="On PV, as 5um; a unit is needed.")
@click.option("--tolerance-rms", type=ToleratedLength(), metavar="L", help="On RMS, as 1um.")
@click.option(
    "--tolerance-profile",
    type=ToleratedLength(),
    metavar="L",
    help="On the profile 2 max|e|, the width of the zone of ISO 1101, as 8um.",
)
@click.option(
    "--tolerance-slope",
    type=ToleratedSlope(),
    metavar="SLOPE",
    help="On the largest slope error, as 0.5mrad, 200urad, 1arcmin, 0.5um/mm.",
)
@click.option(
    "--tolerance-band",
    metavar="BAND",
    help="On every deviation: 5um (both ways), -2um,8um, or a table id,lower_um,upper_um.",
)
@click.option(
    "--decision",
    type=click.Choice(DECISIONS),
    help="Pass and fail only beyond the uncertainty (ISO 14253-1), or as measured.  [default: guard-band]",
)
@click.option(
    "--filter",
    "kind",
    type=click.Choice(FILTERS),
    help="With a cutoff: Gaussian regression of order 2, of order 0, robust, or spline.  [default: gaussian]",
)
@click.option("--low-pass", type=Length(), metavar="L", help="Take waves shorter than L away.")
@click.option("--high-pass", type=Length(), metavar="L", help="Take waves longer than L away.")
@click.option(
    "--cause-axis",
    metavar="X,Y",
    help="Axis of rotation when it was ground, for root causes.  [default: centre of the aperture]",
)
@click.option(
    "--pictures",
    metavar="LIST",
    help=f"What to draw, with commas: {', '.join(PICTURES)}; or all.  [default: map]",
)
@click.option(
    "--picture-format",
    "formats",
    type=click.Choice([*FORMATS, "both"]),
    multiple=True,
    help="Format of the pictures; repeatable.  [default: png]",
)
@click.option(
    "--section",
    "sections",
    metavar="LINE",
    multiple=True,
    help="Draw the section along x=0, y=5mm or X1,Y1:X2,Y2; repeatable.  [default: both middle lines]",
)
@click.option(
    "--scale",
    type=Length(),
    metavar="L",
    help="Colours from -L to +L, to compare a series.  [default: from the map]",
)
@click.option(
    "--compare",
    "earlier",
    type=FILE,
    metavar="FILE",
    help="Tell what changed since an earlier measurement: its map or its alignment.",
)
@click.option(
    "--export",
    "exports",
    type=click.Choice(list(EXPORTS)),
    multiple=True,
    help="Write the map for others too: a table, X3P (ISO 25178-72), Zygo's .dat; repeatable.",
)
@click.option("--no-picture", is_flag=True, help="Write no picture.")
@click.option("--report", is_flag=True, help="Write <measured>.map.html: one page to look at, sign, print.")
@click.option("--card", is_flag=True, help="Write <measured>.card.pdf: one A5 page for the operator.")
@click.option(
    "--pass",
    "pass_number",
    type=click.IntRange(1, 999),
    metavar="N",
    help="Which grind was measured, for the card.",
)
@output_option("<measured>.map.h5")
def command(
    job: Job,
    *,
    aligned: Path,
    spacing: float | None,
    report_region: str | None,
    tolerance_pv: float | None,
    tolerance_rms: float | None,
    tolerance_profile: float | None,
    tolerance_slope: float | None,
    tolerance_band: str | None,
    decision: str | None,
    kind: str | None,
    low_pass: float | None,
    high_pass: float | None,
    cause_axis: str | None,
    pictures: str | None,
    formats: tuple[str, ...],
    sections: tuple[str, ...],
    scale: float | None,
    earlier: Path | None,
    exports: tuple[str, ...],
    no_picture: bool,
    report: bool,
    card: bool,
    pass_number: int | None,
    output: Path | None,
) -> int:
    """Parse, call, show."""
    from cmm_align.cli.drawing import parsed
    from cmm_align.cli.show import finish

    drawings = parsed(pictures, formats, sections, none=no_picture)
    config = job.config.error_map
    if spacing is not None:
        config = replace(config, spacing_mm=spacing)
    if report_region is not None:
        config = replace(config, report_region=report_region)
    given: dict[str, Any] = {
        "tolerance_pv_um": tolerance_pv,
        "tolerance_rms_um": tolerance_rms,
        "tolerance_profile_um": tolerance_profile,
        "tolerance_slope_mrad": tolerance_slope,
        "decision": decision,
    }
    config = replace(config, **{name: value for name, value in given.items() if value is not None})
    config, table = with_band(config, tolerance_band)
    if kind is not None and low_pass is None and high_pass is None:
        raise UsageError("--filter without a cutoff", expected="--low-pass 5mm or --high-pass 30mm")
    if kind is not None:
        config = replace(config, filter=kind)
    config = replace(
        config,
        low_pass_mm=config.low_pass_mm if low_pass is None else low_pass,
        high_pass_mm=config.high_pass_mm if high_pass is None else high_pass,
    )
    if cause_axis is not None:
        config = replace(config, cause_axis=cause_axis)
    if scale is not None:
        config = replace(config, picture_scale_um=scale * UM_PER_MM)
    if pass_number is not None and not card:
        raise UsageError("--pass without --card", expected="--card, which shows the number")
    papers = Papers(report=report, card=card, pass_number=pass_number)
    outcome = make_map(
        job,
        aligned,
        config,
        table=table,
        earlier=earlier,
        drawings=drawings,
        exports=exports,
        papers=papers,
        output=output,
    )
    return finish(job, outcome)


def make_map(
    job: Job,
    aligned: Path,
    config: ErrorMapConfig,
    *,
    earlier: Path | None = None,
    table: Path | None = None,
    drawings: Drawings | None = None,
    exports: Sequence[str] = (),
    papers: Papers = Papers(),
    output: Path | None = None,
) -> Outcome:
    """Read an alignment, map its deviations, write map, exports, pictures, and papers where wanted.

    Parameters
    ----------
    job : Job
    aligned : Path
        What `align` wrote.
    config : ErrorMapConfig
    earlier : Path, optional
        Map or alignment of an earlier measurement of the part, to compare with.
    table : Path, optional
        Limits of the deviations of single points.
    drawings : Drawings, optional
        Which pictures, beside the output and with its stem; the map unless given.
    papers : Papers
        Which papers to write beside the output.
    exports : sequence of str
        Of `EXPORTS`, beside the output.
    output : Path, optional
        Beside the input unless given.
    """
    from cmm_align import io
    from cmm_align.cli import cautions, comparing, drawing, map_exports, opening, record, results
    from cmm_align.io.schema import ALIGNMENT
    from cmm_align.provenance import hashed
    from cmm_align.report import summary
    from cmm_align.report.section_lines import section_line
    from cmm_align.report.wishes import Wishes
    from cmm_align.stages.error_map import error_map

    opening.check_stage(aligned, ALIGNMENT, job.command, job.units)
    if output is None:
        output = beside(aligned, ".map.h5")
    drawings = drawing.Drawings() if drawings is None else drawings
    limits = drawing.limits_of(config, drawings)
    export_files = map_exports.files(exports, output)
    alignment = io.read_alignment(aligned)
    for text in drawings.sections:
        section_line(text, alignment.nominal.surface.bounds)  # before anything is computed or written
    outputs = [
        output,
        *export_files.values(),
        *(path for _, path in drawings.files(output)),
        *papers.paths(output),
    ]
    inputs = [aligned] if table is None else [aligned, table]
    if earlier is not None:
        comparing.check_earlier(job, aligned, earlier, config)
        inputs.append(earlier)
        outputs += comparing.files(drawings, output)
    record.check_outputs(job, outputs, inputs)
    checksums = hashed(inputs)
    config = _with_region(job, config, alignment)
    of_points = None if table is None else limits_of_points(alignment, config, table, job.units)
    deviation_map = error_map(alignment, config, limits=of_points)
    told: list[str] = []
    if earlier is not None:
        deviation_map, told = comparing.compared(deviation_map, earlier, config, aligned)
    steps = record.steps(job, checksums, after=[aligned], error_map=config)
    io.write(deviation_map, output, steps, overwrite=job.overwrite)
    exported, refused = map_exports.write_all(deviation_map, export_files, steps[-1], overwrite=job.overwrite)
    wishes = Wishes(
        title=beside(aligned, "").name,
        source=aligned.name,
        scale_um=config.picture_scale_um,
        limits=limits,
        sections=drawings.sections,
    )
    drawn = drawing.draw_all(deviation_map, drawings, output, wishes, overwrite=job.overwrite)
    outputs, faults = [output, *exported, *drawn.paths], drawn.faults
    if earlier is not None:
        places = comparing.files(drawings, output)
        more, missing = comparing.draw_all(deviation_map, places, wishes, overwrite=job.overwrite)
        outputs, faults = [*outputs, *more], [*faults, *missing]
    change = None if deviation_map.comparison is None else deviation_map.comparison.change
    verdict, reasons = summary.verdict_of(deviation_map)
    command, advice = _next(deviation_map, output)
    warnings = [
        *drawn.notes,
        *cautions.of_tolerances(deviation_map),
        *cautions.of_map(deviation_map),
        *told,
    ]
    written, missing = papers.write(
        deviation_map, output, wishes, steps, [*faults, *warnings], overwrite=job.overwrite
    )
    faults = [*faults, *missing]
    return Outcome(
        command=job.command,
        noun=deviation_map,
        inputs=steps[-1].inputs,
        outputs=[*outputs, *written],
        result={
            **results.of_map(deviation_map),
            "exports": [str(path) for path in exported],
            **comparing.of_change(change),
        },
        rows=[
            ("tolerance", in_words(config, table)),
            *summary.of_map(deviation_map),
            *comparing.rows_of_change(change),
            results.probe_row(deviation_map.alignment.nominal),
        ],
        details=[*summary.details_of_map(deviation_map), *comparing.details_of_change(change)],
        verdict=verdict,
        reasons=reasons,
        warnings=[*(map_exports.not_written(error) for error in refused), *faults, *warnings],
        advice=advice,
        next_command=command,
        exit_code=_exit_code(deviation_map, refused, faults),
    )


def _exit_code(deviation_map: DeviationMap, refused: list[CmmAlignError], faults: list[str]) -> int:
    """Return that of the verdict, if all that was asked for could be written."""
    if refused:
        return refused[0].exit_code
    return OutputError.exit_code if faults else EXIT_OF_VERDICT[deviation_map.verdict]


def _with_region(job: Job, config: ErrorMapConfig, alignment: Alignment) -> ErrorMapConfig:
    """Return the settings with the report region as a text, whatever file it stands in."""
    if not config.report_region:
        return config
    from cmm_align.formats.region_toml import read_region

    surface = alignment.nominal.surface
    region = read_region(config.report_region, surface, job.units, "--report-region")
    return replace(config, report_region=region.text)


def _next(deviation_map: DeviationMap, output: Path) -> tuple[str, str]:
    """Return the command to type next, and what to do: the same as on page and card."""
    from cmm_align.model import Verdict
    from cmm_align.report.instruction import instruction

    if deviation_map.verdict == Verdict.PASS:
        return "", "nothing: within tolerance"
    command, advice = _compensation(deviation_map, output)
    told = instruction(deviation_map, command)
    if deviation_map.verdict == Verdict.NONE or told.command:
        return command, advice
    order = told.order.replace("\N{MINUS SIGN}", "-").replace("\N{MICRO SIGN}", "u")
    return "", order[0].lower() + order[1:]


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
