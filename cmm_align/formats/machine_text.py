"""What a machine sent, as a file: the dialects of the port, read with the same eyes."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from cmm_align.dialects import (
    SERIOUS_SEVERITY,
    Dialect,
    Event,
    MachineProfile,
    Note,
    Rejected,
    points_of,
)
from cmm_align.errors import MalformedInputError
from cmm_align.formats.decoding import decoded
from cmm_align.formats.source import Source, told
from cmm_align.formats.statements import cut_off, no_points
from cmm_align.model import PointSet

_ANY_QUALITY: Final = 100.0


def read_dialect(source: Source, dialect: Dialect, profile: MachineProfile, expected: str) -> PointSet:
    """Return the points of a file of machine lines.

    Parameters
    ----------
    source : Source
    dialect : Dialect
    profile : MachineProfile
        What the machine is known or taken to be.
    expected : str
        In words, what lines the file should have.

    Raises
    ------
    MalformedInputError
        At the first line that should be a point and is none, with its line and column; if the last line has
        no end; if there are no points.

    Notes
    -----
    Lines that are no points by design, such as events and replies, are passed over. Points that the machine
    itself calls bad (column q) are left out, unless something else is wrong with them; they and serious
    errors of the controller are told in `passed_over`.
    """
    where = source.where
    *lines, rest = decoded(source.raw, where).split("\n")
    texts = [line.encode() for line in lines]
    events = _events(texts, dialect, profile)
    if refused := _refused(texts, events, dialect, profile):
        first = refused[0]
        more = f" (and {len(refused) - 1} lines more)" if len(refused) > 1 else ""
        raise MalformedInputError(
            f"{first.text!r}: {first.why}{more}",
            where=f"{where}:{first.line}:{first.column}",
            expected=expected,
        )
    if rest.strip():
        raise cut_off(where, len(lines) + 1, "an end of line after the last point")
    points = points_of(events, where, profile)[0]
    if not len(points):
        raise no_points(where, expected)
    return replace(points, passed_over=told(where, _left_out(events)))


def _left_out(events: list[Event]) -> list[tuple[int, str, str]]:
    """Return the points of bad quality, and the serious errors of the controller."""
    rows = []
    for event in events:
        if isinstance(event, Rejected):
            rows.append((event.line, event.text, event.why))
        elif isinstance(event, Note) and (event.severity or 0) >= SERIOUS_SEVERITY:
            rows.append((event.line, event.text, event.what))
    return rows


def _refused(
    lines: list[bytes], events: list[Event], dialect: Dialect, profile: MachineProfile
) -> list[Rejected]:
    """Return what was rejected for more than its quality."""
    if any(isinstance(event, Rejected) for event in events):
        events = _events(lines, dialect, replace(profile, worst_quality=_ANY_QUALITY))
    return [event for event in events if isinstance(event, Rejected)]


def _events(lines: list[bytes], dialect: Dialect, profile: MachineProfile) -> list[Event]:
    state = dialect.begin(profile)
    events: list[Event] = []
    for line in lines:
        state, found = dialect.step(state, line)
        events += found
    return [*events, *dialect.end(state)]
