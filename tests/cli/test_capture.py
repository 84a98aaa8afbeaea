"""`cmm-align capture`: exit codes, JSON keys, what is written, and what the operator is told."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from conftest import Ran

import cmm_align as ca
from cmm_align.cli.capture_report import warnings_of
from cmm_align.cli.live_line import line_of
from cmm_align.device.capture import capture_points, settings_for
from cmm_align.device.intake import Progress
from cmm_align.device.journal import FROM_CLIENT, RECEIVED, JournalWriter, read_journal
from cmm_align.device.tap import Tapped
from cmm_align.dialects import Hit

if TYPE_CHECKING:
    from controller import Controller

Cli = Callable[..., Ran]

COMMAND = (sys.executable, "-m", "cmm_align", "capture")
KEYS = {"n_points", "n_bytes", "n_rejected", "complete", "end_reason", "raw_log"}
"""Of `result`, as the interface promises."""

DUMP = b"".join(b"%.4f,%.4f,%.4f\r\n" % (i / 7.0, -i / 3.0, 10.0 + i / 11.0) for i in range(40))
PROFILE = """
name = "shop"
dialect = "xyz"
baud = 115200
kind = "tip_centre"
tip_radius_mm = 1.5
idle_end_s = 0.2
first_data_timeout_s = 10
start_command = "press F5"
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("shop.toml").write_text(PROFILE)
    Path("dump.txt").write_bytes(DUMP)
    return tmp_path


@pytest.fixture
def controller() -> Iterator[Controller]:
    if sys.platform == "win32":
        pytest.skip("Windows has no pseudo terminals")
    from controller import plugged_in

    with plugged_in() as machine:
        yield machine


