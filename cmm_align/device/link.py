"""The line to a controller: opened once, read as it comes, never written to."""

from __future__ import annotations

import errno
import sys
from pathlib import Path
from typing import Final

import serial
from serial.tools import list_ports

from cmm_align.device import clock as clocks
from cmm_align.device.address import REPLAY, scheme_of
from cmm_align.device.ending import Ended, EndReason
from cmm_align.device.line_errors import LineErrors, line_errors
from cmm_align.device.recordings import Recording
from cmm_align.device.replay import ReplayPort
from cmm_align.dialects import MachineProfile
from cmm_align.errors import CmmAlignError, DeviceError

READ_TIMEOUT_S: Final = 0.1
"""How long a read waits; also the grain of the idle time."""
MOST_READ_BYTES: Final = 1 << 16
PAUSE_S: Final = 0.002
"""Pause between two reads of a serial port, so that bytes come in handfuls and not one by one. At 2 Mbaud
400 bytes gather in it, a tenth of the smallest buffer that drivers have (4096)."""
RECEIVE_BUFFER_BYTES: Final = 1 << 16
"""Asked for on Windows, where the driver's own is 4096."""

_HANDLERS: Final = "cmm_align.device.urls"
_DEVICES: Final = {"", "spy"}
_NETWORK: Final = {"socket", "rfc2217"}
_UNKNOWN: Final = {errno.ENOENT, errno.ENXIO, errno.ENODEV}
_BUSY: Final = {errno.EBUSY, errno.EAGAIN, errno.EWOULDBLOCK}

if _HANDLERS not in serial.protocol_handler_packages:
    serial.protocol_handler_packages.insert(0, _HANDLERS)  # before pySerial's own `socket://`


class Link:
    """An open line.

    Parameters
    ----------
    port : serial.SerialBase
        Open.
    clock : Clock
    """

    def __init__(self, port: serial.SerialBase, clock: clocks.Clock) -> None:
        self._port = port
        self._clock = clock
        self._is_uart = isinstance(port, serial.Serial)
        self._errors_before = self._errors()

    @property
    def recording(self) -> Recording | None:
        """What is replayed; None where the line is live."""
        return self._port.recording if isinstance(self._port, ReplayPort) else None

    def read(self) -> bytes | Ended:
        """Return what has come, at most 64 KiB; nothing after a moment of silence; or why it is over."""
        port = self._port
        try:
            if self._is_uart:
                self._clock.sleep(PAUSE_S)
            waiting: int = port.in_waiting  # type: ignore[attr-defined] # every port has it; the stubs forgot
            data = port.read(min(waiting, MOST_READ_BYTES) or 1)
        except OSError as error:
            return self._broken(error)
        if not data and isinstance(port, ReplayPort) and port.finished:
            return _end_of(port.recording)
        return data

    def line_errors(self) -> LineErrors | None:
        """Return what the driver has counted since the line was opened, or None where nobody counts."""
        now = self._errors()
        return None if now is None or self._errors_before is None else now.since(self._errors_before)

    def close(self) -> None:
        """Close the line, and the file of a trace, which pySerial leaves open."""
        self._port.close()
        trace = getattr(getattr(self._port, "formatter", None), "output", sys.stderr)
        if trace is not None and trace is not sys.stderr:
            trace.close()

    def _errors(self) -> LineErrors | None:
        return line_errors(self._port.fileno()) if self._is_uart else None

    def _broken(self, error: OSError) -> Ended:
        """Return the end of a line that does not work any more."""
        if scheme_of(self._port.port or "") == "socket" and "disconnected" in str(error):
            return Ended(EndReason.CLOSED, "the other side closed the connection")
        if isinstance(self._port, ReplayPort):
            return Ended(EndReason.HANG_UP, str(error))
        return Ended(
            EndReason.HANG_UP,
            f"the line broke ({_text(error)}): it was unplugged, or another program reads the same port",
        )


