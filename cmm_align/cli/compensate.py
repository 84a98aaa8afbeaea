"""`cmm-align compensate`: the surface to command next."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from cmm_align.cli import noting, options
from cmm_align.cli.exporting import HEADINGS as WHEEL_AND_EXPORTS
from cmm_align.cli.exporting import exporting_options, with_options
from cmm_align.cli.job import Job, Outcome, beside, typed
from cmm_align.cli.options import FILE, Length, output_option
from cmm_align.cli.touching import TOUCH_HEADINGS, touch_options
from cmm_align.config import GAIN_RULES, CompensateConfig, ExportConfig
from cmm_align.errors import InputError, OutputError, UsageError, WrongStageError
from cmm_align.units import UM_PER_MM

if TYPE_CHECKING:
    from cmm_align.model import Correction, DeviationMap
    from cmm_align.provenance import Step

MOST_CONTINUED: Final = 0.5
"""Refuse where more than this share of the nodes has no data of its own."""

HEADINGS: Final = {
    "Passes": ("--previous", "--first-pass", "--trust-me"),
    "What is corrected": (
        "--gain",
        "--force-gain",
        "--low-pass",
        "--region",
        "--transfer",
        "--repeatability",
        "--thickness-budget",
    ),
    **WHEEL_AND_EXPORTS,
    **TOUCH_HEADINGS,
    **noting.HEADINGS,
    "Files": ("--output", "--overwrite", "--no-picture", "--no-gate"),
}

TEXT = """The surface to grind next: what was commanded last, less the deviations of MAP.

