"""From a port to points, with nothing lost, and the same again from the journal."""

from __future__ import annotations

import os
import signal
import threading
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
import serial

from cmm_align.device.address import replay_url
from cmm_align.device.capture import Captured, capture_points
from cmm_align.device.ending import EndReason
from cmm_align.device.intake import Progress
from cmm_align.device.journal import RECEIVED, JournalWriter, read_journal
from cmm_align.dialects import MachineProfile
from cmm_align.errors import CmmAlignError, DeviceError, MalformedInputError, OutputError
from cmm_align.model import PointKind

if TYPE_CHECKING:
    from controller import Controller

PROFILE = MachineProfile(
    baud=115200, kind=PointKind.TIP_CENTRE, tip_radius_mm=1.5, idle_end_s=0.15, first_data_timeout_s=10.0
)
ENDING = MachineProfile(baud=115200, end_marker="END", first_data_timeout_s=10.0)


def bytes_of(journal: Path | None) -> bytes:
    assert journal is not None
    return b"".join(record.data for record in read_journal(journal).records)


def same(one: Captured, other: Captured) -> bool:
    """Return whether two captures brought the same, to the bit."""
    return (
        one.points.points_mm.tobytes() == other.points.points_mm.tobytes()
        and one.points.ids.tobytes() == other.points.ids.tobytes()
        and (one.rejected, one.notes) == (other.rejected, other.notes)
        and (one.end_reason, one.n_bytes) == (other.end_reason, other.n_bytes)
    )


def test_a_dump_at_full_speed_is_captured_to_the_byte(
    controller: Controller, tmp_path: Path, dump: bytes
) -> None:
    whole = dump * 10 + b"END\r\n"
    found = capture_points(
        controller.port,
        ENDING,
        journal=tmp_path / "part.journal",
        ready=lambda _: controller.say(whole),
    )

    assert bytes_of(found.raw_log) == whole
    assert (found.end_reason, found.complete, found.n_bytes) == (EndReason.MARKER, True, len(whole))
    assert len(found.points) == 5000
    assert not found.rejected
    assert same(capture_points(replay_url(tmp_path / "part.journal")), found)


def test_the_points_are_those_of_the_dump(controller: Controller, tmp_path: Path, dump: bytes) -> None:
    found = capture_points(
        controller.port, PROFILE, journal=tmp_path / "a.journal", ready=lambda _: controller.say(dump)
    )

    np.testing.assert_array_equal(found.points.points_mm, np.loadtxt(dump.splitlines(), delimiter=","))
    assert found.points.kind is PointKind.TIP_CENTRE
    assert (found.end_reason, found.complete) == (EndReason.IDLE, True)
    assert found.line_errors is None  # nobody counts on a pseudo terminal


def test_the_journal_is_there_before_the_operator_is_told(controller: Controller, tmp_path: Path) -> None:
    told: list[Path | None] = []

    def ready(path: Path | None) -> None:
        assert path is not None
        assert read_journal(path).settings["profile"]["tip_radius_mm"] == 1.5
        told.append(path)
        controller.say(b"1,2,3\n")

    capture_points(controller.port, PROFILE, journal=tmp_path / "a.journal", expect=1, ready=ready)

    assert told == [tmp_path / "a.journal"]


def test_a_consumer_that_stops_holds_up_nobody(controller: Controller, tmp_path: Path, dump: bytes) -> None:
    """From the first point on the consumer sleeps until all the rest is written down without it."""
    path = tmp_path / "part.journal"
    whole = dump * 3 + b"END\r\n"
    left: list[int] = []

    def sleep(progress: Progress) -> None:
        if progress.n_points and not left:
            left.append(len(whole) - progress.n_bytes)
            while bytes_of(path) != whole:
                threading.Event().wait(0.01)

    found = capture_points(
        controller.port, ENDING, journal=path, ready=lambda _: controller.say(whole), watch=sleep
    )

    assert left[0] > 4096  # more than any buffer of the terminal could have held back
    assert len(found.points) == 1500
    assert found.complete


