"""`cmm-align align`: measured points laid on the nominal."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import click

from cmm_align.cli import options
from cmm_align.cli.job import Job
from cmm_align.cli.options import FILE, TIP_RADIUS_HELP, Length, output_option
from cmm_align.config import ALIGN_CHOICES, AlignConfig, checked
from cmm_align.errors import UnitsError, UsageError
from cmm_align.units import REFERENCE_C, UM_PER_MM, parse_length_mm, parse_mpe

TEXT = """Best-fit pose of MEASURED on NOMINAL, with deviations and contact points.

MEASURED holds tip centres as the machine reports them, in one file or several of one clamping; a port
(/dev/ttyUSB0, COM3, socket://host:port) or a recording of `capture` is captured first.
NOMINAL is what `offset` wrote; a raw nominal will do if --tip-radius is given. The part may lie on the
table in any place and orientation. Most parts need no option at all.

\b
  clear aperture only     --report-region aperture:-2mm
  does it pass at all?    --tolerance 10um
  warm part               --temperature 23.5 --expansion 7.1e-6
  limits on the drawing   --limit wedge=3 --limit thickness=20
"""

LIMITS = {
    "wedge": ("max_wedge_arcmin", "arcmin"),
    "decentre": ("max_decentre_um", "um"),
    "clocking": ("max_clocking_arcmin", "arcmin"),
    "thickness": ("max_thickness_um", "um"),
}
"""What --limit may name: the setting behind it, and its unit."""


HEADINGS = {
    "Every day": ("--output", "--overwrite", "--tolerance", "--report-region", "--initial", "--units"),
    "A nominal that offset has not seen": ("--tip-radius", "--side", "--face", "--contact-points"),
    "From the port": ("--profile", "--expect"),
    "A file that can be read in two ways": ("--columns", "--decimal", "--strict"),
    "What steers the fit": (
        "--criterion",
        "--fit-region",
        "--weights",
        "--outliers",
        "--fiducials",
        "--lock",
        "--lock-frame",
        "--centre",
        "--trust-me",
    ),
    "Temperature and scale": ("--temperature", "--expansion", "--scale"),
    "What can be said of it": ("--limit", "--monte-carlo", "--mpe", "--seed", "--bidirectional"),
    "To compare and to look closer": ("--method", "--distance", "--iterations", "--log-iterations"),
}


@options.command("align", TEXT, headings=HEADINGS)
@click.argument("measured", nargs=-1, metavar="MEASURED...")
@click.argument("nominal", type=FILE, required=False, metavar="NOMINAL")
@click.option("--tip-radius", type=Length(), metavar="R", help=f"{TIP_RADIUS_HELP} For a raw nominal.")
@click.option(
    "--side", type=click.Choice(["+z", "-z"]), help="Side of the probe, for a raw nominal.  [default: +z]"
)
@click.option("--face", type=click.IntRange(min=1), metavar="N", help="Face of a raw CAD nominal.")
@click.option("--profile", type=FILE, metavar="FILE.toml", help="The machine, if MEASURED is its port.")
@click.option("--expect", type=click.IntRange(min=1), metavar="N", help="Points that the port will send.")
@click.option("--decimal", type=click.Choice([".", ","]), help="Decimal sign of a text that leaves it open.")
@click.option(
    "--columns", metavar="NAMES", help="What the columns of a text are: id,x,y,z; - for one to skip."
)
@click.option("--strict", is_flag=True, help="Refuse a measurement with rows that would be left out.")
@click.option("--contact-points", is_flag=True, help="MEASURED is compensated for the tip already.")
@click.option(
    "--initial",
    metavar="FILE|identity|search",
    help="Start from a 4x4 matrix part_from_machine (text), from an earlier alignment, as it lies, or from a"
    " search over all poses.  [default: as it lies, and a search where that is not good enough]",
)
@click.option(
    "--criterion",
    type=click.Choice(ALIGN_CHOICES["criterion"]),
    help="What the best fit makes small: squares, the largest deviation, or the stock to take off so that"
    " no deviation stays below zero; or whether any position keeps a tolerance.  [default: least-squares]",
)
@click.option(
    "--tolerance",
    metavar="L|LOW,HIGH|FILE",
    help="Is there any position in which every deviation is within L, from LOW to HIGH, or within the limits"
    " of a table (id, lower_um, upper_um)? The exit code tells.",
)
@click.option(
    "--lock",
    metavar="MOTIONS",
    help="Hold motions at the start: any of rx,ry,rz,tx,ty,tz.",
)
@click.option(
    "--lock-frame",
    type=click.Choice(ALIGN_CHOICES["lock_frame"]),
    help="Frame of the locked motions.  [default: part]",
)
@click.option(
    "--centre", metavar="X,Y,Z", help="Centre of rotation in that frame, with --lock.  [default: its origin]"
)
@click.option(
    "--fit-region",
    metavar="REGION",
    help="Only points there steer the fit: circle:X,Y,R rectangle:X,Y,W,H annulus:X,Y,R1,R2"
    " polygon:X1,Y1,... aperture:-MARGIN or a TOML file.  [default: the nominal]",
)
@click.option(
    "--report-region", metavar="REGION", help="Only points there count in numbers and map; as --fit-region."
)
@click.option(
    "--weights",
    metavar="equal|sigma|area|stated|FILE",
    help="How much points count: alike, by their stated uncertainty, by the area that each stands for, by the"
    " column weight of MEASURED, or by a table (id, weight).  [default: equal]",
)
@click.option(
    "--fiducials", type=FILE, metavar="FILE", help="Datum points with their uncertainty, beside the surface."
)
@click.option(
    "--outliers",
    type=click.Choice(ALIGN_CHOICES["outliers"]),
    help="Touches on dirt: left out of the fit and listed, or kept.  [default: reject]",
)
@click.option("--trust-me", is_flag=True, default=None, help="Go on although the data look like a mistake.")
@click.option(
    "--temperature",
    "temperature_c",
    type=float,
    metavar="C",
    help="Of the part, for a fixed scale.  [default: 20]",
)
@click.option(
    "--expansion",
    "expansion_per_k",
    type=float,
    metavar="1/K",
    help="Of the part against the machine's scales: 7.1e-6.",
)
@click.option(
    "--scale",
    type=click.Choice(ALIGN_CHOICES["scale"]),
    help="Fit a scale as well, and tell what it cannot be told from.  [default: fixed]",
)
@click.option(
    "--limit",
    "limits",
    multiple=True,
    metavar="MOTION=VALUE",
    help="Limit of the motion that the best fit takes away: wedge=3 (arcmin), decentre=20 (um), clocking=5"
    " (arcmin), thickness=50 (um). The exit code tells.",
)
@click.option(
    "--monte-carlo", type=click.IntRange(min=40), metavar="N", help="Simulate N measurements; needs --mpe."
)
@click.option("--mpe", metavar="A+L/K", help="Error of length measurement of the machine, um: '0.7+L/400'.")
@click.option("--seed", type=click.IntRange(min=0), metavar="N", help="Of the simulation.  [default: 1]")
@click.option(
    "--bidirectional",
    is_flag=True,
    default=None,
    help="Triangulate the cloud too, and measure the nominal against it.",
)
@click.option(
    "--distance",
    type=click.Choice(ALIGN_CHOICES["distance"]),
    help="Foot point on a smooth surface, or the plane of the triangle.  [default: smooth]",
)
@click.option(
    "--method",
    type=click.Choice(ALIGN_CHOICES["method"]),
    help="To compare with: methods of the literature.  [default: foot-point]",
)
@click.option(
    "--iterations",
    "max_iterations",
    type=click.IntRange(min=0),
    metavar="N",
    help="At most so many; 0 evaluates the start pose.  [default: 50]",
)
@click.option(
    "--log-iterations", type=FILE, metavar="FILE.csv", help="Write every step: movement, RMS, points used."
)
@output_option("<measured>.align.h5")
def command(
    job: Job,
    *,
    measured: tuple[str, ...],
    nominal: Path | None,
    tip_radius: float | None,
    side: str | None,
    face: int | None,
    profile: Path | None,
    expect: int | None,
    decimal: str | None,
    columns: str | None,
    strict: bool,
    contact_points: bool,
    initial: str | None,
    tolerance: str | None,
    weights: str | None,
    fiducials: Path | None,
    limits: tuple[str, ...],
    log_iterations: Path | None,
    output: Path | None,
    **settings: Any,
) -> int:
    """Parse, call, show."""
    from cmm_align.cli.alignment_run import Ball, Tables, make_alignment
    from cmm_align.cli.measured import Sources
    from cmm_align.cli.show import finish

    if nominal is None or not measured:
        raise UsageError(
            "two files are needed: MEASURED NOMINAL" + ("" if nominal is None else f", and {nominal} is one"),
            remedy="the order is: cmm-align align part.csv nominal.h5",
        )
    known = {field.name for field in fields(AlignConfig)}
    given = {name: value for name, value in settings.items() if value is not None and name in known}
    config = replace(job.config.align, **given)
    if initial not in {None, "search", "identity"} and not Path(str(initial)).is_file():
        raise UsageError(f"--initial {initial}", expected="identity, search, or a file with a start pose")
    if initial == "search":
        config, initial = replace(config, search="always"), None
    config, weights_file = _weights(config, weights)
    config, limits_file = _tolerance(config, tolerance)
    config = checked(_limits(config, limits))
    _check_together(config, given)
    tables = Tables(weights_file, limits_file, fiducials, log_iterations)
    ball = Ball(tip_radius, side, face)
    sources = Sources(measured, profile, expect, contact_points, decimal, columns, strict)
    return finish(
        job,
        make_alignment(job, sources, nominal, config, ball, initial=initial, tables=tables, output=output),
    )


def _check_together(config: AlignConfig, given: dict[str, Any]) -> None:
    """Refuse options that do nothing alone, or that contradict each other."""
    for name, option, partner, present in (
        ("temperature_c", "--temperature", "--expansion 7.1e-6", config.expansion_per_k != 0.0),
        ("expansion_per_k", "--expansion", "--temperature 23.5", config.temperature_c != REFERENCE_C),
        ("mpe", "--mpe", "--monte-carlo 1000", config.monte_carlo > 0),
        ("seed", "--seed", "--monte-carlo 1000", config.monte_carlo > 0),
        ("monte_carlo", "--monte-carlo", "--mpe '0.7+L/400'", config.mpe != ""),
        ("centre", "--centre", "--lock rz", config.lock != ""),
        ("lock_frame", "--lock-frame", "--lock rz", config.lock != ""),
    ):
        if name in given and not present:
            raise UsageError(f"{option} does nothing alone", expected=f"{partner} beside it")
    if config.scale == "free" and config.expansion_per_k != 0.0:
        raise UsageError("--scale free and --expansion", expected="one scale: fixed or free")
    if config.monte_carlo and config.criterion != "least-squares":
        raise UsageError(
            f"--monte-carlo and {config.criterion}",
            expected="least squares: leave --tolerance, --criterion out",
        )
    if config.mpe:
        try:
            parse_mpe(config.mpe)
        except UnitsError as error:
            raise UsageError(f"--mpe: {error.what}", expected=error.expected) from None


def _weights(config: AlignConfig, weights: str | None) -> tuple[AlignConfig, Path | None]:
    """Return how points are weighted, and the table of weights if that is a file."""
    if weights is None:
        return config, None
    if weights in ALIGN_CHOICES["weights"]:
        return replace(config, weights=weights), None
    if not Path(weights).is_file():
        raise UsageError(
            f"--weights {weights}: neither a table nor a way to weigh",
            expected="equal, sigma, area, stated, or a file with the columns id, weight",
        )
    return replace(config, weights="stated"), Path(weights)


def _tolerance(config: AlignConfig, tolerance: str | None) -> tuple[AlignConfig, Path | None]:
    """Return the limits of all deviations, or the table of limits if that is a file."""
    if tolerance is None:
        return config, None
    if config.criterion not in {"least-squares", "within-tolerance"}:
        raise UsageError(
            f"--tolerance and --criterion {config.criterion}", expected="one or the other: a tolerance is one"
        )
    config = replace(config, criterion="within-tolerance")
    words = tolerance.split(",")
    try:
        lengths = [parse_length_mm(word) * UM_PER_MM for word in words]
    except UnitsError:
        if Path(tolerance).is_file():
            return config, Path(tolerance)
        raise UsageError(
            f"--tolerance {tolerance!r} is neither a length nor a file",
            expected="5um, -2um,8um, or a table with the columns id, lower_um, upper_um",
        ) from None
    if len(words) == 2 and not any(character.isalpha() for character in tolerance):
        raise UsageError(
            f"--tolerance {tolerance!r}: a decimal comma, or two limits?",
            expected=f"{tolerance.replace(',', '.')}mm, or two limits with units: -2um,8um",
        )
    low, high = (-abs(lengths[0]), abs(lengths[0])) if len(lengths) == 1 else (lengths[0], lengths[-1])
    if len(lengths) > 2 or low >= high:
        raise UsageError(f"--tolerance {tolerance!r}", expected="a length, or LOW,HIGH with LOW below HIGH")
    return replace(config, tolerance_lower_um=low, tolerance_upper_um=high), None


def _limits(config: AlignConfig, limits: tuple[str, ...]) -> AlignConfig:
    """Return the limits of the motion that the best fit takes away."""
    for text in limits:
        name, _, value = text.partition("=")
        setting, unit = LIMITS.get(name.strip().lower(), ("", ""))
        try:
            limit = float(value.strip().removesuffix(unit)) if setting else 0.0
        except ValueError:
            limit = 0.0
        if not 0.0 < limit < float("inf"):
            known = ", ".join(f"{key}=VALUE in {word}" for key, (_, word) in LIMITS.items())
            raise UsageError(f"--limit {text!r}", expected=known)
        changes: dict[str, Any] = {setting: limit}
        config = replace(config, **changes)
    return config
