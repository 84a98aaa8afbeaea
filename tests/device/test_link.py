"""Lines that open, that do not, and that break: what the user is told, and that no byte is lost."""

from __future__ import annotations

import errno
import os
import socket
import struct
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
import serial

from cmm_align.device import line_errors as counters
from cmm_align.device import link as links
from cmm_align.device.ending import Ended, EndReason
from cmm_align.device.line_errors import LineErrors, line_errors
from cmm_align.device.link import Link, open_link, other_readers
from cmm_align.dialects import MachineProfile
from cmm_align.errors import DeviceError, MissingFileError

if TYPE_CHECKING:
    from controller import Controller

PROFILE = MachineProfile(baud=115200)


@contextmanager
def server(words: bytes, *, closes: bool = True) -> Iterator[str]:
    """A TCP server that talks before it is asked."""
    with socket.create_server(("127.0.0.1", 0)) as door:
        done = threading.Event()

        def talk() -> None:
            connection, _ = door.accept()
            with connection:
                connection.sendall(words)
                if not closes:
                    done.wait(10.0)

        thread = threading.Thread(target=talk)
        thread.start()
        yield f"socket://127.0.0.1:{door.getsockname()[1]}"
        done.set()
        thread.join()


def everything(link: Link) -> tuple[bytes, Ended]:
    pieces = []
    while True:
        got = link.read()
        if isinstance(got, Ended):
            return b"".join(pieces), got
        pieces.append(got)


def test_an_unknown_port_lists_those_that_are_there(monkeypatch: pytest.MonkeyPatch) -> None:
    class Port:
        device = "/dev/ttyUSB7"

    with pytest.raises(DeviceError, match=r"ttyUSB99: there is no such port"):
        open_link("/dev/ttyUSB99", PROFILE)
    monkeypatch.setattr(links.list_ports, "comports", lambda: [Port()])
    with pytest.raises(DeviceError, match="there are /dev/ttyUSB7"):
        open_link("/dev/ttyUSB99", PROFILE)
    monkeypatch.setattr(links.list_ports, "comports", list)
    with pytest.raises(DeviceError, match="no serial port is there"):
        open_link("/dev/ttyUSB99", PROFILE)


def test_a_busy_port_is_refused_and_its_holder_named(controller: Controller) -> None:
    code = (
        "import serial, sys\n"
        f"port = serial.Serial({controller.port!r}, exclusive=True)\n"
        "print('open', flush=True)\n"
        "sys.stdin.read()\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == b"open\n"
        with pytest.raises(DeviceError, match=r"busy.*close that program") as caught:
            open_link(controller.port, PROFILE)
        if sys.platform == "linux":
            assert f"(process {holder.pid})" in caught.value.what
            assert any(str(holder.pid) in reader for reader in other_readers(controller.port))
        holder.communicate()
    open_link(controller.port, PROFILE).close()


@pytest.mark.parametrize(
    ("code", "words"),
    [(errno.EACCES, "may not open.*dialout"), (errno.EBUSY, "busy"), (errno.ENODEV, "no such port")],
)
def test_what_the_system_says_becomes_advice(monkeypatch: pytest.MonkeyPatch, code: int, words: str) -> None:
    def refuse(*_arguments: object, **_settings: object) -> None:
        raise serial.SerialException(code, "could not open port")

    monkeypatch.setattr(links.serial, "serial_for_url", refuse)
    with pytest.raises(DeviceError, match=words):
        open_link("/dev/ttyS99", PROFILE)


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("wire://x", "wire:// is unknown.*socket://"),
        ("socket://127.0.0.1", "no host, or no port number.*socket://HOST:PORT"),
        ("socket://127.0.0.1:1", "cannot connect"),
        ("/dev/null", "serial port"),
    ],
)
def test_what_is_no_port_is_refused(url: str, words: str) -> None:
    with pytest.raises(DeviceError, match=words):
        open_link(url, PROFILE)


def test_a_file_is_no_port(dump_file: Path) -> None:
    with pytest.raises(DeviceError, match=r"is a file.*--replay"):
        open_link(str(dump_file), PROFILE)


def test_a_missing_recording_is_an_input_error() -> None:
    with pytest.raises(MissingFileError):
        open_link("replay://missing.txt", PROFILE)


def test_a_socket_gives_every_byte_and_then_its_end(dump: bytes) -> None:
    with server(dump) as url, closing(open_link(url, PROFILE)) as link:
        found, end = everything(link)

    assert found == dump
    assert end.reason is EndReason.CLOSED


def test_a_socket_keeps_what_was_said_while_it_was_opened(monkeypatch: pytest.MonkeyPatch) -> None:
    heard = threading.Event()
    connect = socket.create_connection

    def slowly(*arguments: object, **settings: object) -> socket.socket:
        connection = connect(*arguments, **settings)  # type: ignore[arg-type]
        assert connection.recv(1, socket.MSG_PEEK)  # wait until the first words are there
        heard.set()
        return connection

    monkeypatch.setattr(socket, "create_connection", slowly)
    with server(b"1,2,3\r\n") as url, closing(open_link(url, PROFILE)) as link:
        assert heard.is_set()
        assert everything(link)[0] == b"1,2,3\r\n"


def test_a_silent_line_gives_nothing_after_a_moment() -> None:
    with server(b"", closes=False) as url, closing(open_link(url, PROFILE)) as link:
        assert link.read() == b""
    with closing(open_link("loop://", PROFILE)) as link:
        assert link.read() == b""


def test_a_hang_up_is_an_end_that_names_both_causes(controller: Controller) -> None:
    with closing(open_link(controller.port, PROFILE)) as link:
        os.write(controller.descriptor, b"1,2,3\n")
        got = b""
        while len(got) < 6:
            piece = link.read()
            assert isinstance(piece, bytes)
            got += piece
        controller.hang_up()
        found, end = everything(link)

    assert (got, found) == (b"1,2,3\n", b"")
    assert end.reason is EndReason.HANG_UP
    assert "unplugged" in end.detail
    assert "another program" in end.detail


def test_nobody_counts_errors_on_a_pseudo_terminal(controller: Controller) -> None:
    with closing(open_link(controller.port, PROFILE)) as link:
        assert link.line_errors() is None


@pytest.mark.skipif(sys.platform != "linux", reason="the ioctl is Linux's")
def test_the_counts_of_the_driver_are_read_by_their_places(monkeypatch: pytest.MonkeyPatch) -> None:
    import fcntl

    names = ["cts", "dsr", "rng", "dcd", "rx", "tx", "frame", "overrun", "parity", "brk", "buf_overrun"]
    raw = struct.pack("20i", *range(100, 120))
    wanted = dict(zip(names, range(100, 111), strict=True))
    monkeypatch.setattr(fcntl, "ioctl", lambda *_: raw)
    found = line_errors(0)

    assert found == LineErrors(wanted["overrun"], wanted["buf_overrun"], wanted["parity"], wanted["frame"])
    assert not found.since(found).happened()
    assert found.since(found._replace(parity=found.parity - 2)) == LineErrors(0, 0, 2, 0)


def test_nobody_counts_where_the_platform_does_not(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(counters.sys, "platform", "darwin")

    assert line_errors(0) is None
