"""An output appears whole or not at all; an old one survives everything."""

from __future__ import annotations

import json
import os
import platform
import signal
import subprocess
import sys
from functools import cache
from io import BytesIO
from pathlib import Path

import h5py
import pytest

from cmm_align import io
from cmm_align.errors import OutputError, OutputExistsError, OutputLockedError
from cmm_align.io.atomic import atomic_path, check_writable
from cmm_align.io.lock import lock_path
from cmm_align.io.patient_file import PatientFile
from cmm_align.provenance import this_step

DEAD_PID = 2**22 + 1  # above the largest a Linux kernel gives out


def only(folder: Path) -> list[str]:
    return sorted(p.name for p in folder.iterdir())


@cache
def ours():
    """Bytes of an older file of ours, whatever is in it."""
    buffer = BytesIO()
    with h5py.File(buffer, "w") as file:
        file.attrs["schema"] = "cmm-align/alignment"
    return buffer.getvalue()


def write(path, text, overwrite=False):
    with atomic_path(path, overwrite) as temporary:
        temporary.write_text(text)


def test_an_existing_output_is_refused_and_stays(alignment, tmp_path):
    out = tmp_path / "a.h5"
    out.write_bytes(ours())
    with pytest.raises(OutputExistsError, match="--overwrite"):
        io.write(alignment, out)
    assert out.read_bytes() == ours()
    io.write(alignment, out, overwrite=True)
    assert only(tmp_path) == ["a.h5"]
    io.read_alignment(out)


@pytest.mark.parametrize(
    ("name", "what"),
    [("no/a.h5", "there is no folder"), ("file/a.h5", "there is no folder"), ("dir", "folder")],
)
def test_a_place_that_cannot_be_written_is_refused_before_computing(name, what, tmp_path):
    (tmp_path / "file").write_text("")
    (tmp_path / "dir").mkdir()
    with pytest.raises(OutputError, match=what) as caught:
        check_writable(tmp_path / name, overwrite=True)
    assert caught.value.exit_code == 8


def test_an_input_is_never_the_output(tmp_path):
    (tmp_path / "a").write_text("x")
    (tmp_path / "b").symlink_to(tmp_path / "a")
    with pytest.raises(OutputError, match="also an input"):
        check_writable(tmp_path / "a", True, inputs=[tmp_path / "b"])


PNG = b"\x89PNG\r\n\x1a\n" + b"rest"
POINTS = b"# cmm-align points v1; units=mm\n1,2,3\n"


@pytest.mark.parametrize(
    ("name", "content", "good"),
    [
        ("a.h5", b"a thesis", False),
        ("a.hdf5", PNG, False),
        ("a.h5", b"", True),
        ("a.png", PNG, True),
        ("a.png", b"a thesis", False),
        ("a.svg", b"<?xml version='1.0'?><svg>", True),
        ("a.svg", b"a thesis", False),
        ("a.csv", POINTS, True),
        ("a.xyz", b"1 2 3\n", False),
        ("a.toml", b"units = 'mm'", True),
        ("a.dat", b"PK\0\0", False),
    ],
)
def test_only_a_file_of_the_same_kind_is_overwritten(name, content, good, tmp_path):
    out = tmp_path / name
    out.write_bytes(content)
    if good:
        check_writable(out, overwrite=True)
        return
    with pytest.raises(OutputExistsError, match="another name"):
        check_writable(out, overwrite=True)
    assert out.read_bytes() == content


def test_an_hdf5_file_of_somebody_else_is_not_overwritten(alignment, tmp_path):
    out = tmp_path / "a.h5"
    with h5py.File(out, "w") as file:
        file["precious"] = [1.0, 2.0]
    with pytest.raises(OutputExistsError, match="not a file of cmm-align"):
        io.write(alignment, out, overwrite=True)
    with h5py.File(out) as file:
        assert "precious" in file


@pytest.mark.skipif(sys.platform != "linux", reason="names are Unicode elsewhere")
def test_a_name_that_is_no_unicode_is_kept_in_the_provenance(alignment, tmp_path):
    source = Path(os.fsdecode(os.fsencode(tmp_path) + b"/p\xff.csv"))
    source.write_text("x")
    io.write(alignment, tmp_path / "a.h5", [this_step("align", {"from": str(source)}, [source])])
    (step,) = io.read_steps(tmp_path / "a.h5")
    assert step.inputs[0].path == str(source)


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, MemoryError, SystemExit])
def test_any_error_leaves_the_old_file_and_nothing_else(error, alignment, monkeypatch, tmp_path):
    (tmp_path / "a.h5").write_bytes(ours())

    def fail(*_):
        raise error

    monkeypatch.setattr("cmm_align.io.alignment_file.write_record", fail)
    with pytest.raises(error):
        io.write(alignment, tmp_path / "a.h5", overwrite=True)
    assert only(tmp_path) == ["a.h5"]
    assert (tmp_path / "a.h5").read_bytes() == ours()


def test_what_cannot_be_read_back_is_not_kept(alignment, monkeypatch, tmp_path):
    monkeypatch.setattr(
        "cmm_align.io.writing._shapes", lambda file, seen=[]: seen.append(0) or {"/x": (len(seen),)}
    )
    with pytest.raises(OutputError, match="not complete"):
        io.write(alignment, tmp_path / "a.h5")
    assert only(tmp_path) == []


def test_a_symbolic_link_is_kept_and_its_target_replaced(tmp_path):
    (tmp_path / "target").write_text("old")
    (tmp_path / "link").symlink_to("target")
    write(tmp_path / "link", "new", overwrite=True)
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "target").read_text() == "new"


