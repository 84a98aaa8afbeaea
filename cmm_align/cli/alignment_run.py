"""A run of `align`: files read, points laid on the nominal, results written."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from cmm_align.cli.job import EXIT_OF_VERDICT, Job, Outcome, typed
from cmm_align.cli.measured import Sources
from cmm_align.config import AlignConfig
from cmm_align.errors import UsageError

if TYPE_CHECKING:
    from cmm_align.model import Fiducials, Nominal, PointSet
    from cmm_align.pose import Pose
    from cmm_align.stages.alignment_report import Regions
    from cmm_align.surfaces.protocol import Array


@dataclass(frozen=True, slots=True)
class Ball:
    """What the command line says about the probe and a raw nominal."""

    tip_radius_mm: float | None = None
    side: str | None = None
    face: int | None = None


@dataclass(frozen=True, slots=True)
class Tables:
    """Files that say more of single points, of datum points and of regions; None where there is none."""

    weights: Path | None = None
    limits: Path | None = None
    fiducials: Path | None = None
    iteration_log: Path | None = None
    """Written: every step of the fit."""


def make_alignment(
    job: Job,
    sources: Sources,
    nominal: Path,
    config: AlignConfig,
    ball: Ball = Ball(),
    *,
    initial: str | None = None,
    tables: Tables = Tables(),
    output: Path | None = None,
) -> Outcome:
    """Read points and nominal, align them and write the result.

    Parameters
    ----------
    job : Job
    sources : Sources
        Points of one clamping.
    nominal : Path
        What `offset` wrote, or a raw nominal if the ball is known.
    config : AlignConfig
    ball : Ball
    initial : str, optional
        ``identity``, or the name of a file with the start pose.
    tables : Tables
    output : Path, optional
        Beside the first measured file unless given; here for a port.
    """
    from cmm_align import files, io
    from cmm_align.cli import cautions, measured, opening, record, results
    from cmm_align.cli.progress import progress_bar
    from cmm_align.cli.start import start_pose
    from cmm_align.model import Nominal
    from cmm_align.provenance import hashed
    from cmm_align.report import alignment_summary as summary
    from cmm_align.stages.align import align
    from cmm_align.stages.plausibility import check_measured

    port = measured.port_of(sources)
    for name in sources.names if port is None else ():
        opening.check_kind(Path(name), opening.POINTS)
    opening.check_kind(nominal, opening.NOMINAL)
    if output is None:
        output = measured.default_output(sources, port)
    source = files.read_nominal_any(nominal, job.units, _with_net(config), ball.face)
    _check_ball(source, ball, contact=sources.contact, where=str(nominal))
    outputs = [output, *([] if tables.iteration_log is None else [tables.iteration_log])]
    if port is not None:  # nobody starts a dump twice
        record.check_outputs(job, outputs, [nominal])
    given = measured.read_measured(job, sources, port, output)
    points = given.points
    if given.renumbered and (tables.weights is not None or tables.limits is not None):
        raise UsageError(
            "a table keyed by id, for files that share ids",
            expected="files whose ids differ",
            remedy="number the points through, or put the files into one",
        )
    read = [path for path in (tables.weights, tables.limits, tables.fiducials) if path is not None]
    inputs = [*given.paths, nominal, *read]
    if isinstance(source, Nominal) and output.exists() and not job.overwrite:
        check_measured(points, source)  # a wrong unit is the larger mistake: it comes first
    record.check_outputs(job, outputs, inputs)
    _check_tip(given.tip_radius_mm, source, ball)
    target = source if isinstance(source, Nominal) else _offset(job, source, ball)
    points = _weighted(points, tables)
    regions, limits, fiducials = _constraints(job, points, target, config, tables)
    start: Pose | None = None if initial is None else start_pose(initial)
    checksums = hashed(inputs)
    with progress_bar(job) as progress:
        alignment = align(
            points,
            target,
            config,
            start=start,
            fiducials=fiducials,
            tolerance=limits,
            regions=regions,
            progress=progress,
        )
    steps = record.steps(
        job,
        checksums,
        after=[nominal] if isinstance(source, Nominal) else [],
        align=config,
        tip_radius_mm=target.tip_radius_mm,
        contact_points=sources.contact,
        initial=initial,
        units=job.units,
    )
    io.write(alignment, output, steps, overwrite=job.overwrite)
    if tables.iteration_log is not None:
        files.write_iterations(tables.iteration_log, alignment.report.steps, overwrite=job.overwrite)
    verdict, reasons = summary.verdict_of_alignment(alignment)
    return Outcome(
        command=job.command,
        noun=alignment,
        inputs=steps[-1].inputs,
        outputs=outputs,
        result={**results.of_alignment(alignment), "passed_over": list(points.passed_over)},
        rows=[results.probe_row(target), *summary.of_alignment(alignment)],
        details=summary.details_of_alignment(alignment),
        verdict="" if verdict == "none" else verdict.upper(),
        reasons=reasons,
        warnings=[
            *given.warnings,
            *cautions.of_alignment(alignment),
            *cautions.of_tolerance(alignment, config),
        ],
        next_command=typed("cmm-align", "error-map", output),
        exit_code=EXIT_OF_VERDICT[verdict],
    )


def _with_net(config: AlignConfig) -> bool:
    """Return whether the nodes of the nominal's net are needed."""
    return config.distance == "facet" or config.method != "foot-point"


