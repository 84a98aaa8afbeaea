"""`replay://`: a recording in the place of a port, so that live and recorded runs share one path.

``replay://FILE?speed=1&chunk=7&faults=drop:3,flip:1&seed=5`` serves journals, plain dumps and traces of
``spy://``: at once, or in their own time if a speed is given (that of the baud rate for a plain dump).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

from serial import SerialException
from serial.serialutil import SerialBase

from cmm_align.device import clock as clocks
from cmm_align.device.address import replay_of
from cmm_align.device.faults import Chunk, faulty
from cmm_align.device.recordings import CHUNK_BYTES, Recording, read_recording

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

SERVED_AT_ONCE: Final = CHUNK_BYTES


class ReplayPort(SerialBase):
    """A port that says what was recorded, and hears nothing.

    Attributes
    ----------
    clock : Clock
        Set before opening; the computer's own otherwise.
    recording : Recording or None
        What it serves, once it is open.
    """

    clock = clocks.REAL
    recording: Recording | None = None

    def open(self) -> None:
        """Read the recording and start to serve it.

        Raises
        ------
        UsageError
            If the URL says something that it cannot.
        InputError
            If the recording cannot be read.
        """
        replay = replay_of(self.port or "")
        self.recording = read_recording(replay.path, float(self.baudrate))
        chunks: Sequence[Chunk]
        chunks, self._breaks = faulty(self.recording.chunks, replay.faults, replay.seed)
        if not replay.speed and not replay.faults.split:
            chunks = _joined(chunks)
        self._chunks = _cut(chunks, replay.chunk)[::-1]  # the next one is the last
        self._speed = replay.speed
        self._began_s = self.clock.now()
        self.is_open = True

    @property
    def finished(self) -> bool:
        """Whether everything has been served."""
        return not self._chunks and not self._breaks

    @property
    def in_waiting(self) -> int:
        """Number of bytes that are there now."""
        return len(self._chunks[-1].data) if self._chunks and self._left_s() <= 0.0 else 0

    def read(self, size: int = 1, /) -> bytes:
        """Return up to so many bytes that came together; none if nothing comes within the timeout.

        Raises
        ------
        SerialException
            If the line breaks here.
        """
        if not self._chunks:
            if self._breaks:
                raise SerialException("the line broke, as the faults of the replay asked for")
            return b""
        left_s = self._left_s()
        if left_s > 0.0:
            patience_s = left_s if self.timeout is None else min(left_s, self.timeout)
            self.clock.sleep(patience_s)
            if patience_s < left_s:
                return b""
        time_s, data = self._chunks.pop()
        if len(data) > size:
            self._chunks.append(Chunk(time_s, data[size:]))
        return data[:size]

    def write(self, b: ReadableBuffer, /) -> int:
        """Refuse: nothing is ever sent.

        Raises
        ------
        SerialException
            Always.
        """
        raise SerialException("a recording hears nothing")

    def close(self) -> None:
        """Close it."""
        self.is_open = False

    def _left_s(self) -> float:
        """Return the time until the next chunk is due; at once there is none."""
        if not self._speed:
            return 0.0
        return self._chunks[-1].time_s / self._speed - (self.clock.now() - self._began_s)

    def _reconfigure_port(self) -> None:
        """Do nothing: there is no line to set up."""


def _joined(chunks: Sequence[Chunk]) -> list[Chunk]:
    """Return chunks joined to large ones: at once, their times mean nothing."""
    joined: list[Chunk] = []
    pieces: list[bytes] = []
    length = 0
    for time_s, data in chunks:
        pieces.append(data)
        length += len(data)
        if length >= SERVED_AT_ONCE:
            joined.append(Chunk(time_s, b"".join(pieces)))
            pieces, length = [], 0
    if pieces:
        joined.append(Chunk(chunks[-1].time_s, b"".join(pieces)))
    return joined


def _cut(chunks: Sequence[Chunk], longest: int) -> list[Chunk]:
    """Return chunks of at most so many bytes; 0 leaves them as they are."""
    if not longest:
        return list(chunks)
    return [
        Chunk(time_s, data[start : start + longest])
        for time_s, data in chunks
        for start in range(0, len(data), longest)
    ]