def test_the_temporary_file_keeps_the_suffix(tmp_path):
    with atomic_path(tmp_path / "a.png") as temporary:
        assert temporary.suffix == ".png"
        assert temporary.parent == tmp_path
        temporary.write_text("x")


def test_a_block_that_writes_nothing_is_an_error(tmp_path):
    with pytest.raises(OutputError, match="cannot write it"), atomic_path(tmp_path / "a"):
        pass
    assert only(tmp_path) == []


def test_a_second_run_is_refused_at_once(tmp_path):
    with atomic_path(tmp_path / "a") as temporary:
        temporary.write_text("first")
        with pytest.raises(OutputLockedError, match=f"process {os.getpid()} on"):
            write(tmp_path / "a", "second")
    assert (tmp_path / "a").read_text() == "first"
    assert only(tmp_path) == ["a"]


@pytest.mark.parametrize(
    ("content", "taken"),
    [
        ({"pid": DEAD_PID, "host": platform.node(), "temporary": ".left"}, True),
        ({"pid": DEAD_PID, "host": "elsewhere", "temporary": ".left"}, False),
        ({"pid": os.getpid(), "host": platform.node(), "temporary": ".left"}, False),
        ({"pid": "x"}, False),
    ],
    ids=["dead here", "elsewhere", "alive", "unreadable"],
)
def test_only_the_lock_of_a_dead_process_here_is_taken_over(content, taken, tmp_path):
    out = tmp_path / "a"
    lock_path(out).write_text(json.dumps(content))
    (tmp_path / ".left").write_text("orphan")
    if taken:
        write(out, "new")
        assert only(tmp_path) == ["a"]
    else:
        with pytest.raises(OutputLockedError, match="remove"):
            write(out, "new")
        assert only(tmp_path) == [".left", "a.lock"]


def test_a_lock_never_removes_a_file_of_another_folder(tmp_path):
    (tmp_path / "precious").write_text("x")
    (tmp_path / "sub").mkdir()
    out = tmp_path / "sub" / "a"
    lock = {"pid": DEAD_PID, "host": platform.node(), "temporary": "../precious"}
    lock_path(out).write_text(json.dumps(lock))
    write(out, "new")
    assert (tmp_path / "precious").exists()


KILLED = """
import os, sys
from pathlib import Path
from cmm_align.io.atomic import atomic_path
with atomic_path(sys.argv[1], True) as temporary:
    temporary.write_text("half")
    print("ready", flush=True)
    sys.stdin.read()
"""


@pytest.mark.skipif(sys.platform == "win32", reason="no SIGKILL")
def test_a_killed_writer_leaves_the_old_file_and_the_next_run_cleans_up(tmp_path):
    out = tmp_path / "a"
    out.write_text("old")
    with subprocess.Popen(
        [sys.executable, "-c", KILLED, str(out)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as child:
        assert child.stdout.readline() == b"ready\n"
        child.send_signal(signal.SIGKILL)
    assert out.read_text() == "old"
    assert len(only(tmp_path)) == 3
    write(out, "new", overwrite=True)
    assert only(tmp_path) == ["a"]
    assert out.read_text() == "new"


DISK_FULL = """
import resource, signal, sys
sys.path.insert(0, sys.argv[2])
from conftest import _alignment
from cmm_align import io
from cmm_align.errors import OutputError
noun = _alignment(20000)
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[3]), int(sys.argv[3])))
try:
    io.write(noun, sys.argv[1], overwrite=True)
except OutputError as error:
    sys.exit(error.exit_code)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="no limit on file size")
@pytest.mark.parametrize("limit", [100, 5_000, 700_000])
def test_a_full_disk_leaves_the_old_file(limit, tmp_path):
    out = tmp_path / "a.h5"
    out.write_bytes(ours())
    here = str(Path(__file__).parent)
    run = subprocess.run(
        [sys.executable, "-c", DISK_FULL, str(out), here, str(limit)], capture_output=True, check=False
    )
    assert run.returncode == 8, run.stderr.decode()
    assert out.read_bytes() == ours()
    assert only(tmp_path) == ["a.h5"]


@pytest.mark.parametrize("call", [1, 2, 3, 6, 20])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interruption_while_hdf5_writes_waits_for_its_end(call, number, alignment, monkeypatch, tmp_path):
    out = tmp_path / "a.h5"
    out.write_bytes(ours())
    calls = []

    def write(self, data, real=PatientFile.write):
        calls.append(1)
        if len(calls) == call:
            signal.raise_signal(number)
        return real(self, data)

    def stop(_number, _frame):
        raise KeyboardInterrupt

    monkeypatch.setattr(PatientFile, "write", write)
    before = signal.signal(number, stop)
    try:
        with pytest.raises(KeyboardInterrupt):
            io.write(alignment, out, overwrite=True)
        assert signal.getsignal(number) is stop
    finally:
        signal.signal(number, before)
    assert out.read_bytes() == ours()
    assert only(tmp_path) == ["a.h5"]


def test_what_fails_in_the_midst_of_writing_is_told_after_hdf5_is_done(alignment, monkeypatch, tmp_path):
    full = OSError(28, "No space left on device")
    calls = []

    def write(self, data, real=PatientFile.write):
        calls.append(1)
        if len(calls) == 3:
            self.error = full
        return real(self, data)

    monkeypatch.setattr(PatientFile, "write", write)
    with pytest.raises(OutputError, match="No space left on device"):
        io.write(alignment, tmp_path / "a.h5")
    assert len(calls) > 3
    assert only(tmp_path) == []
