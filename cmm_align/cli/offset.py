"""`cmm-align offset`: the equidistant surface of a nominal."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from cmm_align.cli import options
from cmm_align.cli.job import Job, Outcome, beside, typed
from cmm_align.cli.options import FILE, TIP_RADIUS_HELP, Length, output_option
from cmm_align.config import OffsetConfig

if TYPE_CHECKING:
    from cmm_align.stages.plan import MeasuringPlan

TEXT = """Equidistant surface of NOMINAL, one tip radius out on the probe's side.

NOMINAL holds points (on a grid or scattered), a triangle mesh, a CAD face, a grid sag file or a
prescription. The result says how steep it is, where the ball does not fit, and how well a smooth
surface through its points knows the part: keep the file, it serves every measurement made with this
tip. With --normals, for parts without a design, it takes the ball off measured tip centres instead.
"""


@options.command("offset", TEXT)
@click.argument("nominal", type=FILE)
@click.option("--tip-radius", type=Length(), required=True, metavar="R", help=TIP_RADIUS_HELP)
@click.option(
    "--side", type=click.Choice(["+z", "-z"]), help="Side of the nominal the probe is on.  [default: +z]"
)
@click.option(
    "--degree", type=click.Choice(["3", "5"]), help="Degree of the spline.  [default: by its error]"
)
@click.option("--face", type=click.IntRange(min=1), metavar="N", help="Face of a CAD file with several.")
@click.option("--decimal", type=click.Choice([".", ","]), help="Decimal sign of a text that leaves it open.")
@click.option("--columns", metavar="NAMES", help="Columns of a text: id,x,y,z; - for one to skip.")
@click.option(
    "--normals",
    type=click.Choice(["local-quadratic", "bspline", "mls"]),
    help="Without a nominal: contact points of measured tip centres, along estimated normals.",
)
@click.option("--plot", is_flag=True, help="Draw slope, curvatures, features and reach: <output>.png.")
@click.option("--plan", "with_plan", is_flag=True, help="Write a measuring plan: <output>.plan.csv, x to k.")
@click.option(
    "--spacing",
    type=Length(),
    metavar="L",
    help="Base spacing of the plan.  [default: by facet error and count]",
)
@output_option("<nominal>.h5")
def command(
    job: Job,
    *,
    nominal: Path,
    tip_radius: float,
    side: str | None,
    degree: str | None,
    face: int | None,
    decimal: str | None,
    columns: str | None,
    normals: str | None,
    plot: bool,
    with_plan: bool,
    spacing: float | None,
    output: Path | None,
) -> int:
    """Parse, call, show."""
    from cmm_align.cli.show import finish

    config = job.config.offset
    if side is not None:
        config = replace(config, side=side)
    if degree is not None:
        config = replace(config, degree=int(degree))
    if spacing is not None:
        config = replace(config, plan_spacing_mm=spacing)
    if normals is not None:
        return finish(job, make_contacts(job, nominal, tip_radius, normals, config.side, output))
    reading = Reading(face, decimal, columns)
    made = make_nominal(
        job, nominal, tip_radius, config, output, plot=plot, with_plan=with_plan, reading=reading
    )
    return finish(job, made)


@dataclass(frozen=True, slots=True)
class Reading:
    """How to read a nominal that leaves something open.

    Attributes
    ----------
    face : int or None
        Of a CAD file, from 1.
    decimal, columns : str or None
        Of a text.
    """

    face: int | None = None
    decimal: str | None = None
    columns: str | None = None


def make_nominal(
    job: Job,
    source: Path,
    tip_radius_mm: float,
    config: OffsetConfig,
    output: Path | None = None,
    *,
    plot: bool = False,
    with_plan: bool = False,
    reading: Reading = Reading(),
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
    plot : bool
        Whether to draw maps of the nominal, and the plan if there is one.
    with_plan : bool
        Whether to write a measuring plan.
    reading : Reading

    Raises
    ------
    WrongStageError
        If the source is a nominal that was offset already.
    """
    from cmm_align import files, io
    from cmm_align.cli import cautions, opening, record, results
    from cmm_align.cli.drawing import try_one
    from cmm_align.errors import OutputError, WrongStageError
    from cmm_align.formats import Hints
    from cmm_align.model import Nominal
    from cmm_align.report import summary
    from cmm_align.stages.offset import offset
    from cmm_align.stages.plan import plan

    if output is None:
        output = beside(source, ".offset.h5" if source.suffix == ".h5" else ".h5")
    stem = output.with_suffix("")
    drawing, plan_text, plan_drawing = (
        stem.with_name(stem.name + s) for s in (".png", ".plan.csv", ".plan.png")
    )
    wanted = [(plot, drawing), (with_plan, plan_text), (plot and with_plan, plan_drawing)]
    outputs = [output, *(path for asked, path in wanted if asked)]
    opening.check_kind(source, opening.NOMINAL)
    hints = Hints(reading.decimal, reading.columns)
    raw = files.read_nominal_any(source, job.units, False, reading.face, hints)
    record.check_outputs(job, outputs, [source])
    if isinstance(raw, Nominal):
        raise WrongStageError(
            f"it is offset already, by {raw.tip_radius_mm:g} mm",
            where=str(source),
            expected="a nominal as designed",
        )
    nominal = offset(raw, tip_radius_mm, config)
    steps = record.steps(job, [source], tip_radius_mm=tip_radius_mm, offset=config)
    measuring = plan(nominal, config) if with_plan else None
    io.write(nominal, output, steps, overwrite=job.overwrite)
    title = beside(source, "").name

    def draw(path: Path) -> None:
        from cmm_align.report.nominal_picture import draw_nominal

        draw_nominal(nominal, path, title, config.feature_curvature_per_mm, source.name)

    faults = try_one(draw, drawing, overwrite=job.overwrite) if plot else []
    missing = [drawing] if faults else []
    result, rows = results.of_nominal(nominal), summary.of_nominal(nominal)
    if measuring is not None:
        _write_plan(job, measuring, plan_text)
        result["plan"] = results.of_plan(measuring, plan_text)
        rows += results.rows_of_plan(measuring)
        places_mm, dense, numbers = measuring.places_mm, measuring.dense, results.head_of_plan(measuring)

        def draw_points(path: Path) -> None:
            from cmm_align.report.plan_picture import draw_plan

            draw_plan(nominal, places_mm, dense, numbers, path, f"{title}: measuring plan", source.name)

        more = try_one(draw_points, plan_drawing, overwrite=job.overwrite) if plot else []
        faults, missing = [*faults, *more], [*missing, *([plan_drawing] if more else [])]
    return Outcome(
        command=job.command,
        noun=nominal,
        inputs=steps[-1].inputs,
        outputs=[path for path in outputs if path not in missing],
        result=result,
        rows=rows,
        warnings=[*faults, *cautions.of_nominal(nominal)],
        next_command=typed("cmm-align", "align", "MEASURED", output),
        exit_code=OutputError.exit_code if faults else 0,
    )


