"""Recordings of a line: journals of ours, traces of pySerial's ``spy://``, and plain dumps.

All become the same thing, chunks with their times. Content decides which is which.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

from cmm_align.device.faults import Chunk
from cmm_align.device.journal import FROM_CLIENT, RECEIVED, Record, is_journal, read_journal, read_settings
from cmm_align.errors import MalformedInputError, MissingFileError

CHUNK_BYTES: Final = 1 << 16
BITS_PER_BYTE: Final = 10.0
"""On the line: a start bit, eight bits of data or seven and parity, a stop bit."""

_HEAD_BYTES: Final = 4096
_SPY_LINE: Final = re.compile(rb"(?:\x1b\[\d+m)?(\d{6,}\.\d{3}) ([A-Z][A-Z-]+) +(.*)", re.DOTALL)
_SPY_ROW: Final = re.compile(rb"[0-9A-F]{4,}  (.{49})", re.DOTALL)
"""Offset, then up to sixteen bytes in 49 columns, then the same as text."""


class Recording(NamedTuple):
    """What a line once said.

    Attributes
    ----------
    chunks : tuple of Chunk
    settings : Mapping
        Of the run that recorded it; empty where nobody wrote them down.
    end : Mapping or None
        How that run ended, where it is written down.
    kind : str
        journal, spy or dump.
    torn_bytes : int
        Bytes behind the last whole record of a journal.
    """

    chunks: tuple[Chunk, ...]
    settings: Mapping[str, Any]
    end: Mapping[str, Any] | None
    kind: str
    torn_bytes: int = 0


def read_recording(path: Path, baud: float) -> Recording:
    """Return a recording.

    Parameters
    ----------
    path : Path
    baud : float
        Bits per second that a plain dump would take, for its timing.

    Raises
    ------
    MissingFileError
        If it cannot be opened.
    MalformedInputError
        If a journal or a trace is damaged.
    """
    raw = _bytes_of(path)
    if is_journal(raw[:_HEAD_BYTES]):
        journal = read_journal(path)
        chunks = tuple(_as_heard(journal.records))
        return Recording(chunks, journal.settings, journal.end, "journal", journal.torn_bytes)
    if _SPY_LINE.match(raw[:_HEAD_BYTES]):
        return Recording(tuple(_spied(raw, str(path))), {}, None, "spy")
    pieces = range(0, len(raw), CHUNK_BYTES)
    seconds_per_byte = BITS_PER_BYTE / baud
    dump = tuple(
        Chunk(min(at + CHUNK_BYTES, len(raw)) * seconds_per_byte, raw[at : at + CHUNK_BYTES]) for at in pieces
    )
    return Recording(dump, {}, None, "dump")


def settings_of(path: Path) -> Mapping[str, Any]:
    """Return the settings of the run that a journal recorded; empty for any other file.

    Raises
    ------
    MissingFileError
        If it cannot be opened.
    MalformedInputError
        If it is a journal whose settings are damaged.
    """
    return read_settings(path) if is_journal_file(path) else {}


def is_journal_file(path: Path) -> bool:
    """Return whether a file is a journal of a capture.

    Raises
    ------
    MissingFileError
        If it cannot be opened.
    """
    try:
        with path.open("rb") as stream:
            return is_journal(stream.read(_HEAD_BYTES))
    except OSError as error:
        raise MissingFileError(f"cannot read it ({error.strerror})", where=str(path)) from None


def _bytes_of(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise MissingFileError(f"cannot read it ({error.strerror})", where=str(path)) from None


def _as_heard(records: Sequence[Record]) -> Iterator[Chunk]:
    """Give what came down the line; where a tap heard two sides, their whole lines take turns."""
    if not any(record.channel == FROM_CLIENT for record in records):
        yield from (Chunk(record.time_s, record.data) for record in records)
        return
    pending = {RECEIVED: b"", FROM_CLIENT: b""}
    last_s = 0.0
    for channel, time_s, data in records:
        whole, end, rest = (pending[channel] + data).rpartition(b"\n")
        pending[channel] = rest
        last_s = time_s
        if end:
            yield Chunk(time_s, whole + end)
    if pending[RECEIVED]:
        yield Chunk(last_s, pending[RECEIVED])


def _spied(raw: bytes, where: str) -> Iterator[Chunk]:
    """Give the received bytes of a trace; its last line may be torn."""
    *lines, _torn = raw.split(b"\n")
    for number, line in enumerate(lines, 1):
        match = _SPY_LINE.match(line)
        row = _SPY_ROW.match(match.group(3)) if match and match.group(2) == b"RX" else None
        if match is None or row is None:
            continue
        try:
            data = bytes.fromhex(row.group(1).decode("ascii"))
        except ValueError:
            raise MalformedInputError(
                f"{row.group(1).strip()!r} in a trace of spy://",
                where=f"{where}:{number}",
                expected="bytes as pairs of hexadecimal digits",
            ) from None
        yield Chunk(float(match.group(1)), data)
