"""Points in I++ DME traffic: responses of a server, alone or together with the commands of its client.

A data line belongs to the command with its tag. Where the commands were recorded as well, only data of
measuring commands are points, and `OnScanReport` says what a scan puts on a line; where they were not,
any data with the names X, Y and Z are points, and bare numbers are scans of the profile's columns. Lines
of events (tags E0000 to E9999) never are. A transaction that stays open at the end, or measured and gave
nothing, is rejected, since its points are missing.

TCP protects the bytes; what remains are a recording that lost whole lines, which the transactions show,
and values in another order than stated, which the checks of quality and direction show.
"""

from __future__ import annotations

import re
from typing import Final, NamedTuple, TypeAlias

from cmm_align.dialects.events import Dialect, Event, Hit, Note, Rejected
from cmm_align.dialects.ipp_grammar import (
    Command,
    Response,
    command_of,
    failure_of,
    named_numbers,
    reported_columns,
    response_of,
    unrecorded,
)
from cmm_align.dialects.ipp_points import Found, Reading, named_point, reading_of, scanned_points
from cmm_align.dialects.line import BLANKS, Fault, passed_over, rejected, shown
from cmm_align.dialects.profile import DEFAULT_COLUMNS, MachineProfile

_MEASURING: Final = ("PtMeas", "Scan")
_COORDINATES: Final = (b"X", b"Y", b"Z")
_DECIMALS: Final = re.compile(rb"\d\.\d")
_MOST_OPEN: Final = 64


class Transaction(NamedTuple):
    """A command that is not complete yet."""

    tag: bytes
    line: int
    name: str = ""
    """Empty where the command itself was not recorded."""
    arguments: str = ""
    has_data: bool = False
    failed: bool = False

    @property
    def may_measure(self) -> bool:
        """Whether its data may be points."""
        return not self.name or self.name.startswith(_MEASURING)


class Session(NamedTuple):
    """What changes seldom."""

    profile: MachineProfile
    commands_seen: bool = False
    coordinate_system: str = ""
    spoilt: str = ""
    """Why no later line can give a point of the same set."""


class IppState(NamedTuple):
    """What is known after some lines."""

    session: Session
    reading: Reading
    """How points are read and which tip took them."""
    line: int = 0
    hits: int = 0
    open: tuple[Transaction, ...] = ()


_Stepped: TypeAlias = tuple[IppState, tuple[Event, ...]]


def begin(profile: MachineProfile) -> IppState:
    """Return the state before the first line."""
    return IppState(Session(profile), reading_of(profile))


def step(state: IppState, raw: bytes) -> tuple[IppState, tuple[Event, ...]]:
    """Return the state after one more line, and the points in it or what it is instead."""
    session, reading, line, hits, transactions = state
    state = IppState(session, reading, line + 1, hits, transactions)
    response = response_of(raw.rstrip(BLANKS))
    if response is not None:
        return _ANSWERS[response.marker](state, response, raw)
    text, start = unrecorded(raw)
    response = response_of(text, start)
    if response is not None:
        return _ANSWERS[response.marker](state, response, raw)
    command = command_of(text)
    if command is not None:
        return _commanded(state, command, raw)
    if not text.strip():
        return state, ()
    note = passed_over(session.profile, text.strip(BLANKS), state.line, before_points=hits == 0)
    fault = Fault(start, "neither a command nor a response of I++ DME")
    return state, (note or rejected(state.line, raw, fault),)


def end(state: IppState) -> tuple[Event, ...]:
    """Return the transactions that were never completed, as far as points may be missing in them."""
    why = "not complete at the end of the stream: points may be missing"
    return tuple(
        Rejected(one.line, 1, f"{one.tag.decode('ascii')} {one.name}".strip(), why)
        for one in state.open
        if one.may_measure
    )


def _commanded(state: IppState, command: Command, raw: bytes) -> _Stepped:
    state = state._replace(session=state.session._replace(commands_seen=True))
    if command.tag.startswith(b"E"):  # starts a daemon: its data are events
        return state, ()
    transaction = Transaction(command.tag, state.line, command.name, command.arguments)
    transactions = (*_without(state.open, command.tag), transaction)[-_MOST_OPEN:]
    notes: tuple[Note, ...] = ()
    if command.name == "SetCoordSystem":
        notes = (Note(state.line, shown(raw), f"coordinate system {command.arguments.strip()}"),)
    return state._replace(open=transactions), notes


def _acknowledged(state: IppState, response: Response, raw: bytes) -> _Stepped:
    del raw
    session, reading, line, hits, transactions = state
    if response.tag.startswith(b"E") or _of(transactions, response.tag) is not None:
        return state, ()
    opened = (*transactions, Transaction(response.tag, line))[-_MOST_OPEN:]
    return IppState(session, reading, line, hits, opened), ()