def _weighted(points: PointSet, tables: Tables) -> PointSet:
    """Give points the weights of a table."""
    if tables.weights is None:
        return points
    from cmm_align import formats

    table = formats.read_weights(tables.weights)
    row = formats.matched(points.ids, table.ids, str(tables.weights))
    return replace(points, weight=table.weight[row])


def _constraints(
    job: Job, points: PointSet, nominal: Nominal, config: AlignConfig, tables: Tables
) -> tuple[Regions, tuple[Array, Array] | None, Fiducials | None]:
    """Read what steers the fit beside the points: regions, limits of single points, datum points."""
    from cmm_align import formats
    from cmm_align.stages.alignment_report import Regions

    texts = ((config.fit_region, "--fit-region"), (config.report_region, "--report-region"))
    regions = Regions(
        *(
            formats.read_region(text, nominal.surface, job.units, name) if text else None
            for text, name in texts
        )
    )
    limits = None
    if tables.limits is not None:
        table = formats.read_limits(tables.limits, job.units)
        row = formats.matched(points.ids, table.ids, str(tables.limits))
        limits = table.lower_mm[row], table.upper_mm[row]
    fiducials = None
    if tables.fiducials is not None:
        fiducials = formats.read_fiducials(tables.fiducials, job.units)
    return regions, limits, fiducials


def _check_ball(source: object, ball: Ball, *, contact: bool, where: str) -> None:
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
    elif radius is None and not contact:
        raise UsageError(
            "a raw nominal needs the tip radius",
            where=where,
            remedy="give --tip-radius, or the file that offset wrote",
        )


def _check_tip(profile_mm: float, source: object, ball: Ball) -> None:
    """Refuse a machine whose profile names another tip than the nominal was offset for."""
    from cmm_align.model import Nominal

    radius = source.tip_radius_mm if isinstance(source, Nominal) else ball.tip_radius_mm
    if profile_mm > 0.0 and radius is not None and profile_mm != radius:
        raise UsageError(
            f"the machine's profile says a tip radius of {profile_mm:g} mm, the nominal {radius:g} mm",
            expected="the same",
            remedy="run offset with the tip that was used, or correct the profile",
        )


def _offset(job: Job, source: object, ball: Ball) -> Nominal:
    """Return a raw nominal with its ball."""
    from cmm_align.stages.fit_checks import NO_BALL_MM
    from cmm_align.stages.offset import offset

    config = job.config.offset if ball.side is None else replace(job.config.offset, side=ball.side)
    radius_mm = NO_BALL_MM if ball.tip_radius_mm is None else ball.tip_radius_mm
    return offset(source, radius_mm, config)  # type: ignore[arg-type]
