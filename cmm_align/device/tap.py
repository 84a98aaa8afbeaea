"""A tap on a TCP line between a client and a server, as I++ DME has it: it listens, and says nothing.

Every byte is written to a journal and passed on unchanged, in both directions. The tap has no words of its
own. If the journal fails or is full, it goes on passing bytes: a machine must not stop for a listener.
"""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

from cmm_align.device import clock as clocks
from cmm_align.device.capture import settings_for
from cmm_align.device.ending import EndReason
from cmm_align.device.interruption import on_ctrl_c
from cmm_align.device.journal import FROM_CLIENT, RECEIVED, JournalWriter
from cmm_align.dialects import MachineProfile
from cmm_align.errors import DeviceError, OutputError, UsageError

BLOCK_BYTES: Final = 1 << 16
CONNECT_S: Final = 5.0
POLL_S: Final = 0.1
GRACE_S: Final = 2.0
"""Time for the last words of one side when the other has closed."""
MOST_PORT: Final = 65535


class Endpoint(NamedTuple):
    """Host and port of one end."""

    host: str
    port: int


@dataclass(frozen=True, slots=True)
class Tapped:
    """What a tap heard.

    Attributes
    ----------
    journal : Path
    n_from_client, n_from_server : int
        Bytes passed on.
    complete : bool
        Whether all of them are in the journal.
    why : str
        Why not.
    """

    journal: Path
    n_from_client: int
    n_from_server: int
    complete: bool
    why: str = ""


def endpoints_of(text: str) -> tuple[Endpoint, Endpoint]:
    """Return where to listen and whom to reach: ``1294=10.0.0.7:1294``, ``127.0.0.1:1295=cmm:1294``.

    Raises
    ------
    UsageError
        If it is not of that form.
    """
    here, _, there = text.partition("=")
    listen, server = _endpoint(here, "127.0.0.1"), _endpoint(there, "")
    if listen is None or server is None or not server.host or not server.port:
        raise UsageError(f"--tap {text}", expected="LISTEN=HOST:PORT, as 1294=10.0.0.7:1294")
    return listen, server


def tap(
    listen: Endpoint,
    server: Endpoint,
    journal: Path,
    profile: MachineProfile,
    *,
    ready: Callable[[Endpoint, Path], object] | None = None,
    clock: clocks.Clock = clocks.REAL,
) -> Tapped:
    """Stand between one client and a server until one of them closes, or Ctrl-C is pressed.

    Parameters
    ----------
    listen : Endpoint
        Where the client connects to; port 0 takes a free one.
    server : Endpoint
        Whom the client meant.
    journal : Path
        Never overwritten: a free name beside it is taken.
    profile : MachineProfile
        For the journal, and for the cap on its bytes.
    ready : callable, optional
        Called with the place where it listens and the journal.
    clock : Clock

    Raises
    ------
    DeviceError
        If it cannot listen, or the server cannot be reached.
    OutputError
        If the journal cannot be made.
    KeyboardInterrupt
        If Ctrl-C is pressed before a client comes, or twice.
    """
    stop = threading.Event()
    with contextlib.ExitStack() as stack:
        door = stack.enter_context(_door(listen))
        writer = JournalWriter(journal, settings_for(f"tap of {server.host}:{server.port}", profile, None))
        stack.callback(writer.discard)
        stack.enter_context(on_ctrl_c(stop.set))
        if ready is not None:
            ready(Endpoint(*door.getsockname()[:2]), writer.path)
        client = stack.enter_context(_visitor(door, stop))
        door.close()
        machine = stack.enter_context(_reached(server))
        recorder = _Recorder(writer, profile.max_bytes, clock)
        reason = _carry(client, machine, recorder, stop)
        return recorder.finish(reason)


