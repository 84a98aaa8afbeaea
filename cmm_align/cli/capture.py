"""`cmm-align capture`: points from the controller's port, or from the recording of one."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from cmm_align.cli import capture_report as report
from cmm_align.cli import options
from cmm_align.cli.job import Job, Outcome, beside, typed
from cmm_align.cli.live_line import live_line
from cmm_align.cli.options import FILE
from cmm_align.errors import UsageError

if TYPE_CHECKING:
    from cmm_align.device.capture import Captured
    from cmm_align.dialects import MachineProfile

TEXT = """Read a point dump from PORT, or from a recording of one.

PORT is a device (/dev/ttyUSB0, COM3) or a pySerial URL (socket://host:port, rfc2217://host:port,
replay://file). The port is opened first; start the dump when told to. Every byte goes to a journal beside
the output before anything looks at it. Nothing is ever sent to the machine.
"""

JOURNAL_SUFFIX: Final = ".journal"
DEFAULT_NAME: Final = "capture.csv"

_DURATION: Final = re.compile(r"(\d+\.?\d*|\.\d+)\s*(ms|s|min|)")
_SECONDS_PER: Final = {"ms": 1e-3, "s": 1.0, "min": 60.0, "": 1.0}


class Duration(click.ParamType[float]):
    """A time above zero with a unit, handed on in s."""

    name = "duration"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return the time in s."""
        if isinstance(value, float):
            return value
        match = _DURATION.fullmatch(str(value).strip())
        seconds = float(match.group(1)) * _SECONDS_PER[match.group(2)] if match else 0.0
        if seconds <= 0.0:
            self.fail(f"{value!r} is not a time above zero, as 3s, 500ms or 2min", param, ctx)
        return seconds


@options.command("capture", TEXT)
@click.argument("port", required=False)
@click.option("--profile", type=FILE, metavar="FILE.toml", help="The machine: port, lines, points.")
@click.option("--expect", type=click.IntRange(min=1), metavar="N", help="Stop after N points.")
@click.option("--replay", type=FILE, metavar="FILE", help="A journal, dump or spy:// trace, not PORT.")
@click.option(
    "--tap",
    metavar="LISTEN=HOST:PORT",
    help="Listen to a client and its I++ DME server instead, as 1294=10.0.0.7:1294; passes all on unchanged.",
)
@click.option(
    "--idle-end",
    type=Duration(),
    metavar="T",
    help="The dump is over when nothing came for so long.  [default: as the profile says, 3s]",
)
@click.option("--strict", is_flag=True, help="Fail if a line that should be a point is none.")
@click.option(
    "-o",
    "--output",
    type=FILE,
    metavar="FILE",
    help="Output file.  [default: capture.csv here, <recording>.csv beside a recording]",
)
def command(
    job: Job,
    *,
    port: str | None,
    profile: Path | None,
    expect: int | None,
    replay: Path | None,
    tap: str | None,
    idle_end: float | None,
    strict: bool,
    output: Path | None,
) -> int:
    """Parse, call, show."""
    from cmm_align.cli.show import finish
    from cmm_align.device.address import replay_url

    if sum(source is not None for source in (port, replay, tap)) != 1:
        raise UsageError("one source is needed", expected="PORT, --replay FILE or --tap LISTEN=HOST:PORT")
    if replay is not None:
        port = replay_url(replay)
    machine = machine_of(job, port, profile, idle_end)
    if output is None:
        output = default_output(port)
    if tap is not None:
        port = tapped(job, tap, machine, output)
    made = make_capture(
        job, port or "", machine, output, expect=expect, strict=strict, just_made=tap is not None
    )
    return finish(job, made)


def make_capture(
    job: Job,
    url: str,
    profile: MachineProfile,
    output: Path,
    *,
    expect: int | None = None,
    strict: bool = False,
    just_made: bool = False,
) -> Outcome:
    """Capture points and write them.

    Parameters
    ----------
    job : Job
    url : str
        Device or URL.
    profile : MachineProfile
    output : Path
        Text of ours; the journal of a live run goes beside it.
    expect : int, optional
        Number of points after which to stop.
    strict : bool
        Whether a rejected line is a failure.
    just_made : bool
        Whether a recording was made by this run, and so is an output and no input.

    Raises
    ------
    DeviceError
        If the port cannot be opened, or nothing comes.
    MalformedInputError
        If no points came, or a line was rejected and `strict` is true.
    """
    import numpy as np

    from cmm_align import files
    from cmm_align.cli import record
    from cmm_align.device.capture import recording_of

    source = recording_of(url)
    live = source is None or just_made
    inputs = [] if source is None or live else [source]
    record.check_outputs(job, [output], inputs, stage_file=False)
    captured = read_port(job, url, profile, journal_beside(output), expect=expect)
    if strict:
        report.refuse_rejected(captured)
    steps = record.steps(job, inputs)
    points = captured.points
    numbered = not np.array_equal(points.ids, np.arange(len(points)))
    state = "complete" if captured.complete else "NOT COMPLETE"
    name = " ".join(profile.name.encode("ascii", "replace").decode("ascii").split())
    note = f"captured, profile {name}; ended: {captured.end_reason}; {state}"
    files.write_points(
        output,
        points,
        with_ids=numbered,
        notes=(note,),
        overwrite=job.overwrite,
    )
    journal = [captured.raw_log] if live and captured.raw_log is not None else []
    return Outcome(
        command=job.command,
        noun=captured,
        inputs=steps[-1].inputs,
        outputs=[output, *journal],
        result=report.result_of(captured, expect),
        rows=report.rows_of(captured, url),
        details=[("note", f"line {note.line}: {note.what}: {note.text}") for note in captured.notes],
        warnings=report.warnings_of(captured),
        next_command=typed("cmm-align", "align", output, "NOMINAL"),
        exit_code=report.exit_code_of(captured, live=live),
    )


def read_port(
    job: Job, url: str, profile: MachineProfile, journal: Path, *, expect: int | None = None
) -> Captured:
    """Capture points from a port, with a live line on a terminal; a recording needs no journal.

    Parameters
    ----------
    job : Job
    url : str
        Device or URL.
    profile : MachineProfile
    journal : Path
        A free name beside it is taken.
    expect : int, optional
        Number of points after which to stop.
    """
    from cmm_align.device.capture import capture_points, recording_of

    live = recording_of(url) is None

    def ready(path: Path | None) -> None:
        """Tell the operator to start."""
        if not live:
            return
        start = f" ({profile.start_command})" if profile.start_command else ""
        tell(job, f"{url} is open and every byte goes to {path}: start the dump now{start}; Ctrl-C ends it")

    with live_line(job, expect) as watch:
        return capture_points(
            url, profile, journal=journal if live else None, expect=expect, ready=ready, watch=watch
        )


def tapped(job: Job, text: str, profile: MachineProfile, output: Path) -> str:
    """Listen to a client and its server until one closes; return the URL of what was heard."""
    from cmm_align.cli import record
    from cmm_align.device.address import replay_url
    from cmm_align.device.tap import Endpoint, endpoints_of, tap
    from cmm_align.errors import DeviceError

    listen, server = endpoints_of(text)
    record.check_outputs(job, [output], [], stage_file=False)

    def ready(door: Endpoint, path: Path) -> None:
        """Tell the operator where to connect to."""
        tell(job, f"connect the client to {door.host}:{door.port} now; every byte goes to {path}")

    heard = tap(listen, server, journal_beside(output), profile, ready=ready)
    if not heard.complete:
        raise DeviceError(
            f"the journal is not complete: {heard.why}",
            where=str(heard.journal),
            remedy=f"what it holds can be had with --replay {heard.journal}",
        )
    return replay_url(heard.journal)


def machine_of(
    job: Job, url: str | None, profile: Path | None, idle_end_s: float | None = None
) -> MachineProfile:
    """Return the machine: the profile that was given, else the recording's own, else the defaults.

    Parameters
    ----------
    job : Job
    url : str or None
        Device or URL; None for a tap.
    profile : Path or None
    idle_end_s : float, optional
        In place of the profile's.

    Raises
    ------
    UsageError
        If the profile makes no sense, or ``--units`` contradict it.
    """
    from cmm_align.device.capture import recorded_profile, recording_of
    from cmm_align.dialects import MachineProfile, read_profile

    machine = None
    if profile is not None:
        machine = read_profile(profile)
    elif url is None:
        machine = MachineProfile(name="I++ DME", dialect="ipp")
    elif recording_of(url) is not None:
        machine = recorded_profile(url)
    if machine is None:
        machine = MachineProfile(units=job.units or "mm")
    elif job.units not in {None, machine.units}:
        raise UsageError(
            f"--units {job.units}, but the profile says {machine.units}", remedy="leave the option out"
        )
    return machine if idle_end_s is None else replace(machine, idle_end_s=idle_end_s)


def default_output(url: str | None) -> Path:
    """Return the output where none was named: beside a recording, or here."""
    from cmm_align.device.capture import recording_of

    source = None if url is None else recording_of(url)
    if source is None:
        return Path(DEFAULT_NAME)
    output = beside(source, ".csv")
    return beside(source, ".points.csv") if output == source else output


def journal_beside(output: Path) -> Path:
    """Return the name of the journal of an output."""
    journal = output.with_suffix(JOURNAL_SUFFIX)
    return output.with_name(output.name + JOURNAL_SUFFIX) if journal == output else journal


def tell(job: Job, text: str) -> None:
    """Say something to the operator while the machine waits."""
    if not job.quiet:
        click.echo(text, err=True)
