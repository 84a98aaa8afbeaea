"""A recording in the place of a port: the same bytes, in any pieces, and in their own time."""

from __future__ import annotations

import io
from pathlib import Path
from urllib.parse import quote

import pytest
import serial
from serial.urlhandler.protocol_spy import FormatHexdump

from cmm_align.device.address import Replay, is_port, replay_of, replay_url
from cmm_align.device.capture import recording_of
from cmm_align.device.clock import Clock
from cmm_align.device.faults import Chunk, Faults, faulty
from cmm_align.device.journal import FROM_CLIENT, RECEIVED, JournalWriter
from cmm_align.device.recordings import read_recording
from cmm_align.device.replay import ReplayPort
from cmm_align.errors import MalformedInputError, MissingFileError, UsageError


def opened(url: str, clock: Clock | None = None, **settings: object) -> ReplayPort:
    """Open a URL as any program with pySerial would."""
    port = serial.serial_for_url(url, do_not_open=True, timeout=0.1, **settings)
    assert isinstance(port, ReplayPort)
    if clock is not None:
        port.clock = clock
    port.open()
    return port


def served(port: ReplayPort, size: int = 1000) -> list[bytes]:
    """Read a port to its end."""
    pieces = []
    while not port.finished:
        pieces.append(port.read(size))
    return pieces


def journal_of(path: Path, *records: tuple[bytes, float, bytes]) -> Path:
    with JournalWriter(path, {}) as writer:
        for record in records:
            writer.append(*record)
    return writer.path


def test_a_dump_is_served_to_the_last_byte(dump_file: Path, dump: bytes) -> None:
    assert b"".join(served(opened(replay_url(dump_file)))) == dump


@pytest.mark.parametrize("chunk", [1, 7, 4096])
def test_the_pieces_are_as_long_as_asked_for(dump_file: Path, dump: bytes, chunk: int) -> None:
    pieces = served(opened(f"{replay_url(dump_file)}?chunk={chunk}"), size=10_000)

    assert b"".join(pieces) == dump
    assert {len(piece) for piece in pieces[:-1]} == {chunk}


def test_no_more_is_given_than_asked_for_and_than_waits(dump_file: Path, dump: bytes) -> None:
    port = opened(f"{replay_url(dump_file)}?chunk=10")

    assert port.in_waiting == 10
    assert port.read(4) == dump[:4]
    assert port.in_waiting == 6
    assert port.read(100) == dump[4:10]


def test_a_journal_is_served_in_its_own_time(tmp_path: Path, clock: Clock) -> None:
    path = journal_of(tmp_path / "a.journal", (RECEIVED, 0.05, b"1,2,"), (RECEIVED, 1.0, b"3\n"))
    port = opened(f"{replay_url(path)}?speed=2", clock)
    seen = []
    while not port.finished:
        seen.append((port.read(100), round(clock.now(), 9)))

    assert seen[0] == (b"1,2,", 0.025)
    assert [data for data, _ in seen[1:-1]] == [b""] * 4  # four timeouts of 0.1 s
    assert seen[-1] == (b"3\n", 0.5)


def test_a_journal_comes_at_once_where_no_speed_is_given(tmp_path: Path, clock: Clock) -> None:
    path = journal_of(tmp_path / "a.journal", (RECEIVED, 5.0, b"1,2,"), (RECEIVED, 900.0, b"3\n"))

    assert served(opened(replay_url(path), clock)) == [b"1,2,3\n"]
    assert clock.now() == 0.0


def test_a_dump_takes_the_time_of_its_baud_rate(dump_file: Path, dump: bytes, clock: Clock) -> None:
    port = opened(f"{replay_url(dump_file)}?speed=1", clock, baudrate=9600)

    assert b"".join(served(port, 100_000)) == dump
    assert clock.now() == pytest.approx(10 * len(dump) / 9600)


def test_the_faults_are_those_of_the_seed(dump_file: Path, dump: bytes) -> None:
    wanted, _ = faulty([Chunk(0.0, dump)], Faults(drop=9, flip=4), 5)
    port = opened(f"{replay_url(dump_file)}?faults=drop:9,flip:4&seed=5")

    assert b"".join(served(port)) == b"".join(chunk.data for chunk in wanted)


def test_a_stall_takes_its_time(dump_file: Path, dump: bytes, clock: Clock) -> None:
    port = opened(f"{replay_url(dump_file)}?speed=1&faults=stall:3&seed=1", clock, baudrate=9600)

    assert b"".join(served(port)) == dump
    assert clock.now() == pytest.approx(3.0 + 10 * len(dump) / 9600)


