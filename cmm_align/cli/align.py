"""`cmm-align align`: measured points laid on the nominal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from cmm_align.cli import options
from cmm_align.cli.job import Job, Outcome, beside, typed
from cmm_align.cli.options import FILE, TIP_RADIUS_HELP, Length, output_option
from cmm_align.config import AlignConfig
from cmm_align.errors import UsageError

if TYPE_CHECKING:
    from cmm_align.model import Nominal, PointSet
    from cmm_align.pose import Pose

NO_BALL_MM = 1e-3
"""Tip radius where contact points are laid on a raw nominal: no ball is needed, and none so small matters."""

TEXT = """Best-fit pose of MEASURED on NOMINAL, with deviations and contact points.

MEASURED holds tip centres as the machine reports them, in one file or several of one clamping.
NOMINAL is what `offset` wrote; a raw nominal will do if --tip-radius is given. The part may lie on the
table in any place and orientation.
"""


@options.command("align", TEXT)
@click.argument("measured", type=FILE, nargs=-1, metavar="MEASURED...")
@click.argument("nominal", type=FILE, required=False, metavar="NOMINAL")
@click.option("--tip-radius", type=Length(), metavar="R", help=f"{TIP_RADIUS_HELP} For a raw nominal.")
@click.option(
    "--side", type=click.Choice(["+z", "-z"]), help="Side of the probe, for a raw nominal.  [default: +z]"
)
@click.option("--face", type=click.IntRange(min=1), metavar="N", help="Face of a raw CAD nominal.")
@click.option("--contact-points", is_flag=True, help="MEASURED is compensated for the tip already.")
@click.option(
    "--distance",
    type=click.Choice(["smooth", "facet"]),
    help="Foot point on a smooth surface, or the plane of the triangle.  [default: smooth]",
)
@click.option(
    "--criterion",
    type=click.Choice(["least-squares", "minimum-zone", "least-stock"]),
    help="What the best fit makes small: squares, the largest deviation, or the stock to take off so that"
    " no deviation stays below zero.  [default: least-squares]",
)
@click.option(
    "--outliers",
    type=click.Choice(["reject", "keep"]),
    help="Touches on dirt: left out of the fit and listed, or kept.  [default: reject]",
)
@click.option("--trust-me", is_flag=True, help="Go on although the data look like a mistake.")
@click.option(
    "--iterations",
    type=click.IntRange(min=0),
    metavar="N",
    help="At most so many; 0 evaluates the start pose.  [default: 50]",
)
@click.option(
    "--initial",
    metavar="FILE|identity|search",
    help="Start from a 4x4 matrix part_from_machine (text), from an earlier alignment, as it lies, or from a"
    " search over all poses.  [default: as it lies, and a search where that is not good enough]",
)
@output_option("<measured>.align.h5")
def command(
    job: Job,
    *,
    measured: tuple[Path, ...],
    nominal: Path | None,
    tip_radius: float | None,
    side: str | None,
    face: int | None,
    contact_points: bool,
    distance: str | None,
    criterion: str | None,
    outliers: str | None,
    trust_me: bool,
    iterations: int | None,
    initial: str | None,
    output: Path | None,
) -> int:
    """Parse, call, show."""
    from cmm_align.cli.show import finish

    if nominal is None or not measured:
        raise UsageError(
            "two files are needed: MEASURED NOMINAL" + ("" if nominal is None else f", and {nominal} is one"),
            remedy="the order is: cmm-align align part.csv nominal.h5",
        )
    config = job.config.align
    if distance is not None:
        config = replace(config, distance=distance)
    if criterion is not None:
        config = replace(config, criterion=criterion)
    if outliers is not None:
        config = replace(config, outliers=outliers)
    if initial == "search":
        config, initial = replace(config, search="always"), None
    if trust_me:
        config = replace(config, trust_me=True)
    if iterations is not None:
        config = replace(config, max_iterations=iterations)
    ball = Ball(tip_radius, contact_points, side, face)
    return finish(job, make_alignment(job, measured, nominal, config, ball, initial=initial, output=output))


@dataclass(frozen=True, slots=True)
class Ball:
    """What the command line says about the probe and a raw nominal."""

    tip_radius_mm: float | None = None
    contact_points: bool = False
    side: str | None = None
    face: int | None = None


def make_alignment(
    job: Job,
    measured: Sequence[Path],
    nominal: Path,
    config: AlignConfig,
    ball: Ball = Ball(),
    *,
    initial: str | None = None,
    output: Path | None = None,
) -> Outcome:
    """Read points and nominal, align them and write the result.

    Parameters
    ----------
    job : Job
    measured : sequence of Path
        Points of one clamping.
    nominal : Path
        What `offset` wrote, or a raw nominal if the ball is known.
    config : AlignConfig
    ball : Ball
    initial : str, optional
        ``identity``, or the name of a file with the start pose.
    output : Path, optional
        Beside the first measured file unless given.
    """
    from cmm_align import files, io
    from cmm_align.cli import cautions, opening, record, results
    from cmm_align.cli.progress import progress_bar
    from cmm_align.cli.start import start_pose
    from cmm_align.model import Nominal
    from cmm_align.report import summary
    from cmm_align.stages.align import align
    from cmm_align.stages.plausibility import check_measured

    for path in measured:
        opening.check_kind(path, opening.POINTS)
    opening.check_kind(nominal, opening.NOMINAL)
    if output is None:
        output = beside(measured[0], ".align.h5")
    inputs = [*measured, nominal]
    points = joined([files.read_measured(path, job.units) for path in measured], contact=ball.contact_points)
    source = files.read_nominal_any(nominal, job.units, config.distance == "facet", ball.face)
    _check_ball(source, ball, where=str(nominal))
    if isinstance(source, Nominal) and output.exists():
        check_measured(points, source)  # a wrong unit is the larger mistake: it comes first
    record.check_outputs(job, [output], inputs)
    target = source if isinstance(source, Nominal) else _offset(job, source, ball)
    start: Pose | None = None if initial is None else start_pose(initial)
    with progress_bar(job) as progress:
        alignment = align(points, target, config, start=start, progress=progress)
    steps = record.steps(
        job,
        inputs,
        after=[nominal] if isinstance(source, Nominal) else [],
        align=config,
        tip_radius_mm=target.tip_radius_mm,
        contact_points=ball.contact_points,
        initial=initial,
        units=job.units,
    )
    io.write(alignment, output, steps, overwrite=job.overwrite)
    return Outcome(
        command=job.command,
        noun=alignment,
        inputs=steps[-1].inputs,
        outputs=[output],
        result=results.of_alignment(alignment),
        rows=[results.probe_row(target), *summary.of_alignment(alignment)],
        details=summary.details_of_alignment(alignment),
        warnings=cautions.of_alignment(alignment),
        next_command=typed("cmm-align", "error-map", output),
    )


def joined(sets: Sequence[PointSet], *, contact: bool) -> PointSet:
    """Return point sets of one clamping as one.

    Parameters
    ----------
    sets : sequence of PointSet
        At least one.
    contact : bool
        Whether the user says that they are contact points.

    Raises
    ------
    WrongStageError
        If they are of different kinds or frames.
    """
    import numpy as np

    from cmm_align.errors import WrongStageError
    from cmm_align.model import PointKind, PointSet

    for points in sets if contact else ():
        if points.kind is PointKind.TIP_CENTRE:
            raise WrongStageError(
                "--contact-points, but the file says that these are tip centres",
                where=points.source,
                expected="one or the other",
                remedy="leave the option out, or correct the header of the file",
            )
    if contact:
        sets = [replace(points, kind=PointKind.CONTACT) for points in sets]
    first = sets[0]
    for points in sets[1:]:
        if (points.kind, points.frame) != (first.kind, first.frame):
            raise WrongStageError(
                f"{points.kind} points in frame {points.frame}",
                where=points.source,
                expected=f"{first.kind} points in frame {first.frame}, as {first.source} has",
            )
    if len(sets) == 1:
        return first
    sigmas = [points.sigma_mm for points in sets if points.sigma_mm is not None]
    return PointSet.of(
        np.concatenate([points.points_mm for points in sets]),
        kind=first.kind,
        frame=first.frame,
        source=", ".join(points.source for points in sets),
        sigma_mm=np.concatenate(sigmas) if len(sigmas) == len(sets) else None,
    )


def _check_ball(source: object, ball: Ball, *, where: str) -> None:
    """Refuse a raw nominal without a tip radius, and a tip radius that is not the nominal's."""
    from cmm_align.model import Nominal
    from cmm_align.stages.offset import SIDES

    radius = ball.tip_radius_mm
    if isinstance(source, Nominal):
        if ball.side is not None and SIDES[ball.side] != source.side:
            raise UsageError(
                f"--side {ball.side}, but this nominal was offset to the other side",
                where=where,
                remedy="leave the option out, or run offset again",
            )
        if radius is not None and radius != source.tip_radius_mm:
            raise UsageError(
                f"--tip-radius {radius:g} mm, but this nominal was offset by {source.tip_radius_mm:g} mm",
                where=where,
                remedy="leave the option out, or run offset again",
            )
    elif radius is None and not ball.contact_points:
        raise UsageError(
            "a raw nominal needs the tip radius",
            where=where,
            remedy="give --tip-radius, or the file that offset wrote",
        )


def _offset(job: Job, source: object, ball: Ball) -> Nominal:
    """Return a raw nominal with its ball."""
    from cmm_align.stages.offset import offset

    config = job.config.offset if ball.side is None else replace(job.config.offset, side=ball.side)
    radius_mm = NO_BALL_MM if ball.tip_radius_mm is None else ball.tip_radius_mm
    return offset(source, radius_mm, config)  # type: ignore[arg-type]
