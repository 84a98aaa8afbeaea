"""A tap hears both sides of a line, passes every byte on, and has no words of its own."""

from __future__ import annotations

import contextlib
import signal
import socket
import struct
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from cmm_align.device.address import replay_url
from cmm_align.device.capture import capture_points
from cmm_align.device.journal import FROM_CLIENT, RECEIVED, JournalWriter, read_journal
from cmm_align.device.tap import Endpoint, Tapped, endpoints_of, tap
from cmm_align.dialects import MachineProfile
from cmm_align.errors import DeviceError, OutputError, UsageError

IPP = MachineProfile(dialect="ipp")
ANYWHERE = Endpoint("127.0.0.1", 0)
DIALOGUE = (
    (b"00001 StartSession()\r\n", b"00001 &\r\n00001 %\r\n"),
    (b"00002 OnPtMeasReport(X(),Y(),Z())\r\n", b"00002 &\r\n00002 %\r\n"),
    (
        b"00003 PtMeas(X(1),Y(2),Z(3),IJK(0,0,1))\r\n",
        b"00003 &\r\nE0000 # X(9), Y(9), Z(9)\r\n00003 # X(1.25), Y(2.5), Z(3.125)\r\n00003 %\r\n",
    ),
    (
        b"00004 PtMeas(X(4),Y(5),Z(6),IJK(0,0,1))\r\n",
        b"00004 &\r\n00004 # X(4.25), Y(5.5), Z(6.125)\r\n00004 %\r\n",
    ),
    (b"00005 EndSession()\r\n", b"00005 &\r\n00005 %\r\n"),
)


@contextmanager
def machine(heard: list[bytes], dialogue: tuple[tuple[bytes, bytes], ...] = DIALOGUE) -> Iterator[Endpoint]:
    """A server that knows its part of a dialogue."""

    def serve() -> None:
        connection, _ = door.accept()
        with connection, connection.makefile("rb") as lines:
            for _, answer in dialogue:
                heard.append(lines.readline())
                connection.sendall(answer)
            heard.append(lines.read())

    with socket.create_server(("127.0.0.1", 0)) as door:
        door.settimeout(10.0)
        thread = threading.Thread(target=serve)
        thread.start()
        yield Endpoint(*door.getsockname()[:2])
        thread.join()


def client(heard: list[bytes], dialogue: tuple[tuple[bytes, bytes], ...] = DIALOGUE) -> Callable[..., None]:
    """Return what connects a client that knows its part."""

    def talk(where: Endpoint) -> None:
        with (
            contextlib.suppress(OSError),  # a tap that gives up closes the line
            socket.create_connection(where) as connection,
            connection.makefile("rb") as answers,
        ):
            for question, answer in dialogue:
                connection.sendall(question)
                heard.append(answers.read(len(answer)))

    def ready(where: Endpoint, _journal: Path) -> None:
        threading.Thread(target=talk, args=(where,), daemon=True).start()

    return ready


def side(tapped: Tapped, channel: bytes) -> bytes:
    records = read_journal(tapped.journal).records
    return b"".join(record.data for record in records if record.channel == channel)


def test_both_sides_hear_what_they_would_hear_without_it(tmp_path: Path) -> None:
    at_machine: list[bytes] = []
    at_client: list[bytes] = []
    with machine(at_machine) as server:
        found = tap(ANYWHERE, server, tmp_path / "tap.journal", IPP, ready=client(at_client))
    questions, answers = zip(*DIALOGUE, strict=True)

    assert at_machine == [*questions, b""]
    assert at_client == [*answers]
    assert side(found, FROM_CLIENT) == b"".join(questions)
    assert side(found, RECEIVED) == b"".join(answers)
    assert (found.n_from_client, found.n_from_server) == (len(b"".join(questions)), len(b"".join(answers)))
    assert found.complete
    assert (read_journal(found.journal).end or {})["end_reason"] == "closed"


def test_what_was_tapped_becomes_points(tmp_path: Path) -> None:
    with machine([]) as server:
        found = tap(ANYWHERE, server, tmp_path / "tap.journal", IPP, ready=client([]))
    captured = capture_points(replay_url(found.journal))

    assert captured.points.points_mm.tolist() == [[1.25, 2.5, 3.125], [4.25, 5.5, 6.125]]
    assert captured.complete
    assert not captured.rejected


