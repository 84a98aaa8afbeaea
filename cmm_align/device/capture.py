"""Capture: from a port, or the recording of one, to points.

The reader writes every byte to the journal before anything looks at it; the points are made from what it
hands on. A replay of the journal walks the same path and gives the same points, to the bit.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from cmm_align.device import clock as clocks
from cmm_align.device.address import REPLAY, replay_of, scheme_of
from cmm_align.device.ending import ORDERLY, EndReason
from cmm_align.device.intake import Intake, Watcher, take_in
from cmm_align.device.interruption import on_ctrl_c
from cmm_align.device.journal import JournalWriter
from cmm_align.device.line_errors import LineErrors
from cmm_align.device.link import Link, open_link, other_readers
from cmm_align.device.reader import Reader
from cmm_align.device.recordings import settings_of
from cmm_align.dialects import (
    SERIOUS_SEVERITY,
    MachineProfile,
    Note,
    Rejected,
    points_of,
    profile_of,
    suspicions,
)
from cmm_align.errors import DeviceError, MalformedInputError
from cmm_align.model import PointSet
from cmm_align.provenance import this_step

_NO_LINE: Final = 0
"""Of a note on something that is missing between lines."""

_PSEUDO: Final = "/dev/pts/"
"""Pseudo terminals, which whoever made them has open too."""


@dataclass(frozen=True, slots=True)
class Captured:
    """What a capture brought.

    Attributes
    ----------
    points : PointSet
        Frame of the machine, mm.
    rejected : tuple of Rejected
        Lines that should be points and are none.
    notes : tuple of Note
        Lines that are no points by design.
    end_reason : EndReason
    complete : bool
        Whether everything may be there.
    shortfalls : tuple of str
        Why not, a sentence each.
    n_bytes : int
    raw_log : Path or None
        Journal or recording that holds every byte.
    line_errors : LineErrors or None
        What the driver counted; None where nobody counts.
    other_readers : tuple of str
        Programs that had the port open at the same time.
    profile : MachineProfile
        As used.
    suspicions : tuple of str
        What in the bytes looks as if the profile were not right.
    """

    points: PointSet
    rejected: tuple[Rejected, ...]
    notes: tuple[Note, ...]
    end_reason: EndReason
    complete: bool
    shortfalls: tuple[str, ...]
    n_bytes: int
    raw_log: Path | None
    line_errors: LineErrors | None
    other_readers: tuple[str, ...]
    profile: MachineProfile
    suspicions: tuple[str, ...]


def capture_points(
    url: str,
    profile: MachineProfile | None = None,
    *,
    journal: Path | None = None,
    expect: int | None = None,
    ready: Callable[[Path | None], object] | None = None,
    watch: Watcher | None = None,
    clock: clocks.Clock = clocks.REAL,
) -> Captured:
    """Read points from a port, or from the recording of one, until they end.

    Parameters
    ----------
    url : str
        Device, or pySerial URL as ``socket://host:port`` or ``replay://file``.
    profile : MachineProfile, optional
        What the machine says and how. Without one, a journal's own; else the defaults.
    journal : Path, optional
        File for every byte as it comes, which is never overwritten: a free name beside it is taken.
        Not needed for a recording, which is one.
    expect : int, optional
        Number of points after which to stop; a journal's own where it is replayed.
    ready : callable, optional
        Called with the path of the journal once the port is open: now the dump may be started.
    watch : callable, optional
        Called with the progress after each arrival.
    clock : Clock
        For tests.

    Raises
    ------
    DeviceError
        If the port cannot be opened, or nothing comes.
    MalformedInputError
        If bytes came and no points, or a recording is damaged.
    OutputError
        If the journal cannot be written.
    KeyboardInterrupt
        If Ctrl-C is pressed before anything came, or twice.
    """
    recorded = _recorded(url)
    profile = profile or _profile_of(recorded, url) or MachineProfile()
    if expect is None:
        expect = _expected(recorded, url)
    with contextlib.ExitStack() as stack:
        link = open_link(url, profile, clock)
        stack.callback(link.close)
        writer: JournalWriter | None = None
        if journal is not None:
            writer = JournalWriter(journal, settings_for(url, profile, expect))
            stack.callback(writer.discard)
        raw_log = writer.path if writer else recording_of(url)
        others = () if url.startswith(_PSEUDO) else other_readers(url)
        if ready is not None:
            ready(raw_log)
        reader = Reader(link, writer, profile.max_bytes, clock)
        with on_ctrl_c(reader.interrupt), reader.reading() as arrivals:
            intake = take_in(arrivals, profile, expect=expect, watch=watch)
        captured = _captured(url, intake, profile, expect, raw_log, _errors_of(link), others)
        if writer is not None:
            writer.end(intake.time_s, _ending(captured))
    if not len(captured.points):
        raise _without_points(captured, intake, url)
    return captured


def settings_for(source: str, profile: MachineProfile, expect: int | None) -> dict[str, Any]:
    """Return what a journal must know to be replayed, as JSON knows it."""
    step = this_step("capture", {})
    return {
        "source": source,
        "version": step.version,
        "time_utc": step.time_utc,
        "expect": expect,
        "profile": asdict(profile),
    }


def recording_of(url: str) -> Path | None:
    """Return the recording that a URL serves, or None where it is live."""
    return replay_of(url).path if scheme_of(url) == REPLAY else None


def recorded_profile(url: str) -> MachineProfile | None:
    """Return the profile of the run that a recording holds; None where it holds none.

    Raises
    ------
    InputError
        If the recording cannot be read.
    """
    return _profile_of(_recorded(url), url)


def _profile_of(recorded: Mapping[str, Any], url: str) -> MachineProfile | None:
    table = recorded.get("profile")
    if table is None:
        return None
    if not isinstance(table, Mapping):
        raise MalformedInputError(f"profile = {table!r}", where=url, expected="a table of settings")
    return profile_of(table, where=url)


def _expected(recorded: Mapping[str, Any], url: str) -> int | None:
    expect = recorded.get("expect")
    if expect is not None and (type(expect) is not int or expect < 1):
        raise MalformedInputError(f"expect = {expect!r}", where=url, expected="a number of points")
    return expect


def _recorded(url: str) -> Mapping[str, Any]:
    """Return the settings that a recording brings with it."""
    path = recording_of(url)
    return {} if path is None else settings_of(path)


def _errors_of(link: Link) -> LineErrors | None:
    """Return what was counted on the line, now or when it was recorded."""
    if link.recording is None:
        return link.line_errors()
    table = (link.recording.end or {}).get("line_errors")
    if not isinstance(table, Mapping) or not set(table) >= set(LineErrors._fields):
        return None
    return LineErrors(*(int(table[name]) for name in LineErrors._fields))


def _captured(
    url: str,
    intake: Intake,
    profile: MachineProfile,
    expect: int | None,
    raw_log: Path | None,
    errors: LineErrors | None,
    others: tuple[str, ...],
) -> Captured:
    points, rejected, notes = points_of(intake.events, url, profile)
    missing = tuple(_shortfalls(intake, profile, expect, errors, notes))
    return Captured(
        points=points,
        rejected=rejected,
        notes=notes,
        end_reason=intake.ended.reason,
        complete=not missing,
        shortfalls=missing,
        n_bytes=intake.n_bytes,
        raw_log=raw_log,
        line_errors=errors,
        other_readers=others,
        profile=profile,
        suspicions=suspicions(intake.head, profile),
    )


def _shortfalls(
    intake: Intake,
    profile: MachineProfile,
    expect: int | None,
    errors: LineErrors | None,
    notes: tuple[Note, ...],
) -> Iterator[str]:
    """Give every reason for which points may be missing."""
    reason, detail = intake.ended
    if reason not in ORDERLY:
        yield f"{reason.replace('_', ' ')}: {detail}" if detail else reason.replace("_", " ")
    if intake.fragment:
        yield "it breaks off inside a line"
    if expect is not None and intake.n_points < expect:
        yield f"{intake.n_points} of {expect} points came"
    if profile.end_marker and reason not in {EndReason.MARKER, EndReason.COUNT}:
        yield f"the end marker {profile.end_marker!r} never came"
    yield from (note.what for note in notes if note.line == _NO_LINE)
    serious = [note for note in notes if note.severity is not None and note.severity >= SERIOUS_SEVERITY]
    if serious:
        more = f", and {len(serious) - 1} more" if len(serious) > 1 else ""
        yield f"the controller reported an error in line {serious[0].line}: {serious[0].what}{more}"
    if errors is not None and errors.happened():
        yield (
            f"the driver counted {errors.overrun + errors.buffer_overrun} lost bytes, {errors.parity} wrong "
            f"parities and {errors.framing} wrong stop bits: check baud, parity and flow control"
        )


def _ending(captured: Captured) -> dict[str, Any]:
    """Return what the last record of a journal says."""
    return {
        "end_reason": captured.end_reason.value,
        "complete": captured.complete,
        "n_points": len(captured.points),
        "n_rejected": len(captured.rejected),
        "line_errors": None if captured.line_errors is None else captured.line_errors._asdict(),
    }


def _without_points(captured: Captured, intake: Intake, url: str) -> BaseException:
    """Return what to raise where no point came."""
    where = str(captured.raw_log or url)
    if captured.n_bytes:
        text = f"no points in {captured.n_bytes} bytes"
        for line in captured.rejected[:1]:
            text += f"; line {line.line} is {line.text!r}: {line.why}"
        return MalformedInputError(
            text,
            where=where,
            expected=f"lines of dialect {captured.profile.dialect!r}",
            remedy="; ".join(captured.suspicions) or "give the profile of this machine",
        )
    if captured.end_reason is EndReason.INTERRUPTED:
        return KeyboardInterrupt()
    if captured.end_reason in {EndReason.END_OF_FILE, EndReason.CUT_OFF}:
        return MalformedInputError("the recording is empty", where=where)
    return DeviceError(f"nothing came ({intake.ended.detail})", where=url)