def make_contacts(
    job: Job, source: Path, tip_radius_mm: float, method: str, side: str, output: Path | None = None
) -> Outcome:
    """Take the ball off measured tip centres along estimated normals and write the contact points.

    Parameters
    ----------
    job : Job
    source : Path
        Tip centres.
    tip_radius_mm : float
        Effective tip radius, mm.
    method : str
        local-quadratic, bspline or mls.
    side : str
        +z or -z.
    output : Path, optional
        Beside the source unless given.
    """
    from cmm_align import files
    from cmm_align.cli import record
    from cmm_align.stages.estimated_contacts import estimated_contacts

    output = output or beside(source, ".contacts.csv")
    record.check_outputs(job, [output], [source], stage_file=False)
    contacts, normals = estimated_contacts(
        files.read_measured(source, job.units), tip_radius_mm, method, side
    )
    steps = record.steps(job, [source], tip_radius_mm=tip_radius_mm, normals=method, side=side)
    note = f"contact points along estimated normals ({method}); tip radius {tip_radius_mm:g} mm"
    files.write_points(output, contacts, normals=normals, notes=(note,), overwrite=job.overwrite)
    return Outcome(
        command=job.command,
        noun=contacts,
        inputs=steps[-1].inputs,
        outputs=[output],
        result={"n_points": len(contacts), "tip_radius_mm": tip_radius_mm, "normals": method, "side": side},
        rows=[
            (
                "contact points",
                f"{len(contacts)}, along estimated normals ({method}), ball on the {side} side",
            )
        ],
        warnings=["normals are estimated: where there is a design, align to it instead"],
        next_command="",
    )


def _write_plan(job: Job, measuring: MeasuringPlan, path: Path) -> None:
    """Write the plan as text of ours, with a word to the operator."""
    from cmm_align import files
    from cmm_align.model import PointKind, PointSet

    points = PointSet.of(measuring.points_mm, kind=PointKind.NOMINAL, frame="part", source=str(path))
    notes = (
        "measuring plan: contact points on the nominal, in the order of travel; i,j,k = outward normal",
        "use: align the part roughly, touch each point along -(i,j,k), export the tip centres (x,y,z)",
        f"{len(measuring)} points, base spacing {measuring.spacing_mm:.4g} mm in the projection, "
        f"{measuring.dense_spacing_mm:.4g} mm in feature regions",
    )
    files.write_points(path, points, normals=measuring.normals, notes=notes, overwrite=job.overwrite)