def test_a_broken_line_raises_what_a_port_would(dump_file: Path, dump: bytes) -> None:
    port = opened(f"{replay_url(dump_file)}?faults=disconnect:0.5")

    assert port.read(100_000) == dump[: len(dump) // 2]
    assert not port.finished
    with pytest.raises(serial.SerialException, match="broke"):
        port.read(1)


def test_a_recording_hears_nothing(dump_file: Path) -> None:
    with pytest.raises(serial.SerialException):
        opened(replay_url(dump_file)).write(b"hello")


@pytest.mark.parametrize("colour", [False, True])
def test_a_trace_of_spy_gives_what_was_received(tmp_path: Path, dump: bytes, colour: bool) -> None:
    text = io.StringIO()
    trace = FormatHexdump(text, colour)
    for start in range(0, len(dump), 37):
        trace.control("Q-RX", "in_waiting -> 37")
        trace.rx(dump[start : start + 37])
        trace.rx(b"")
        trace.tx(b"00 01 02 RX   0000  41 42")
    path = tmp_path / "spy.txt"
    path.write_text(text.getvalue())

    assert b"".join(served(opened(replay_url(path)))) == dump
    assert read_recording(path, 9600.0).kind == "spy"


def test_a_torn_trace_loses_its_torn_line_only(tmp_path: Path) -> None:
    text = io.StringIO()
    FormatHexdump(text, False).rx(bytes(range(65, 65 + 40)))
    path = tmp_path / "spy.txt"
    path.write_text(text.getvalue()[:-10])

    assert b"".join(served(opened(replay_url(path)))) == bytes(range(65, 65 + 32))


def test_a_damaged_trace_is_refused_with_its_line(tmp_path: Path) -> None:
    text = io.StringIO()
    FormatHexdump(text, False).rx(bytes(range(65, 65 + 40)))
    path = tmp_path / "spy.txt"
    path.write_text(text.getvalue().replace("51 52", "5x 52"))

    with pytest.raises(MalformedInputError, match=r"spy.txt:2: .*5x"):
        opened(replay_url(path))


def test_two_sides_of_a_tap_take_turns_by_whole_lines(tmp_path: Path) -> None:
    path = journal_of(
        tmp_path / "tap.journal",
        (FROM_CLIENT, 0.0, b"00001 Get(X(),"),
        (RECEIVED, 0.1, b"E0001 # X(1"),
        (FROM_CLIENT, 0.2, b"Y())\r\n"),
        (RECEIVED, 0.3, b".5)\r\n00001 &\r\n000"),
        (RECEIVED, 0.4, b"01 %"),
    )
    whole = b"00001 Get(X(),Y())\r\nE0001 # X(1.5)\r\n00001 &\r\n00001 %"

    assert b"".join(served(opened(replay_url(path)))) == whole


@pytest.mark.parametrize("name", ["a b.txt", "50%25.txt", "ä?.txt", "x&y=1#2.txt"])
def test_any_name_of_a_file_can_be_replayed(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(b"1,2,3\n")

    assert recording_of(replay_url(path)) == path
    assert served(opened(replay_url(path))) == [b"1,2,3\n"]


def test_what_a_url_says() -> None:
    assert replay_of("replay://a/b.txt?speed=2.5&chunk=7&faults=flip:2&seed=9") == Replay(
        Path("a/b.txt"), 2.5, 7, Faults(flip=2), 9
    )
    assert replay_of("REPLAY:///C:/x.txt").path == Path("C:/x.txt")
    assert replay_of("replay:///tmp/x.txt").path == Path("/tmp/x.txt")
    assert replay_of(f"replay://{quote('a b')}").path == Path("a b")


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("replay://", "names no file"),
        ("socket://a:1", "no replay"),
        ("replay://a?sped=1", "one of speed"),
        ("replay://a?speed=-1", "above zero"),
        ("replay://a?speed=nan", "above zero"),
        ("replay://a?chunk=1.5", "whole number"),
        ("replay://a?faults=stall:3", "add speed=1"),
    ],
)
def test_a_url_that_makes_no_sense_is_refused(url: str, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        replay_of(url)


def test_a_missing_recording_is_an_input_error(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match="missing"):
        opened(replay_url(tmp_path / "missing.journal"))


@pytest.mark.parametrize(
    "text", ["/dev/ttyUSB0", "/dev/serial/by-id/x", "COM3", "com12", r"\\.\COM10", "socket://h:1", "LOOP://"]
)
def test_ports(text: str) -> None:
    assert is_port(text)


@pytest.mark.parametrize("text", ["part.csv", "a/b.txt", "COM3.txt", "C:/x.txt", r"C:\x.txt", "COMPASS"])
def test_files(text: str) -> None:
    assert not is_port(text)