def _completed(state: IppState, response: Response, raw: bytes) -> _Stepped:
    session, reading, line, hits, transactions = state
    done = _of(transactions, response.tag)
    if done is None:
        return state, ()
    state = IppState(session, reading, line, hits, _without(transactions, done.tag))
    if done.failed or not done.name:
        return state, ()
    if done.name.startswith(_MEASURING) and not done.has_data:
        fault = Fault(0, f"{done.name} is complete without a point: a line is lost")
        return state, (rejected(line, raw, fault),)
    if done.name == "EndSession":
        return state, (Note(line, shown(raw), "end of the session", ends=True),)
    return _settled(state, done), ()


def _settled(state: IppState, done: Transaction) -> IppState:
    """Return the state after a command that changed what later data mean."""
    session = state.session
    if done.name == "SetCoordSystem":
        system = done.arguments.strip()
        moved = state.hits > 0 and system != session.coordinate_system
        spoilt = f"the coordinate system became {system} after the first point" if moved else session.spoilt
        return state._replace(session=session._replace(coordinate_system=system, spoilt=spoilt))
    if session.profile.columns or done.name not in {"OnScanReport", "StartSession"}:
        return state  # the operator's word on columns holds: some servers sort them
    starts = done.name == "StartSession"
    columns = tuple(DEFAULT_COLUMNS["ipp"].split(",")) if starts else reported_columns(done.arguments)
    return state._replace(reading=state.reading.reporting(columns))


def _failed(state: IppState, response: Response, raw: bytes) -> _Stepped:
    failure = failure_of(response.body)
    if failure is None:
        return state, (
            rejected(state.line, raw, Fault(response.offset, "an error of the server that cannot be read")),
        )
    what = f"error {failure.code} of severity {failure.severity}: {failure.text} ({failure.method})"
    transactions = tuple(one._replace(failed=True) if one.tag == response.tag else one for one in state.open)
    note = Note(state.line, shown(raw), what, severity=failure.severity)
    return state._replace(open=transactions), (note,)


def _data(state: IppState, response: Response, raw: bytes) -> _Stepped:
    session, reading, line, hits, transactions = state
    if response.tag.startswith(b"E"):
        return state, (Note(line, shown(raw), "event"),)
    transaction = _of(transactions, response.tag)
    if transaction is None and session.commands_seen:
        fault = Fault(0, f"no command with the tag {response.tag.decode('ascii')} is open")
        return state, (rejected(line, raw, fault),)
    if transaction is not None and not transaction.may_measure:
        return state, (Note(line, shown(raw), f"data of {transaction.name}, no point"),)
    if transaction is not None and not transaction.has_data:
        counted = transaction._replace(has_data=True)
        transactions = tuple(counted if one is transaction else one for one in transactions)
    known = transaction is not None and bool(transaction.name)
    read = _points_in(reading, response.body, measured=known)
    if read is None:
        return IppState(session, reading, line, hits, transactions), (
            Note(line, shown(raw), "data, no point"),
        )
    reading, found = read
    if session.spoilt:
        found = (Fault(0, session.spoilt),)
    events = tuple([_event(line, raw, response.offset, one) for one in found])
    hits += sum([isinstance(event, Hit) for event in events])
    return IppState(session, reading, line, hits, transactions), events


def _event(line: int, raw: bytes, offset: int, found: Found) -> Event:
    """Return what was found in the body of a response as an event of its line."""
    if isinstance(found, Fault):
        return rejected(line, raw, Fault(offset + found.offset, found.why))
    return Note(line, shown(raw), found) if isinstance(found, str) else found


def _points_in(reading: Reading, body: bytes, *, measured: bool) -> tuple[Reading, tuple[Found, ...]] | None:
    """Return the points in the data of a command, None if they are about something else.

    `measured`: the command is known, and measures; then there must be points.
    """
    start = body.lstrip()[:1]
    if start.isalpha():
        values = named_numbers(body)
        if not measured and not _names_a_point(values, body):
            return None
        return (reading, (values,)) if isinstance(values, Fault) else named_point(reading, values, body)
    return None if start == b'"' and not measured else scanned_points(reading, body)


def _names_a_point(values: dict[bytes, tuple[float, ...]] | Fault, body: bytes) -> bool:
    """Return whether data of an unknown command are a point, or the ruins of one."""
    if isinstance(values, Fault):
        return len(_DECIMALS.findall(body)) >= 3 or any(name + b"(" in body for name in _COORDINATES)
    return any(name in values for name in _COORDINATES)


def _of(transactions: tuple[Transaction, ...], tag: bytes) -> Transaction | None:
    for one in transactions:
        if one.tag == tag:
            return one
    return None


def _without(transactions: tuple[Transaction, ...], tag: bytes) -> tuple[Transaction, ...]:
    return tuple([one for one in transactions if one.tag != tag])


_ANSWERS: Final = {b"&": _acknowledged, b"%": _completed, b"#": _data, b"!": _failed}

IPP: Final = Dialect("ipp", begin, step, end)