Writes the correction as HDF5 and the commanded surface as x, y, z text, or as --export says. From the
second pass on give the correction of the pass before with --previous: the machine needs the sum, not the
last piece. Where such a file lies beside MAP, one of --previous and --first-pass must be given.
"""


@options.command("compensate", TEXT, headings=HEADINGS)
@click.argument("map_file", type=FILE, metavar="MAP")
@click.option("--gain", metavar="G", help="Share to take off, or wiener: one by wavelength.  [default: 1.0]")
@click.option("--force-gain", is_flag=True, help="Allow a gain over 1.2, below 2.")
@click.option("--low-pass", type=Length(), metavar="L", help="Correct no shorter waves than L.")
@click.option("--region", metavar="R", help="Correct only there: circle:X,Y,R, aperture:-2mm, ...")
@click.option(
    "--transfer", metavar="C", help='Share of a command that reaches the part: 0.9, or "0.95@30mm, 0.8@10mm".'
)
@click.option(
    "--repeatability", type=Length(positive=False), metavar="L", help="RMS between passes, as 0.5um."
)
@click.option("--thickness-budget", type=Length(), metavar="L", help="Most that all passes may take off.")
@click.option("--trust-me", is_flag=True, help="Go on although the last pass did nothing, or harm.")
@click.option("--previous", type=FILE, metavar="FILE", help="Correction that this part was ground with.")
@click.option("--first-pass", is_flag=True, help="The part was ground to the nominal, with no correction.")
@exporting_options
@noting.ledger_options
@touch_options
@click.option("--no-gate", is_flag=True, help="Write the exports unchecked.")
@click.option("--no-picture", is_flag=True, help="Write no picture.")
@output_option("<measured>.comp.h5")
def command(
    job: Job,
    *,
    map_file: Path,
    gain: str | None,
    force_gain: bool,
    low_pass: float | None,
    region: str | None,
    transfer: str | None,
    repeatability: float | None,
    thickness_budget: float | None,
    trust_me: bool,
    previous: Path | None,
    first_pass: bool,
    touches: Path | None,
    touch_radius: float | None,
    no_gate: bool,
    no_picture: bool,
    output: Path | None,
    **grinding: Any,
) -> int:
    """Parse, call, show."""
    from cmm_align.cli.show import finish

    config = _with_gain(job.config.compensate, gain)
    given: dict[str, Any] = {
        "low_pass_mm": low_pass,
        "region": region,
        "transfer": transfer,
        "repeatability_um": None if repeatability is None else repeatability * UM_PER_MM,
        "thickness_budget_um": None if thickness_budget is None else thickness_budget * UM_PER_MM,
        "force_gain": force_gain or None,
        "trust_me": trust_me or None,
    }
    config = replace(config, **{name: value for name, value in given.items() if value is not None})
    config, part = noting.with_ledger(config, grinding)
    config, export = with_options(config, job.config.export, grinding)
    return finish(
        job,
        make_correction(
            job,
            map_file,
            config,
            export=export,
            previous=previous,
            first_pass=first_pass,
            gate=not no_gate,
            touches=touches,
            touch_radius_mm=touch_radius,
            picture=not no_picture,
            output=output,
            part=part,
        ),
    )


def _with_gain(config: CompensateConfig, text: str | None) -> CompensateConfig:
    """Return the settings with the gain of the command line, a number or the word wiener."""
    if text is None:
        return config
    if text.strip().lower() in GAIN_RULES:
        return replace(config, gain_rule=text.strip().lower())
    try:
        return replace(config, gain=float(text), gain_rule="fixed")
    except ValueError:
        raise UsageError(f"--gain {text}", expected="a number above 0 and at most 1.2, or wiener") from None


def make_correction(
    job: Job,
    map_file: Path,
    config: CompensateConfig,
    *,
    export: ExportConfig = ExportConfig(),  # noqa: B008 - frozen
    previous: Path | None = None,
    first_pass: bool = False,
    gate: bool = True,
    touches: Path | None = None,
    touch_radius_mm: float | None = None,
    picture: bool = True,
    output: Path | None = None,
    part: str | None = None,
) -> Outcome:
    """Read a map, compute the correction, write it and its exports.

    Parameters
    ----------
    job : Job
    map_file : Path
        What `error-map` wrote.
    config : CompensateConfig
    export : ExportConfig
    previous : Path, optional
        What `compensate` wrote before this part was ground.
    first_pass : bool
        Whether the part was ground without a correction, whatever lies beside the map.
    gate : bool
        Whether the exports are read back and judged before they get their names.
    touches : Path, optional
        Touches of the part on the grinder: the exports are then in its frame.
    touch_radius_mm : float, optional
        Of the tip there; 0 for contact points.
    picture : bool
        Whether to draw the correction, beside the output and with its stem.
    output : Path, optional
        Beside the input unless given.
    part : str, optional
        Name of the part in the ledger of the settings.

    Raises
    ------
    UsageError
        If a correction of the same nominal lies beside the map and nobody says what it is.
    InputError
        If more than half of the nodes would have to be continued without data, or the wheel gouges or runs
        in air.
    GateError
        If an export would not make the part better; nothing is written then.
    """
    from cmm_align import io
    from cmm_align.cli import cautions, exporting, gating, opening, record, results, touching
    from cmm_align.cli.drawing import try_one
    from cmm_align.io.schema import CORRECTION, MAP
    from cmm_align.provenance import hashed, this_step
    from cmm_align.report import summary
    from cmm_align.stages.compensate import compensate
    from cmm_align.stages.remount import remount_sensitivity
    from cmm_align.stages.wheel_check import wheel_of

    opening.check_stage(map_file, MAP, job.command, job.units)
    if output is None:
        output = beside(map_file, ".comp.h5")
    plan, drawing = exporting.plan_of(export, output), output.with_suffix(".png")
    outputs = [output, *plan.paths, drawing] if picture else [output, *plan.paths]
    inputs = [map_file, *(path for path in (previous, touches) if path is not None)]
    if previous is not None:
        if first_pass:
            raise UsageError("--previous and --first-pass exclude each other")
        opening.check_stage(previous, CORRECTION, "--previous", job.units)
    before = None if previous is None else io.read_correction(previous)
    deviation_map = io.read_map(map_file)
    if previous is None and not first_pass:
        _check_first_pass(map_file, deviation_map, output)
    if before is not None and previous is not None and not config.trust_me:
        _check_last_pass(map_file, deviation_map, previous, before, output)
    record.check_outputs(job, outputs, inputs)
    checksums = hashed(inputs)
    time_utc = this_step(job.command, {}).time_utc
    ledger = noting.opened(config, part, map_file, deviation_map, before, time_utc)
    learned = ledger.used if ledger is not None else None
    correction = compensate(deviation_map, config, before, learned)
    _check_data(correction, str(map_file))
    seat, on_grinder = touching.laid(
        job, touches, touch_radius_mm, deviation_map, correction, trusted=config.trust_me
    )
    wheel, depth = exporting.checked_wheel(on_grinder, config)
    exports = exporting.prepared(plan, on_grinder, config, beside(map_file, "").name)
    settings = {"compensate": config, "export": export, "first_pass": first_pass}
    settings |= {"learned_transfer": noting.learned_result(learned)} if learned is not None else {}
    steps = record.steps(job, checksums, after=inputs if touches is None else inputs[:-1], **settings)
    noted = noting.adding(ledger, deviation_map, correction, before, time_utc, replace_row=job.overwrite)
    with noted, ExitStack() as stack:
        report = gating.written(
            stack,
            plan,
            exports,
            deviation_map,
            correction,
            on_grinder,
            wheel_of(config),
            overwrite=job.overwrite,
            skip=not gate,
        )
        correction = replace(correction, gate=gating.with_wheel(report, wheel, depth), seat=seat)
        io.write(correction, output, steps, overwrite=job.overwrite)

    def draw(path: Path) -> None:
        from cmm_align.report.correction_picture import draw_correction

        name = beside(map_file, "").name
        draw_correction(correction, path, title=f"{name}: correction to grind", source=map_file.name)

    costs = remount_sensitivity(correction.nominal)
    faults = try_one(draw, drawing, overwrite=job.overwrite) if picture else []
    return Outcome(
        command=job.command,
        noun=correction,
        inputs=steps[-1].inputs,
        outputs=[path for path in outputs if not faults or path != drawing],
        result=results.of_correction(correction, plan.paths)
        | exporting.result(wheel, depth)
        | {"ledger": None if ledger is None else ledger.result()}
        | gating.result(correction.gate or report)
        | touching.result(seat, costs),
        rows=[
            *summary.of_correction(correction),
            *(ledger.rows() if ledger is not None else ()),
            *exporting.rows(wheel, depth, plan.paths),
            results.probe_row(correction.nominal),
        ],
        details=[*summary.details_of_correction(correction), *touching.details(costs)],
        warnings=[
            *([] if gate else [gating.SKIPPED]),
            *touching.warnings(seat),
            *faults,
            *cautions.of_causes(deviation_map),
            *cautions.of_correction(correction),
            *exporting.warnings(wheel),
            *(ledger.warnings(before) if ledger is not None else ()),
        ],
        advice=f"grind {plan.paths[0].name}, measure the part again, and keep {output.name}: the "
        "compensation after that one takes it with --previous",
        next_command=typed("cmm-align", "align", "MEASURED", _nominal_of(steps)),
        exit_code=OutputError.exit_code if faults else 0,
    )


def _check_first_pass(map_file: Path, deviation_map: DeviationMap, output: Path) -> None:
    """Refuse to start from the nominal where a correction of the same nominal lies beside the map."""
    from cmm_align.io.earlier_passes import earlier_passes
    from cmm_align.stages.compensate import map_digest

    found = earlier_passes(
        map_file.parent, deviation_map.alignment.nominal.digest, map_digest(deviation_map), [output]
    )
    if found:
        path = found[0].path
        raise UsageError(
            f"{path.name} (same nominal) lies beside this map",
            remedy=f"if the part was ground with it give {typed('--previous', path)}, else --first-pass",
        )


def _check_last_pass(
    map_file: Path, deviation_map: DeviationMap, previous: Path, before: Correction, output: Path
) -> None:
    """Refuse a previous pass that a later one was made from: the part was hardly ground with the older."""
    from cmm_align.io.earlier_passes import earlier_passes
    from cmm_align.stages.compensate import map_digest

    nominal, digest = deviation_map.alignment.nominal.digest, map_digest(deviation_map)
    for later in earlier_passes(map_file.parent, nominal, digest, [output, previous]):
        if before.map_digest in later.applied_maps:
            raise WrongStageError(
                f"{later.path.name} beside this map is pass {later.pass_number} of the chain whose pass "
                f"{before.pass_number} was given",
                expected="the pass that this part was ground with last",
                remedy=f"give {typed('--previous', later.path)}; if that was never ground, --trust-me",
            )


def _check_data(correction: Correction, where: str) -> None:
    """Refuse a correction that is mostly continued, not measured."""
    from cmm_align.cli.cautions import continued_share

    share = continued_share(correction)
    if share > MOST_CONTINUED:
        raise InputError(
            f"{100.0 * share:.0f} % of the surface to grind has no data of its own",
            where=where,
            expected=f"at most {100.0 * MOST_CONTINUED:.0f} %",
            remedy="measure the rest, map with a larger --spacing, or give a nominal with a smaller aperture",
        )


def _nominal_of(steps: Sequence[Step]) -> str:
    """Return the nominal that the measurement was aligned to, if it is still where it was."""
    for step in reversed(steps):
        if step.command == "align" and step.inputs and Path(step.inputs[-1].path).is_file():
            return step.inputs[-1].path
    return "NOMINAL"