def capture(controller: Controller, *arguments: str, says: bytes) -> tuple[int, str, str]:
    """Capture in a process of its own; the controller talks when the operator is told to start it."""
    with subprocess.Popen(
        [*COMMAND, controller.port, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as running:
        assert running.stderr is not None
        told = running.stderr.readline()
        controller.say(says)
        out, err = running.communicate(timeout=30)
    return running.returncode, out, told + err


@contextmanager
def reading(controller: Controller, folder: Path, says: bytes) -> Iterator[subprocess.Popen[str]]:
    """A capture without an end in sight that has just taken what the controller says."""
    with subprocess.Popen(
        [*COMMAND, controller.port, "--idle-end", "1min", "-o", "part.csv"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as running:
        assert running.stderr is not None
        running.stderr.readline()
        controller.say(says).join()
        while sum(len(r.data) for r in read_journal(folder / "part.journal").records) < len(says):
            pass  # the process is reading: this ends
        yield running


def refused(ran: Ran, code: int, *words: str) -> None:
    assert ran.code == code, ran.err
    assert ran.out == ""
    assert len(ran.err.splitlines()) == 1, ran.err
    for word in words:
        assert word in ran.err


def test_a_port_is_captured_and_its_journal_gives_the_same_file(
    controller: Controller, folder: Path, cli: Cli
) -> None:
    code, out, err = capture(controller, "--profile", "shop.toml", "-o", "part.csv", "--json", says=DUMP)
    document = json.loads(out)
    result = document["result"]

    assert code == 0
    assert set(result) >= KEYS
    assert (result["n_points"], result["n_bytes"], result["n_rejected"]) == (40, len(DUMP), 0)
    assert (result["complete"], result["end_reason"], result["raw_log"]) == (True, "idle", "part.journal")
    assert document["outputs"] == ["part.csv", "part.journal"]
    assert document["warnings"] == []
    assert "start the dump now (press F5)" in err
    assert b"".join(record.data for record in read_journal("part.journal").records) == DUMP

    again = cli("capture", "--replay", "part.journal", "-o", "again.csv", "--json")
    assert again.code == 0
    assert Path("again.csv").read_bytes() == Path("part.csv").read_bytes()
    for key in KEYS:
        assert again.result[key] == result[key]
    points = ca.read("part.csv")
    assert isinstance(points, ca.PointSet)
    assert points.kind is ca.PointKind.TIP_CENTRE
    np.testing.assert_allclose(
        points.points_mm, np.loadtxt(DUMP.splitlines(), delimiter=","), rtol=0.0, atol=1e-9
    )


def test_a_second_capture_keeps_the_first_journal(controller: Controller, folder: Path) -> None:
    for number, name in enumerate(["part.journal", "part.2.journal"]):
        code, out, _ = capture(
            controller, "--profile", "shop.toml", "-o", "part.csv", "--overwrite", "--expect", "40", "--json",
            says=DUMP,
        )  # fmt: skip

        assert code == 0
        assert json.loads(out)["result"]["raw_log"] == name
        assert len(list(folder.glob("*.journal"))) == number + 1


def test_ctrl_c_writes_what_came_and_exits_with_130(controller: Controller, folder: Path) -> None:
    with reading(controller, folder, DUMP) as running:
        running.send_signal(signal.SIGINT)
        _, err = running.communicate(timeout=30)

    assert running.returncode == 130
    assert "not complete: interrupted" in err
    assert "Traceback" not in err
    assert len(ca.read("part.csv")) == 40
    assert (read_journal(folder / "part.journal").end or {})["end_reason"] == "interrupted"


def test_a_hang_up_exits_with_7_and_keeps_what_came(controller: Controller, folder: Path) -> None:
    with reading(controller, folder, DUMP + b"1.5,2") as running:
        controller.hang_up()
        out, err = running.communicate(timeout=30)

    assert running.returncode == 7
    assert "NOT COMPLETE" in out
    assert "unplugged" in err
    assert "breaks off inside a line" in err
    assert len(ca.read("part.csv")) == 40


def test_silence_says_what_to_look_at(controller: Controller, folder: Path, cli: Cli) -> None:
    Path("quick.toml").write_text(PROFILE.replace("first_data_timeout_s = 10", "first_data_timeout_s = 0.05"))
    ran = cli("capture", controller.port, "--profile", "quick.toml", "-q")

    refused(ran, 7, "did you start the dump", "cable", "115200 baud 8N1")
    assert sorted(path.name for path in folder.iterdir()) == ["dump.txt", "quick.toml", "shop.toml"]


def test_a_dump_replays_beside_itself(folder: Path, cli: Cli) -> None:
    ran = cli("capture", "--replay", "dump.txt", "--json")

    assert ran.code == 0
    assert ran.json["outputs"] == ["dump.csv"]
    assert ran.json["inputs"][0]["path"] == "dump.txt"
    assert (ran.result["end_reason"], ran.result["raw_log"]) == ("end_of_file", "dump.txt")
    assert ran.err == ""


def test_replay_is_the_short_form_of_its_url(folder: Path, cli: Cli) -> None:
    assert cli("capture", "--replay", "dump.txt", "-o", "a.csv", "-q").code == 0
    assert cli("capture", "replay://dump.txt?chunk=3", "-o", "b.csv", "-q").code == 0
    assert Path("a.csv").read_bytes() == Path("b.csv").read_bytes()


def test_a_dump_called_csv_is_not_overwritten(folder: Path, cli: Cli) -> None:
    Path("dump.txt").rename("dump.csv")
    ran = cli("capture", "--replay", "dump.csv", "--json", "--overwrite")

    assert ran.json["outputs"] == ["dump.points.csv"]
    assert Path("dump.csv").read_bytes() == DUMP
    refused(cli("capture", "--replay", "dump.csv", "-o", "dump.csv", "--overwrite"), 8, "also an input")


def test_an_output_that_exists_is_refused_before_the_port_is_opened(folder: Path, cli: Cli) -> None:
    Path("part.csv").write_text("mine")

    refused(cli("capture", "/dev/ttyUSB99", "-o", "part.csv"), 8, "exists", "--overwrite")
    refused(cli("capture", "/dev/ttyUSB99", "-o", "nowhere/part.csv"), 8, "no folder")


def test_rejected_lines_are_listed_with_their_place(folder: Path, cli: Cli) -> None:
    bad = DUMP + b"".join(b"1.5,2.%d,x%d\r\n" % (i, i) for i in range(12)) + DUMP
    Path("bad.txt").write_bytes(bad)
    ran = cli("capture", "--replay", "bad.txt", "--json")

    assert ran.code == 0
    assert (ran.result["n_points"], ran.result["n_rejected"], ran.result["complete"]) == (80, 12, True)
    assert len(ran.result["rejected"]) == 10
    assert "12 lines should be points and are none" in ran.json["warnings"][0]
    assert "first 10" in ran.json["warnings"][0]
    assert "bad.txt:41:9: '1.5,2.0,x0'" in ran.json["warnings"][1]
    assert len(ran.json["warnings"]) == 11


def test_strict_refuses_a_rejected_line_and_writes_nothing(folder: Path, cli: Cli) -> None:
    Path("bad.txt").write_bytes(DUMP + b"1.5,2.5,x\r\n" + DUMP)
    before = sorted(folder.iterdir())

    refused(cli("capture", "--replay", "bad.txt", "--strict"), 3, "bad.txt:41:9", "1 line", "1.5,2.5,x")
    assert sorted(folder.iterdir()) == before


def test_a_fragment_at_the_end_is_no_point_and_not_complete(folder: Path, cli: Cli) -> None:
    Path("cut.txt").write_bytes(DUMP[:-7])
    ran = cli("capture", "--replay", "cut.txt", "--json")

    assert ran.code == 7
    assert (ran.result["n_points"], ran.result["complete"]) == (39, False)
    assert "breaks off inside a line" in ran.json["warnings"][0]
    assert "NOT COMPLETE" in Path("cut.csv").read_text()


def test_numbers_of_the_points_are_kept(folder: Path, cli: Cli) -> None:
    Path("ids.txt").write_bytes(b"".join(b"%d %d 2 3\r\n" % (i, i * i) for i in range(5, 15)))
    Path("ids.toml").write_text('dialect = "xyz"\ncolumns = "id,x,y,z"\nunits = "inch"\n')
    ran = cli("capture", "--replay", "ids.txt", "--profile", "ids.toml", "-o", "ids.csv", "--json")
    points = ca.read("ids.csv")

    assert ran.code == 0
    assert isinstance(points, ca.PointSet)
    assert points.ids.tolist() == [*range(5, 15)]
    assert points.points_mm[0].tolist() == [635.0, 50.8, 76.2]


def test_the_unit_of_a_machine_without_a_profile(folder: Path, cli: Cli) -> None:
    assert cli("capture", "--replay", "dump.txt", "--units", "um", "-o", "um.csv", "-q").code == 0
    np.testing.assert_allclose(ca.read("um.csv").points_mm[7], [1e-3, -7e-3 / 3, 10.6364e-3], atol=1e-6)
    ran = cli("capture", "--replay", "dump.txt", "--units", "um", "--profile", "shop.toml")
    refused(ran, 2, "--units um", "mm")


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        ((), 2, "one source"),
        (("/dev/ttyS0", "--replay", "dump.txt"), 2, "one source"),
        (("/dev/ttyUSB99",), 7, "no such port"),
        (("part.txt",), 7, "no such port"),
        (("dump.txt",), 7, "--replay dump.txt"),
        (("wire://x",), 7, "wire:// is unknown"),
        (("socket://127.0.0.1:1",), 7, "cannot connect"),
        (("replay://dump.txt?sped=1",), 2, "'sped'"),
        (("--replay", "missing.txt"), 3, "cannot read"),
        (("--replay", "dump.txt", "--profile", "missing.toml"), 3, "missing.toml"),
        (("--replay", "dump.txt", "--profile", "bad.toml"), 2, "did you mean 'baud'"),
        (("--replay", "dump.txt", "--idle-end", "3h"), 2, "3h"),
        (("--replay", "dump.txt", "--idle-end", "0"), 2, "above zero"),
        (("--replay", "dump.txt", "--expect", "0"), 2, "--expect"),
        (("--tap", "here"), 2, "LISTEN=HOST:PORT"),
    ],
)
def test_a_mistake_is_one_line(
    folder: Path, cli: Cli, arguments: tuple[str, ...], code: int, words: str
) -> None:
    Path("bad.toml").write_text(PROFILE.replace("baud", "buad"))
    before = sorted(folder.iterdir())

    refused(cli("capture", *arguments), code, words)
    assert sorted(folder.iterdir()) == before


def test_garbage_names_its_likely_cause(folder: Path, cli: Cli) -> None:
    def even(byte: int) -> int:
        return byte | 0x80 if byte.bit_count() % 2 else byte

    Path("parity.txt").write_bytes(bytes(even(byte) for byte in DUMP))
    ran = cli("capture", "--replay", "parity.txt")

    assert ran.code in {3, 7}
    assert "parity" in ran.err


def test_a_tap_becomes_points(folder: Path, cli: Cli, monkeypatch: pytest.MonkeyPatch) -> None:
    def tapped(_listen: object, _server: object, journal: Path, profile: object, **_: object) -> object:
        with JournalWriter(journal, settings_for("tap", profile, None)) as writer:
            writer.append(FROM_CLIENT, 0.0, b"00001 PtMeas(X(1),Y(2),Z(3))\r\n")
            writer.append(RECEIVED, 0.1, b"00001 &\r\n00001 # X(1.5), Y(2.5), Z(3.5)\r\n00001 %\r\n")
            writer.end(0.2, {"end_reason": "interrupted"})
        return Tapped(writer.path, 1, 1, True)

    monkeypatch.setattr("cmm_align.device.tap.tap", tapped)
    ran = cli("capture", "--tap", "1294=10.0.0.7:1294", "-o", "part.csv", "--json")

    assert ran.code == 130
    assert ran.result["n_points"] == 1
    assert ran.result["dialect"] == "ipp"
    assert ran.json["outputs"] == ["part.csv", "part.journal"]


def test_a_rival_at_the_port_is_named(folder: Path) -> None:
    captured = capture_points("replay://dump.txt")
    shared = replace(captured, other_readers=("minicom (process 7)",))

    assert warnings_of(captured) == []
    assert "minicom (process 7) had the port open too" in warnings_of(shared)[0]


def test_the_live_line_says_points_rate_place_and_the_time_left() -> None:
    waiting = Progress(0.1, 0, 0, 0, 0.0, None, None)
    running = Progress(2.0, 41, 2, 900, 20.4, Hit(1.0, -2.5, 3.25), 1.25)

    assert "waiting for the first byte" in line_of(waiting, None)
    text = line_of(running, 100)
    for word in ("41 of 100 points", "20/s", "2 rejected", "1.0000 -2.5000 3.2500 mm", "1.2 s of silence"):
        assert word in text


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo terminals")
def test_the_line_moves_on_a_terminal_and_leaves_no_trace(controller: Controller, folder: Path) -> None:
    screen, terminal = os.openpty()
    with subprocess.Popen(
        [
            sys.executable,
            "-m",
            "cmm_align",
            "capture",
            controller.port,
            "--profile",
            "shop.toml",
            "-o",
            "p.csv",
        ],
        stderr=terminal,
        stdout=subprocess.DEVNULL,
        env={**os.environ, "TERM": "xterm", "COLUMNS": "120"},
    ) as running:
        os.close(terminal)
        shown = b""
        while b"start the dump now" not in shown:
            shown += os.read(screen, 1000)
        controller.say(DUMP)
        while True:
            try:
                shown += os.read(screen, 1000)
            except OSError:
                break
    os.close(screen)

    assert running.returncode == 0
    assert b"40 points" in shown
    assert b"s of silence" in shown


def test_a_journal_is_a_file_like_any_other(tmp_path: Path, cli: Cli) -> None:
    """`info`, Python and `align` read what a capture has recorded."""
    import cmm_align
    from cmm_align.device.journal import RECEIVED, JournalWriter
    from cmm_align.dialects import MachineProfile

    with JournalWriter(tmp_path / "part.journal", {"profile": asdict(MachineProfile())}) as writer:
        writer.append(RECEIVED, 0.0, b"1.5,2,3\r\n4,5,")
        writer.append(RECEIVED, 0.1, b"6\r\n7,8,9.25\r\n")
        writer.end(0.2, {"reason": "idle"})
    points = cmm_align.read(tmp_path / "part.journal")
    assert points.points_mm.tolist() == [[1.5, 2, 3], [4, 5, 6], [7, 8, 9.25]]
    ran = cli("info", tmp_path / "part.journal")
    assert ran.code == 0, ran.err
    assert "3 points" in ran.out