def test_the_first_ctrl_c_keeps_what_came(controller: Controller, tmp_path: Path) -> None:
    pressed = iter([signal.SIGINT])

    def stop(progress: Progress) -> None:
        if progress.n_bytes == 17:
            for number in pressed:
                signal.raise_signal(number)

    found = capture_points(
        controller.port,
        PROFILE,
        journal=tmp_path / "part.journal",
        ready=lambda _: controller.say(b"1,2,3\r\n4,5,6\r\n7,8"),
        watch=stop,
    )

    assert (found.end_reason, found.complete) == (EndReason.INTERRUPTED, False)
    assert found.points.points_mm.tolist() == [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    assert same(capture_points(replay_url(tmp_path / "part.journal")), found)


def test_the_second_ctrl_c_quits_and_leaves_the_journal(controller: Controller, tmp_path: Path) -> None:
    def stop(progress: Progress) -> None:
        if progress.n_points:
            signal.raise_signal(signal.SIGINT)
            signal.raise_signal(signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        capture_points(
            controller.port,
            PROFILE,
            journal=tmp_path / "part.journal",
            ready=lambda _: controller.say(b"1,2,3\r\n"),
            watch=stop,
        )
    assert bytes_of(tmp_path / "part.journal") == b"1,2,3\r\n"
    salvaged = capture_points(replay_url(tmp_path / "part.journal"))

    assert (salvaged.end_reason, salvaged.complete) == (EndReason.CUT_OFF, False)
    assert salvaged.points.points_mm.tolist() == [[1.0, 2.0, 3.0]]


def test_ctrl_c_before_the_first_byte_leaves_nothing(controller: Controller, tmp_path: Path) -> None:
    pressed = iter([signal.SIGINT])
    with pytest.raises(KeyboardInterrupt):
        capture_points(
            controller.port,
            PROFILE,
            journal=tmp_path / "part.journal",
            watch=lambda _: [signal.raise_signal(number) for number in pressed],
        )

    assert not list(tmp_path.iterdir())


def test_a_hang_up_keeps_what_came(controller: Controller, tmp_path: Path) -> None:
    def pull(progress: Progress) -> None:
        if progress.n_bytes == 16:
            controller.hang_up()

    found = capture_points(
        controller.port,
        PROFILE,
        journal=tmp_path / "part.journal",
        ready=lambda _: controller.say(b"1,2,3\r\n4,5,6\r\n7,"),
        watch=pull,
    )

    assert (found.end_reason, found.complete) == (EndReason.HANG_UP, False)
    assert len(found.points) == 2
    assert "unplugged" in found.shortfalls[0]
    assert same(capture_points(replay_url(tmp_path / "part.journal")), found)


def test_silence_is_an_error_and_leaves_nothing(controller: Controller, tmp_path: Path) -> None:
    silent = MachineProfile(first_data_timeout_s=0.05)
    with pytest.raises(DeviceError, match="did you start the dump"):
        capture_points(controller.port, silent, journal=tmp_path / "part.journal")

    assert not list(tmp_path.iterdir())


def test_a_dump_larger_than_the_cap_is_cut_there(dump_file: Path, dump: bytes) -> None:
    found = capture_points(replay_url(dump_file), MachineProfile(max_bytes=1000))
    whole = capture_points(replay_url(dump_file), MachineProfile(max_bytes=len(dump)))

    assert (found.end_reason, found.complete, found.n_bytes) == (EndReason.MAX_BYTES, False, 1000)
    assert "cap of 1000 bytes" in found.shortfalls[0]
    assert len(found.points) == dump[:1000].count(b"\r")
    assert (whole.end_reason, whole.complete) == (EndReason.END_OF_FILE, True)


def test_too_few_points_are_not_complete(dump_file: Path) -> None:
    few = capture_points(replay_url(dump_file), expect=501)
    enough = capture_points(replay_url(dump_file), expect=500)
    fewer = capture_points(replay_url(dump_file), expect=7)

    assert (few.complete, few.shortfalls) == (False, ("500 of 501 points came",))
    assert (enough.complete, enough.end_reason) == (True, EndReason.COUNT)
    assert (len(fewer.points), fewer.complete) == (7, True)


def test_a_marker_that_never_came_is_not_complete(dump_file: Path) -> None:
    found = capture_points(replay_url(dump_file), ENDING)

    assert found.shortfalls == ("the end marker 'END' never came",)


def test_a_journal_brings_its_profile_and_its_count(tmp_path: Path) -> None:
    path = tmp_path / "counts.journal"
    settings = {"profile": {"columns": "id,x,y,z", "scale": [0.001] * 3, "kind": "contact"}, "expect": 2}
    with JournalWriter(path, settings) as writer:
        writer.append(RECEIVED, 0.0, b"7 1000 2000 3000\r8 4000 5000 6000\r9 1 1 1\r")
        writer.end(1.0, {"end_reason": "count", "line_errors": None})
    found = capture_points(replay_url(path))

    assert found.points.points_mm.tolist() == [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]
    assert found.points.ids.tolist() == [7, 8]
    assert found.points.kind is PointKind.CONTACT
    assert (found.end_reason, found.complete, found.raw_log) == (EndReason.COUNT, True, path)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"profile": 7}, "table of settings"),
        ({"profile": {"baud": "fast"}}, "baud"),
        ({"profile": {"buad": 9600}}, "did you mean 'baud'"),
        ({"expect": "many"}, "number of points"),
        ({"expect": 0}, "number of points"),
    ],
)
def test_settings_of_a_journal_are_not_trusted(tmp_path: Path, settings: dict, words: str) -> None:
    with JournalWriter(tmp_path / "odd.journal", settings) as writer:
        writer.append(RECEIVED, 0.0, b"1,2,3\r")
        writer.end(1.0, {"end_reason": ["?"], "line_errors": 7})

    with pytest.raises(CmmAlignError, match=words):
        capture_points(replay_url(writer.path))
    assert capture_points(replay_url(writer.path), PROFILE, expect=1).complete