class _Recorder:
    """The journal of two directions, and what becomes of it."""

    def __init__(self, writer: JournalWriter, max_bytes: int, clock: clocks.Clock) -> None:
        self._writer = writer
        self._max_bytes = max_bytes
        self._clock = clock
        self._began_s = clock.now()
        self._lock = threading.Lock()
        self._passed = {FROM_CLIENT: 0, RECEIVED: 0}
        self._trouble = ""

    def note(self, channel: bytes, data: bytes) -> None:
        """Write bytes down before they go on, as long as that is possible."""
        with self._lock:  # both directions in one order, with times that do not go back
            self._passed[channel] += len(data)
            if self._trouble:
                return
            if sum(self._passed.values()) > self._max_bytes:
                self._trouble = f"more than the cap of {self._max_bytes} bytes went through"
                return
            try:
                self._writer.append(channel, self._clock.now() - self._began_s, data)
            except OutputError as error:
                self._trouble = error.one_line()

    def finish(self, reason: EndReason) -> Tapped:
        """Write down how it ended, and return the whole."""
        if self._trouble:
            reason = EndReason.MAX_BYTES
        with contextlib.suppress(OutputError):
            self._writer.end(self._clock.now() - self._began_s, {"end_reason": reason.value})
        from_client, from_server = self._passed[FROM_CLIENT], self._passed[RECEIVED]
        return Tapped(self._writer.path, from_client, from_server, not self._trouble, self._trouble)


def _carry(
    client: socket.socket, machine: socket.socket, recorder: _Recorder, stop: threading.Event
) -> EndReason:
    """Carry bytes both ways until one side closes and the other has had a moment to answer."""
    ways = [(client, machine, FROM_CLIENT), (machine, client, RECEIVED)]
    threads = [threading.Thread(target=_pass_on, args=(*way, recorder), daemon=True) for way in ways]
    for thread in threads:
        thread.start()
    try:
        while all(thread.is_alive() for thread in threads) and not stop.wait(POLL_S):
            pass
        reason = EndReason.INTERRUPTED if stop.is_set() else EndReason.CLOSED
        if reason is EndReason.CLOSED:
            for thread in threads:
                thread.join(GRACE_S)
    finally:
        for end in (client, machine):
            with contextlib.suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
        for thread in threads:
            thread.join()
    return reason


def _pass_on(source: socket.socket, sink: socket.socket, channel: bytes, recorder: _Recorder) -> None:
    """Pass bytes on in one direction until it closes, and pass that on too."""
    with contextlib.suppress(OSError):  # a connection that is reset is closed
        while data := source.recv(BLOCK_BYTES):
            recorder.note(channel, data)
            sink.sendall(data)
    with contextlib.suppress(OSError):
        sink.shutdown(socket.SHUT_WR)


def _endpoint(text: str, host: str) -> Endpoint | None:
    name, _, port = text.rpartition(":")
    if not (port.isascii() and port.isdigit()) or int(port) > MOST_PORT:
        return None
    return Endpoint(name.strip("[]") or host, int(port))


def _door(listen: Endpoint) -> socket.socket:
    try:
        return socket.create_server(listen)
    except OSError as error:
        raise DeviceError(
            f"cannot listen there ({error.strerror or error})",
            where=f"{listen.host}:{listen.port}",
            remedy="choose another address or port",
        ) from None


def _visitor(door: socket.socket, stop: threading.Event) -> socket.socket:
    """Return the connection of the one client."""
    door.settimeout(POLL_S)
    while not stop.is_set():
        with contextlib.suppress(TimeoutError):
            client, _ = door.accept()
            client.settimeout(None)
            return client
    raise KeyboardInterrupt


def _reached(server: Endpoint) -> socket.socket:
    try:
        connection = socket.create_connection(server, CONNECT_S)
    except OSError as error:
        raise DeviceError(
            f"cannot reach the server ({error.strerror or error})",
            where=f"{server.host}:{server.port}",
            remedy="is it on, and is the port right (I++ DME: 1294)?",
        ) from None
    connection.settimeout(None)
    return connection
