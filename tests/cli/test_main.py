"""The single place that turns what goes wrong into an exit code."""

from __future__ import annotations

import io
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from conftest import Ran

import cmm_align
from cmm_align.cli import main
from cmm_align.cli.show import for_terminal

Cli = Callable[..., Ran]


def raising(error: BaseException) -> Callable[..., object]:
    def fail(*_: object, **__: object) -> object:
        raise error

    return fail


@pytest.mark.parametrize(
    ("error", "code", "word"),
    [
        (KeyboardInterrupt(), 130, "interrupted"),
        (main.Terminated(), 143, "terminated"),
        (MemoryError("80 GB"), 4, "80 GB"),
    ],
    ids=["ctrl-c", "sigterm", "memory"],
)
def test_an_end_from_outside_is_one_line(
    cli: Cli, monkeypatch: pytest.MonkeyPatch, error: BaseException, code: int, word: str
) -> None:
    monkeypatch.setattr(main.cmm_align, "invoke", raising(error))
    ran = cli("info", "x")

    assert ran.code == code
    assert word in ran.err
    assert len(ran.err.splitlines()) == 1


def test_a_bug_leaves_a_report_without_data(cli: Cli, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(main.cmm_align, "invoke", raising(ZeroDivisionError("a secret of the user")))
    ran = cli("info", "x")
    report = Path(ran.err.split()[-1])
    text = report.read_text()
    report.unlink()

    assert ran.code == 1
    assert len(ran.err.splitlines()) == 1
    assert cmm_align.__version__ in text
    assert "numpy" in text
    assert "ZeroDivisionError" in text
    assert "arguments: info x" in text
    assert "secret" not in text


def test_help_and_version_end_well(cli: Cli) -> None:
    assert cli("--help").code == 0
    assert cli("align", "--help").code == 0
    assert cmm_align.__version__ in cli("--version").out
    assert cli().code == 2


@pytest.mark.skipif(sys.platform == "win32", reason="pipes of another kind")
def test_a_reader_that_goes_away_is_no_error(sample_data: Path) -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "cmm_align", "info", str(sample_data / "nominal.h5"), "--json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()
    errors = process.stderr.read()
    process.stderr.close()

    assert process.wait() in {0, 141}
    assert errors == b""


@pytest.mark.skipif(sys.platform == "win32", reason="no such signal")
def test_sigterm_is_answered() -> None:
    code = (
        "import os, signal, sys\n"
        "from cmm_align.cli import main\n"
        "main.cmm_align.invoke = lambda _: os.kill(os.getpid(), signal.SIGTERM)\n"
        "sys.argv = ['cmm-align', 'info', 'x']\n"
        "main.run()\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)

    assert done.returncode == 128 + signal.SIGTERM
    assert done.stderr == "cmm-align: terminated\n"


def test_importing_the_package_or_listing_the_commands_loads_nothing_heavy() -> None:
    code = (
        "import sys, cmm_align\n"
        "from cmm_align.cli.main import outcome_of\n"
        "outcome_of(['--help']); outcome_of(['align', '--help'])\n"
        "heavy = {'numpy', 'scipy', 'h5py', 'rich', 'matplotlib', 'serial'} & set(sys.modules)\n"
        "sys.exit(','.join(sorted(heavy)) or 0)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)

    assert done.stderr == ""
    assert done.returncode == 0


def test_the_public_api_is_there() -> None:
    for name in cmm_align.__all__:
        assert getattr(cmm_align, name) is not None
    assert set(cmm_align.__all__) <= set(dir(cmm_align))
    with pytest.raises(AttributeError, match="nothing"):
        cmm_align.nothing  # noqa: B018 - the access is the test


@pytest.mark.skipif(sys.platform != "linux", reason="names are Unicode elsewhere")
def test_a_stream_that_cannot_show_a_name_stops_nothing(sample_data: Path, tmp_path: Path) -> None:
    odd = os.fsencode(tmp_path) + b"/p\xff.csv"
    Path(os.fsdecode(odd)).write_bytes((sample_data / "part.csv").read_bytes())
    plain = {**os.environ, "PYTHONIOENCODING": "ascii:strict"}
    start = [sys.executable, "-m", "cmm_align"]
    aligned = subprocess.run(
        [*start, "align", odd, sample_data / "nominal.h5"], capture_output=True, env=plain, check=False
    )
    missing = subprocess.run([*start, "info", odd + b"x"], capture_output=True, env=plain, check=False)

    assert aligned.returncode == 0, aligned.stderr
    assert b"p?.align.h5" in aligned.stdout
    assert missing.returncode == 3
    assert len(missing.stderr.splitlines()) == 1


def test_a_bug_report_survives_any_name(cli: Cli, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(main.cmm_align, "invoke", raising(ZeroDivisionError()))
    ran = cli("info", "p\udcff")
    report = Path(ran.err.split()[-1])
    text = report.read_text()
    report.unlink()

    assert ran.code == 1
    assert "arguments: info p\\udcff" in text


@pytest.mark.parametrize(("encoding", "sign"), [("utf-8", "\N{MICRO SIGN}"), ("ascii", "u")])
def test_a_terminal_gets_the_micro_sign_where_it_can_show_it(encoding: str, sign: str) -> None:
    class Terminal(io.StringIO):
        def __init__(self) -> None:
            super().__init__()
            self.tty = True

        encoding = property(lambda _: encoding)

        def isatty(self) -> bool:
            return self.tty

    stream = Terminal()
    text = "PV 4.5 um, rx 3 urad, um/part.csv"
    assert for_terminal(text, stream) == f"PV 4.5 {sign}m, rx 3 {sign}rad, um/part.csv"
    stream.tty = False
    assert for_terminal(text, stream) == text


def test_the_matrix_library_gets_one_thread_unless_the_user_says_otherwise(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    for given, used in ((None, "1"), ("4", "4")):
        monkeypatch.setattr(sys, "argv", ["cmm-align", "--version"])
        monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
        if given is not None:
            monkeypatch.setenv("OPENBLAS_NUM_THREADS", given)
        before = signal.getsignal(signal.SIGTERM)
        with pytest.raises(SystemExit):
            main.run()
        signal.signal(signal.SIGTERM, before)

        assert os.environ["OPENBLAS_NUM_THREADS"] == used
    capfd.readouterr()
