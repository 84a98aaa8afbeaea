"""Where measured points come from: files, recordings, or the machine itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from cmm_align.cli.job import Job, beside
from cmm_align.errors import DeviceError, UsageError, WrongStageError

if TYPE_CHECKING:
    from cmm_align.dialects import MachineProfile
    from cmm_align.model import PointSet


MOST_TOLD: Final = 5
"""Rows left out that are told one by one."""


@dataclass(frozen=True, slots=True)
class Sources:
    """What the command line says of the measurement.

    Attributes
    ----------
    names : tuple of str
        Files of one clamping, or one port: a device, or a URL of pySerial.
    profile : Path or None
        The machine at the port.
    expect : int or None
        Points that it will send.
    contact : bool
        Whether the user says that they are contact points.
    decimal, columns : str or None
        Of a text that can be read in two ways.
    strict : bool
        Whether a row that would be left out is an error instead.
    """

    names: tuple[str, ...]
    profile: Path | None = None
    expect: int | None = None
    contact: bool = False
    decimal: str | None = None
    columns: str | None = None
    strict: bool = False


@dataclass(frozen=True, slots=True)
class Measured:
    """Points with where they came from.

    Attributes
    ----------
    points : PointSet
    paths : tuple of Path
        Files and recordings behind them.
    tip_radius_mm : float
        What the machine's profile says of the tip; 0 for nothing.
    warnings : tuple of str
    """

    points: PointSet
    paths: tuple[Path, ...]
    tip_radius_mm: float = 0.0
    warnings: tuple[str, ...] = ()
    renumbered: bool = False
    """Whether files shared ids, so that all points were numbered anew."""


def port_of(sources: Sources) -> str | None:
    """Return the port or recording among the sources; None if they are files of points.

    Raises
    ------
    UsageError
        If there is something beside a port, or a profile without one.
    """
    from cmm_align.device.address import is_port, replay_url
    from cmm_align.device.recordings import is_journal_file

    twice = {name for name in sources.names if sources.names.count(name) > 1}
    if twice:
        raise UsageError(f"{min(twice)} is given twice", expected="each file once")
    ports = []
    for name in sources.names:
        if is_port(name):
            ports.append(name)
        elif Path(name).is_file() and is_journal_file(Path(name)):
            ports.append(replay_url(name))
    if ports and len(sources.names) > 1:
        raise UsageError(
            f"{ports[0]} beside other sources",
            expected="one port alone, or files",
            remedy="capture it first: cmm-align capture",
        )
    if not ports and (sources.profile is not None or sources.expect is not None):
        raise UsageError("--profile and --expect are for a port", expected="a device or a URL as MEASURED")
    return ports[0] if ports else None


def default_output(sources: Sources, port: str | None) -> Path:
    """Return where an alignment goes if nothing was said: beside the first file, or here."""
    if port is None:
        return beside(Path(sources.names[0]), ".align.h5")
    from cmm_align.device.capture import recording_of

    source = recording_of(port)
    return Path("capture.align.h5") if source is None else beside(source, ".align.h5")


def read_measured(job: Job, sources: Sources, port: str | None, output: Path) -> Measured:
    """Return the points of one clamping.

    Parameters
    ----------
    job : Job
    sources : Sources
    port : str or None
        From `port_of`.
    output : Path
        The journal of a port goes beside it.

    Raises
    ------
    InputError
        If a file is missing or malformed, or the points are of different kinds.
    DeviceError
        If the port cannot be opened, nothing comes, or the capture is not complete.
    """
    import numpy as np

    from cmm_align import files
    from cmm_align.formats import Hints

    hints = Hints(sources.decimal, sources.columns, sources.strict)
    if port is not None:
        return _captured(job, sources, port, output)
    sets = [files.read_measured(name, job.units, hints) for name in sources.names]
    points = _together(sets, contact=sources.contact)
    anew = len(sets) > 1 and not np.array_equal(points.ids, np.concatenate([one.ids for one in sets]))
    told = ("the files share ids: all points were numbered anew, from 0, in the order of the files",)
    own = anew and any(not np.array_equal(one.ids, np.arange(len(one))) for one in sets)
    paths = tuple(Path(name) for name in sources.names)
    notes = (*(told if own else ()), *_left_out(points.passed_over))
    return Measured(points, paths, warnings=notes, renumbered=anew)


def _left_out(passed_over: tuple[str, ...]) -> tuple[str, ...]:
    """Return what is told of rows that were left out: the first of them."""
    if len(passed_over) <= MOST_TOLD:
        return passed_over
    return (
        *passed_over[:MOST_TOLD],
        f"... and {len(passed_over) - MOST_TOLD} more left out; --strict refuses",
    )


def _captured(job: Job, sources: Sources, port: str, output: Path) -> Measured:
    """Capture points from a port or a recording; refuse half of them."""
    from cmm_align.cli import capture, capture_report

    machine: MachineProfile = capture.machine_of(job, port, sources.profile)
    taken = capture.read_port(job, port, machine, capture.journal_beside(output), expect=sources.expect)
    if sources.strict:
        capture_report.refuse_rejected(taken)
    if not taken.complete:
        raise DeviceError(
            f"the capture is not complete: {'; '.join(taken.shortfalls)}",
            where=port,
            remedy=f"what came is in {taken.raw_log}; cmm-align capture --replay takes it all the same",
        )
    points = _together([taken.points], contact=sources.contact)
    paths = () if taken.raw_log is None else (Path(taken.raw_log),)
    return Measured(points, paths, machine.tip_radius_mm, tuple(capture_report.warnings_of(taken)))


def _together(sets: Sequence[PointSet], *, contact: bool) -> PointSet:
    """Return point sets of one clamping as one.

    Raises
    ------
    WrongStageError
        If they are of different kinds or frames, or not what the user says.
    """
    from cmm_align.model import PointKind, joined

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
    return joined(sets)