def test_the_errors_that_the_driver_counted_are_replayed_too(tmp_path: Path) -> None:
    path = tmp_path / "lossy.journal"
    errors = {"overrun": 3, "buffer_overrun": 1, "parity": 0, "framing": 2}
    with JournalWriter(path, {}) as writer:
        writer.append(RECEIVED, 0.0, b"1,2,3\r4,5,6\r")
        writer.end(1.0, {"end_reason": "idle", "line_errors": errors})
    found = capture_points(replay_url(path))

    assert found.line_errors is not None
    assert found.line_errors._asdict() == errors
    assert "4 lost bytes" in found.shortfalls[0]
    assert "2 wrong stop bits" in found.shortfalls[0]


def test_missing_numbers_are_not_complete(tmp_path: Path) -> None:
    path = tmp_path / "gap.txt"
    path.write_bytes(b"".join(b"%d,1,2,3\n" % number for number in (1, 2, 3, 4, 7, 8, 9)))
    found = capture_points(replay_url(path), MachineProfile(columns="id,x,y,z"))

    assert not found.complete
    assert "from 4 to 7" in found.shortfalls[0]


@pytest.mark.parametrize(
    ("raw", "words"),
    [
        (b"1,2,3,4\r\n1,2\r\n", r"no points in 14 bytes; line 1 is '1,2,3,4'"),
        (b"hello\r\nworld\r\n", r"no points in 14 bytes.*xyz"),
        (bytes(byte | 0x80 for byte in b"1.5,2.5,3.5\r\n") * 9, "parity"),
        (bytes(range(0, 255, 3)) * 9, "baud"),
        (b"", "the recording is empty"),
    ],
)
def test_bytes_without_points_are_an_error_with_advice(tmp_path: Path, raw: bytes, words: str) -> None:
    path = tmp_path / "garbage.bin"
    path.write_bytes(raw)

    with pytest.raises(MalformedInputError, match=words):
        capture_points(replay_url(path))


@pytest.mark.parametrize("seed", range(12))
def test_faults_of_the_line_never_make_a_point_out_of_pieces(dump_file: Path, dump: bytes, seed: int) -> None:
    """With the decimals stated, a lost or spoilt byte costs its line, or changes a digit before the point."""
    whole = {line for line in dump.split(b"\r\n") if line}
    profile = MachineProfile(decimals=4, terminator="\r\n")
    clean = capture_points(replay_url(dump_file), profile)
    split = capture_points(f"{replay_url(dump_file)}?faults=split:3&seed={seed}", profile)
    broken = capture_points(f"{replay_url(dump_file)}?faults=disconnect:0.{seed:02d}5&seed={seed}", profile)

    assert same(clean, split)
    assert len(clean.points) == len(whole)
    assert broken.end_reason is EndReason.HANG_UP
    np.testing.assert_array_equal(broken.points.points_mm, clean.points.points_mm[: len(broken.points)])
    assert broken.n_bytes // 30 <= len(broken.points) <= broken.n_bytes // 20


def test_a_journal_that_cannot_be_written_stops_the_capture(
    controller: Controller, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OutputError("cannot write the journal (No space left on device)")

    monkeypatch.setattr(JournalWriter, "append", full)
    with pytest.raises(OutputError, match="No space left"):
        capture_points(
            controller.port,
            PROFILE,
            journal=tmp_path / "part.journal",
            ready=lambda _: controller.say(b"1,2,3\n"),
        )


def test_spy_traces_a_live_port_and_its_trace_replays(
    controller: Controller, tmp_path: Path, dump: bytes
) -> None:
    trace = tmp_path / "trace.txt"
    found = capture_points(
        f"spy://{controller.port}?file={trace}", ENDING, ready=lambda _: controller.say(dump + b"END\r\n")
    )
    again = capture_points(replay_url(trace), ENDING)

    assert same(found, again)
    assert len(again.points) == 500


def test_nothing_is_ever_sent(controller: Controller, tmp_path: Path, dump: bytes) -> None:
    capture_points(
        controller.port, PROFILE, journal=tmp_path / "a.journal", ready=lambda _: controller.say(dump)
    )
    os.set_blocking(controller.descriptor, False)

    with pytest.raises(BlockingIOError):
        os.read(controller.descriptor, 1)


def test_loop_is_a_port_like_any_other(monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[serial.SerialBase] = []
    real = serial.serial_for_url

    def remembered(*arguments: object, **settings: object) -> serial.SerialBase:
        opened.append(real(*arguments, **settings))  # type: ignore[arg-type]
        return opened[-1]

    monkeypatch.setattr(serial, "serial_for_url", remembered)
    found = capture_points("loop://", PROFILE, ready=lambda _: opened[0].write(b"1,2,3\r\n4,5,6\r\n"))

    assert found.points.points_mm.tolist() == [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]
