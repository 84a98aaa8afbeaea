"""The journal of a capture: every byte as it came, in a file that only grows.

The first line is ASCII: the magic, the version and the settings as JSON. Records follow, each of them::

    mark (4 bytes) | channel (1) | time, s (float64) | length (uint32) | CRC32 (uint32) | bytes

with all numbers little-endian and the CRC over channel, time, length and bytes. A record goes out in one
unbuffered write, so that the death of the process costs nothing that was read before, and is on the disk
(fsync) half a second later, so that a power cut costs no more than that. Whatever such an end leaves
behind the last whole record is recognised and dropped.
"""

from __future__ import annotations

import contextlib
import json
import os
import struct
import threading
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Final, NamedTuple

from cmm_align.errors import MalformedInputError, MissingFileError, OutputError

MAGIC: Final = b"cmm-align journal v"
VERSION: Final = 1
SYNC_S: Final = 0.5
"""Time between two syncs while bytes come in."""

RECEIVED: Final = b"R"
"""Channel of what the machine sent."""
FROM_CLIENT: Final = b"C"
"""Channel of what its client said, where a tap listened."""
END: Final = b"E"
"""Channel of the last record of a run that could end in order: JSON."""

_MARK: Final = b"\x1eREC"
_HEAD: Final = struct.Struct("<4scdII")
_SIGNED: Final = struct.Struct("<cdI")
_MOST_HEADER_BYTES: Final = 1 << 16
_MOST_NAMES: Final = 10_000
_NEW_FILE: Final = os.O_CREAT | os.O_EXCL | os.O_WRONLY | getattr(os, "O_BINARY", 0)


class Record(NamedTuple):
    """Bytes that came in one piece.

    Attributes
    ----------
    channel : bytes
        `RECEIVED` or `FROM_CLIENT`.
    time_s : float
        Seconds since the port was opened.
    data : bytes
    """

    channel: bytes
    time_s: float
    data: bytes


@dataclass(frozen=True, slots=True)
class Journal:
    """What a journal holds.

    Attributes
    ----------
    settings : Mapping
        Settings of the run.
    records : tuple of Record
        In the order in which they came.
    end : Mapping or None
        How the run ended; None if it was cut off.
    torn_bytes : int
        Bytes behind the last whole record.
    """

    settings: Mapping[str, Any]
    records: tuple[Record, ...]
    end: Mapping[str, Any] | None
    torn_bytes: int = 0


class JournalWriter:
    """An open journal: appends and syncs, and never rewrites. Several threads may append.

    Parameters
    ----------
    path : Path
        Name wished for; where a file is there already the next free one is taken: ``part.journal``,
        ``part.2.journal``, ...
    settings : Mapping
        Settings of the run, as JSON knows them.

    Raises
    ------
    OutputError
        If it cannot be made.
    """

    def __init__(self, path: Path, settings: Mapping[str, Any]) -> None:
        header = MAGIC + f"{VERSION} {json.dumps(settings)}\n".encode("ascii")
        self.path, self._descriptor = _exclusively_made(path)
        self._lock = threading.Lock()
        self._unsynced = True
        self._closing = threading.Event()
        self.n_bytes = 0
        try:
            self._write(header)
        except OutputError:
            os.close(self._descriptor)
            self.path.unlink(missing_ok=True)
            raise
        self._syncer = threading.Thread(target=self._keep_synced, name="journal", daemon=True)
        self._syncer.start()

    def append(self, channel: bytes, time_s: float, data: bytes) -> None:
        """Append a record.

        Parameters
        ----------
        channel : bytes
            `RECEIVED` or `FROM_CLIENT`.
        time_s : float
            Seconds since the port was opened.
        data : bytes

        Raises
        ------
        OutputError
            If the disk does not take it.
        """
        record = framed(channel, time_s, data)
        with self._lock:
            self._write(record)
            self._unsynced = True
            self.n_bytes += len(data)

    def end(self, time_s: float, how: Mapping[str, Any]) -> None:
        """Append the last record: how the run ended, as JSON knows it."""
        with self._lock:
            self._write(framed(END, time_s, json.dumps(how).encode("ascii")))
            self._unsynced = True

    def close(self) -> None:
        """Sync and close."""
        if self._closing.is_set():
            return
        self._closing.set()
        self._syncer.join()
        self._sync()
        os.close(self._descriptor)

    def discard(self) -> None:
        """Close, and remove a journal that holds no data."""
        self.close()
        if self.n_bytes == 0:
            self.path.unlink(missing_ok=True)

    def __enter__(self) -> JournalWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _write(self, data: bytes) -> None:
        try:
            written = os.write(self._descriptor, data)
            while written < len(data):  # a disk that is nearly full takes a part
                written += os.write(self._descriptor, data[written:])
        except OSError as error:
            raise OutputError(
                f"cannot write the journal ({error.strerror})",
                where=str(self.path),
                remedy=f"the {self.n_bytes} bytes before are safe in it; check the space of its folder",
            ) from error

    def _keep_synced(self) -> None:
        while not self._closing.wait(SYNC_S):
            self._sync()

    def _sync(self) -> None:
        if self._unsynced:
            self._unsynced = False
            with contextlib.suppress(OSError):  # some network drives refuse
                os.fsync(self._descriptor)