def test_large_answers_pass_whole(tmp_path: Path) -> None:
    large = ((b"00001 Get()\r\n", b"00001 # " + b"1.5," * 500_000 + b"\r\n"),)
    at_client: list[bytes] = []
    with machine([], large) as server:
        found = tap(ANYWHERE, server, tmp_path / "tap.journal", IPP, ready=client(at_client, large))

    assert at_client == [large[0][1]]
    assert side(found, RECEIVED) == large[0][1]


@pytest.mark.parametrize("trouble", ["cap", "disk"])
def test_the_machine_does_not_stop_for_a_listener_in_trouble(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, trouble: str
) -> None:
    profile = IPP
    if trouble == "cap":
        profile = MachineProfile(dialect="ipp", max_bytes=30)
    else:

        def full(*_: object) -> None:
            raise OutputError("cannot write the journal (No space left on device)")

        monkeypatch.setattr(JournalWriter, "append", full)
    at_client: list[bytes] = []
    with machine([]) as server:
        found = tap(ANYWHERE, server, tmp_path / "tap.journal", profile, ready=client(at_client))

    assert at_client == [answer for _, answer in DIALOGUE]
    assert not found.complete
    assert ("cap of 30" if trouble == "cap" else "No space left") in found.why


@pytest.mark.skipif(sys.platform == "win32", reason="no signal can be sent to a thread there")
def test_ctrl_c_ends_it_and_keeps_what_was_heard(tmp_path: Path) -> None:
    asked = threading.Event()
    half = DIALOGUE[:1]

    def talk(where: Endpoint, _journal: Path) -> None:
        def speak() -> None:
            with socket.create_connection(where) as connection:
                connection.sendall(half[0][0])
                connection.recv(1)
                asked.set()
                connection.recv(1000)
                connection.recv(1000)

        threading.Thread(target=speak, daemon=True).start()

    main = threading.get_ident()
    threading.Thread(
        target=lambda: asked.wait(10.0) and signal.pthread_kill(main, signal.SIGINT), daemon=True
    ).start()
    with machine([], half) as server:
        found = tap(ANYWHERE, server, tmp_path / "tap.journal", IPP, ready=talk)

    assert side(found, FROM_CLIENT) == half[0][0]
    assert (read_journal(found.journal).end or {})["end_reason"] == "interrupted"


def test_ctrl_c_before_a_client_comes_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        tap(
            ANYWHERE,
            Endpoint("127.0.0.1", 1),
            tmp_path / "tap.journal",
            IPP,
            ready=lambda *_: signal.raise_signal(signal.SIGINT),
        )

    assert not list(tmp_path.iterdir())


def test_a_server_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(DeviceError, match=r"127.0.0.1:1: cannot reach the server.*1294"):
        tap(ANYWHERE, Endpoint("127.0.0.1", 1), tmp_path / "tap.journal", IPP, ready=client([]))

    assert not list(tmp_path.iterdir())


def test_a_door_that_is_taken_is_named(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        where = Endpoint(*taken.getsockname()[:2])
        with pytest.raises(DeviceError, match=f"{where.port}: cannot listen there"):
            tap(where, Endpoint("127.0.0.1", 1), tmp_path / "tap.journal", IPP)


def test_a_connection_that_is_reset_is_closed(tmp_path: Path) -> None:
    heard: list[bytes] = []

    def ready(where: Endpoint, _journal: Path) -> None:
        def speak() -> None:
            connection = socket.create_connection(where)
            connection.sendall(DIALOGUE[0][0])
            connection.recv(1)
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            connection.close()

        threading.Thread(target=speak, daemon=True).start()

    with machine(heard, DIALOGUE[:1]) as server:
        found = tap(ANYWHERE, server, tmp_path / "tap.journal", IPP, ready=ready)

    assert heard == [DIALOGUE[0][0], b""]
    assert found.complete


def test_places_as_they_are_written() -> None:
    assert endpoints_of("1294=10.0.0.7:1295") == (Endpoint("127.0.0.1", 1294), Endpoint("10.0.0.7", 1295))
    assert endpoints_of("0.0.0.0:1=[::1]:2") == (Endpoint("0.0.0.0", 1), Endpoint("::1", 2))


@pytest.mark.parametrize(
    "text", ["1294", "1294=", "1294=host", "x=host:1", "1294=:1294", "1=h:99999", "=h:1"]
)
def test_places_that_are_none(text: str) -> None:
    with pytest.raises(UsageError, match=r"LISTEN=HOST:PORT"):
        endpoints_of(text)