def open_link(url: str, profile: MachineProfile, clock: clocks.Clock = clocks.REAL) -> Link:
    """Open a line; what came before is thrown away by the driver, so open first and start the dump then.

    Parameters
    ----------
    url : str
        Device or pySerial URL.
    profile : MachineProfile
        Settings of the line.
    clock : Clock
        For replays.

    Raises
    ------
    DeviceError
        If there is no such port, it is busy, or it may not be opened.
    InputError
        If the recording of a `replay://` URL cannot be read.
    """
    name = scheme_of(url)
    try:
        port = serial.serial_for_url(
            url,
            do_not_open=True,
            baudrate=profile.baud,
            bytesize=profile.bytesize,
            parity=profile.parity,
            stopbits=profile.stopbits,
            xonxoff=profile.xonxoff,
            rtscts=profile.rtscts,
            dsrdtr=profile.dsrdtr,
            timeout=READ_TIMEOUT_S,
            exclusive=True if name in _DEVICES and sys.platform != "win32" else None,
        )
        if isinstance(port, ReplayPort):
            port.clock = clock
        port.open()
        if sys.platform == "win32" and hasattr(port, "set_buffer_size"):
            port.set_buffer_size(rx_size=RECEIVE_BUFFER_BYTES)
    except CmmAlignError:
        raise
    except Exception as error:  # a handler may raise anything, as TypeError for a URL without a port number
        raise _complaint(error, url) from error
    return Link(port, clock)


def other_readers(url: str) -> tuple[str, ...]:
    """Return the programs that have a port open besides this one, as far as the platform lets us know."""
    if sys.platform != "linux" or scheme_of(url):
        return ()
    import os

    wanted = os.path.realpath(url)
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            if int(process.name) != os.getpid() and any(
                os.path.realpath(link) == wanted for link in (process / "fd").iterdir()
            ):
                found.append(f"{(process / 'comm').read_text().strip()} (process {process.name})")
        except OSError:
            continue  # it ended meanwhile, or belongs to somebody else
    return tuple(sorted(found))


def _end_of(recording: Recording | None) -> Ended:
    """Return how the run that a recording holds came to its end."""
    if recording is None or recording.kind != "journal":
        return Ended(EndReason.END_OF_FILE)
    if recording.end is None:
        return Ended(EndReason.CUT_OFF, "the journal breaks off")
    try:
        reason = EndReason(str(recording.end.get("end_reason")))
    except ValueError:
        reason = EndReason.END_OF_FILE
    if reason in {EndReason.MARKER, EndReason.COUNT}:  # read with other settings this time: it did not stop
        reason = EndReason.END_OF_FILE
    return Ended(reason, "so the journal says")


def _complaint(error: Exception, url: str) -> DeviceError:
    """Return what to tell the user about a port that cannot be opened."""
    code, text, name = getattr(error, "errno", None), _text(error), scheme_of(url)
    if name in _NETWORK:
        what = (
            f"cannot connect ({text.rpartition('] ')[2] if '] ' in text else 'no host, or no port number'})"
        )
        expected, remedy = f"{name}://HOST:PORT, and somebody who listens there", ""
    elif name and "not known" in text:
        what, remedy = f"{name}:// is unknown", ""
        expected = f"a device, or a URL as socket://host:port, rfc2217://host:port, {REPLAY}://file"
    elif code in _UNKNOWN or "FileNotFoundError" in text:
        what, expected, remedy = "there is no such port", "", _known_ports()
    elif Path(url).is_file():
        what, expected, remedy = "is a file", "a port", f"give --replay {url}"
    elif code in _BUSY or (sys.platform == "win32" and "PermissionError" in text):
        holders = " and ".join(other_readers(url))
        what = f"it is busy: another program has it open{f', {holders}' if holders else ''}"
        expected, remedy = "", "close that program first"
    elif code in {errno.EACCES, errno.EPERM}:
        what, expected = "this user may not open the port", ""
        remedy = "join the group that owns it (often dialout), then log in again"
    else:
        what, expected, remedy = f"cannot open it ({text})", "a serial port", ""
    return DeviceError(what, where=url, expected=expected, remedy=remedy)


def _known_ports() -> str:
    ports = sorted(port.device for port in list_ports.comports())
    return f"there are {', '.join(ports)}" if ports else "no serial port is there at all: is it plugged in?"


def _text(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__