def framed(channel: bytes, time_s: float, data: bytes) -> bytes:
    """Return a record as it lies in the file."""
    checksum = zlib.crc32(data, zlib.crc32(_SIGNED.pack(channel, time_s, len(data))))
    return _HEAD.pack(_MARK, channel, time_s, len(data), checksum) + data


def is_journal(head: bytes) -> bool:
    """Return whether the first bytes of a file are those of a journal."""
    return head.startswith(MAGIC)


def read_journal(path: Path | str) -> Journal:
    """Return what a journal holds.

    Raises
    ------
    MissingFileError
        If it cannot be opened.
    MalformedInputError
        If it is no journal, of a newer version, or damaged before its last record.
    """
    raw = _bytes_of(path)
    settings, start = _header(raw, str(path))
    records: list[Record] = []
    end: Mapping[str, Any] | None = None
    stop = start
    for record, behind in _whole_records(raw, start):
        stop = behind
        if record.channel == END:
            end = _json(record.data, f"{path}: byte {stop}")
        else:
            records.append(record)
    _refuse_damage(raw, stop, str(path))
    return Journal(settings, tuple(records), end, len(raw) - stop)


def read_settings(path: Path | str) -> Mapping[str, Any]:
    """Return the settings in a journal, without its records.

    Raises
    ------
    MissingFileError
        If it cannot be opened.
    MalformedInputError
        If it is no journal, or of a newer version.
    """
    return _header(_bytes_of(path, _MOST_HEADER_BYTES), str(path))[0]


def _bytes_of(path: Path | str, most: int = -1) -> bytes:
    try:
        with Path(path).open("rb") as stream:
            return stream.read(most)
    except OSError as error:
        raise MissingFileError(f"cannot read it ({error.strerror})", where=str(path)) from None


def _exclusively_made(path: Path) -> tuple[Path, int]:
    for number in range(1, _MOST_NAMES):
        name = path if number == 1 else path.with_name(f"{path.stem}.{number}{path.suffix}")
        try:
            return name, os.open(name, _NEW_FILE, 0o666)
        except FileExistsError:
            continue
        except OSError as error:
            raise OutputError(
                f"cannot make the journal ({error.strerror})",
                where=str(name),
                remedy="check the rights and the space of its folder",
            ) from None
    raise OutputError("too many journals of this name", where=str(path), remedy="choose another -o")


def _header(raw: bytes, where: str) -> tuple[Mapping[str, Any], int]:
    line, found, _ = raw[:_MOST_HEADER_BYTES].partition(b"\n")
    version, _, text = line[len(MAGIC) :].partition(b" ")
    if not is_journal(line) or not found or not version.isdigit():
        raise MalformedInputError("no journal of a capture", where=where)
    if int(version) > VERSION:
        raise MalformedInputError(
            f"a journal of version {int(version)}",
            where=where,
            expected=f"at most {VERSION}",
            remedy="read it with the version of cmm-align that wrote it, or a newer one",
        )
    return _json(text, f"{where}:1"), len(line) + 1


def _json(text: bytes, where: str) -> Mapping[str, Any]:
    try:
        table = json.loads(text)
    except ValueError:
        table = None
    if not isinstance(table, dict):
        raise MalformedInputError("the settings are damaged", where=where, expected="JSON")
    return table


def _record_at(raw: bytes, start: int) -> tuple[Record, int] | None:
    """Return the whole record at a place and the place behind it, or None if there is none."""
    body = start + _HEAD.size
    if body > len(raw):
        return None
    mark, channel, time_s, length, checksum = _HEAD.unpack_from(raw, start)
    data = raw[body : body + length]
    if mark != _MARK or len(data) < length:
        return None
    if zlib.crc32(data, zlib.crc32(_SIGNED.pack(channel, time_s, length))) != checksum:
        return None
    return Record(channel, time_s, data), body + length


def _whole_records(raw: bytes, start: int) -> Iterator[tuple[Record, int]]:
    found = _record_at(raw, start)
    while found is not None:
        yield found
        found = _record_at(raw, found[1])


def _refuse_damage(raw: bytes, stop: int, where: str) -> None:
    """Refuse a journal in which a whole record lies behind bytes that are none.

    A hole joins what does not belong together, and two halves of two lines can make a point that never was.
    """
    place = raw.find(_MARK, stop)
    while place >= 0:
        if _record_at(raw, place) is not None:
            raise MalformedInputError(
                f"{place - stop} bytes are damaged, with whole records behind them",
                where=f"{where}: byte {stop}",
                expected="records without a gap",
                remedy="take it from a copy, or measure again",
            )
        place = raw.find(_MARK, place + 1)
