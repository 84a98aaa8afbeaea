"""The ledger's file: all or nothing, two writers at once, and what it must refuse."""

from __future__ import annotations

import json
import math
import os
import platform
import sqlite3
import subprocess
import sys
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest

from cmm_align.errors import (
    InputError,
    MalformedInputError,
    MissingFileError,
    OutputLockedError,
    WrongStageError,
)
from cmm_align.io import ledger_file
from cmm_align.io.ledger_file import add_dressing, adding_pass, create_ledger, read_ledger
from cmm_align.model import BandRecord, BandResponse, Ledger, LedgerPass, PassOutcome, WaveBand

BANDS = (WaveBand(30.0, math.inf), WaveBand(15.0, 30.0))
EMPTY = Ledger("n" * 64, "MCG 250", "D46", "2026-01-31T12:00:00Z", BANDS)


def a_pass(part: str = "W1", number: int = 1, **changes) -> LedgerPass:
    """Return a pass with numbers that are all different."""
    row = LedgerPass(
        part=part,
        pass_number=number,
        time_utc="2026-01-31T12:00:00Z",
        map_digest=f"map {part} {number}",
        nominal_digest="n" * 64,
        correction_digest=f"correction {part} {number}",
        previous_map_digest=f"map {part} {number - 1}" if number > 1 else "",
        n=2015,
        pv_um=27.25,
        rms_um=4.5,
        map_pv_um=26.5,
        map_rms_um=4.25,
        u_rms_um=0.0625,
        pvr_um=float("nan"),
        constant_um=1.5,
        u_constant_um=0.5,
        told_constant_um=-0.25,
        gain_rule="fixed",
        gain=1.0,
        predicted_rms_um=1.125,
        predicted_rms_low_um=0.75,
        predicted_rms_high_um=1.75,
        predicted_pv_um=7.0,
        predicted_pv_low_um=6.0,
        predicted_pv_high_um=8.0,
        floor_um=0.625,
        bands=(BandRecord(4.0, 3.5), BandRecord(0.5, 0.375)),
    )
    return replace(row, **changes)


def outcome(row: LedgerPass) -> PassOutcome:
    """Return what came of the pass before a row."""
    return PassOutcome(row.map_digest, row.time_utc, 1.25, 7.5, (BandResponse(3.0, 0.5, 0.0625), None))


def added(path: Path, row: LedgerPass, came: PassOutcome | None = None, **settings) -> bool:
    with adding_pass(path, row, came, **settings) as changed:
        return changed


@pytest.fixture
def path(tmp_path: Path) -> Path:
    file = tmp_path / "window.ledger.sqlite"
    create_ledger(file, EMPTY)
    return file


def test_what_was_added_comes_back_number_for_number(path):
    first, second = a_pass(), a_pass(number=2, pvr_um=5.5, constant_um=None)
    assert added(path, first)
    assert added(path, second, outcome(second))
    add_dressing(path, "2026-02-01T12:00:00Z", "D20")
    found = read_ledger(path)
    assert found.bands == BANDS
    assert (found.nominal_digest, found.machine, found.wheel) == ("n" * 64, "MCG 250", "D46")
    assert math.isnan(found.passes[0].pvr_um)
    assert found.passes[0].came == outcome(second)
    assert replace(found.passes[0], pvr_um=0.0, came=None) == replace(first, pvr_um=0.0)
    assert found.passes[1] == second
    assert [(d.wheel, d.after_passes) for d in found.dressings] == [("D20", 2)]
    assert list(path.parent.iterdir()) == [path]  # no lock, no journal


def test_an_empty_ledger_is_one(path):
    assert read_ledger(path) == EMPTY


def test_an_error_in_the_block_leaves_the_ledger_as_it_was(path):
    before = path.read_bytes()
    with pytest.raises(ZeroDivisionError), adding_pass(path, a_pass(), None):
        _ = 1 / 0
    assert path.read_bytes() == before
    assert list(path.parent.iterdir()) == [path]


def test_the_same_pass_twice_is_there_once(path):
    assert added(path, a_pass())
    assert not added(path, a_pass())
    assert len(read_ledger(path).passes) == 1


def test_another_correction_of_the_same_map_takes_its_place_until_it_was_ground(path):
    added(path, a_pass())
    assert added(path, a_pass(correction_digest="gain 0.7"))
    assert [p.correction_digest for p in read_ledger(path).passes] == ["gain 0.7"]
    second = a_pass(number=2)
    added(path, second, outcome(second))
    with pytest.raises(WrongStageError, match="pass 1 of W1, which was ground with another correction"):
        added(path, a_pass(correction_digest="gain 0.5"))


def test_another_map_of_the_same_pass_needs_another_part_or_a_word(path):
    added(path, a_pass())
    other = a_pass(map_digest="measured again")
    with pytest.raises(WrongStageError, match="--part"):
        added(path, other)
    assert added(path, other, replace=True)
    assert [p.map_digest for p in read_ledger(path).passes] == ["measured again"]
    assert added(path, a_pass(part="W2"))


def test_a_pass_whose_predecessor_is_not_in_the_ledger_is_added_alone(path):
    third = a_pass(number=3)
    assert added(path, third, outcome(third))
    assert [p.came for p in read_ledger(path).passes] == [None]


def test_creating_twice_keeps_what_is_there(path):
    added(path, a_pass())
    create_ledger(path, EMPTY)
    assert len(read_ledger(path).passes) == 1


WRITER = """
import sys
sys.path.insert(0, {tests!r})
from test_ledger_file import a_pass, added
from pathlib import Path
for number in range(1, 9):
    added(Path({path!r}), a_pass(part=sys.argv[1], number=number))
"""


def test_two_runs_at_once_are_both_there(path):
    code = WRITER.format(tests=str(Path(__file__).parent), path=str(path))
    runs = [subprocess.Popen([sys.executable, "-c", code, part]) for part in ("left", "right")]
    assert [run.wait() for run in runs] == [0, 0]
    found = [(p.part, p.pass_number) for p in read_ledger(path).passes]
    assert sorted(found) == [(part, k) for part in ("left", "right") for k in range(1, 9)]


def test_a_ledger_that_another_run_holds_says_who(path, monkeypatch):
    monkeypatch.setattr(ledger_file, "TIMEOUT_S", 0.0)
    with (
        adding_pass(path, a_pass(), None),
        pytest.raises(OutputLockedError, match=f"process {os.getpid()} on"),
    ):
        added(path, a_pass(part="W2"))
    assert [p.part for p in read_ledger(path).passes] == ["W1"]


def test_another_program_that_writes_it_is_waited_for_and_named(path, monkeypatch):
    monkeypatch.setattr(ledger_file, "TIMEOUT_S", 0.0)
    with closing(sqlite3.connect(path, isolation_level=None)) as other:
        other.execute("BEGIN EXCLUSIVE")
        with pytest.raises(OutputLockedError, match="another program"):
            added(path, a_pass())
        with pytest.raises(OutputLockedError, match="another program"):
            read_ledger(path)


def test_the_lock_of_a_dead_run_is_taken_over_and_the_ledger_stays(path):
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    lock = path.with_name(path.name + ".lock")
    lock.write_text(json.dumps({"pid": dead.pid, "host": platform.node(), "temporary": ""}))
    assert added(path, a_pass())
    assert len(read_ledger(path).passes) == 1


@pytest.mark.parametrize("content", [b"", b"part,pv\n1,27.3\n", b"SQLite format 3\0 and no more"])
def test_what_is_no_ledger_is_refused(tmp_path, content):
    file = tmp_path / "notes.sqlite"
    file.write_bytes(content)
    for use in (read_ledger, lambda f: added(f, a_pass())):
        with pytest.raises(MalformedInputError):
            use(file)
    assert file.read_bytes() == content


def test_the_database_of_another_program_is_left_alone(tmp_path):
    file = tmp_path / "shop.sqlite"
    with closing(sqlite3.connect(file)) as base:
        base.execute("CREATE TABLE pass (id INTEGER)")
        base.commit()
    before = file.read_bytes()
    for use in (read_ledger, lambda f: added(f, a_pass()), lambda f: add_dressing(f, "now")):
        with pytest.raises(MalformedInputError, match="another program"):
            use(file)
    assert file.read_bytes() == before


def test_a_newer_version_is_refused(path):
    with closing(sqlite3.connect(path)) as base:
        base.execute(f"PRAGMA user_version = {ledger_file.VERSION + 1}")
    with pytest.raises(InputError, match="at most 1"):
        read_ledger(path)


def test_a_damaged_ledger_is_an_error_not_a_number(path):
    added(path, a_pass())
    with closing(sqlite3.connect(path)) as base:
        base.execute("UPDATE pass_band SET deviation_rms_um = 'much'")
        base.commit()
    with pytest.raises(MalformedInputError, match="damaged"):
        read_ledger(path)


def test_no_file_is_a_missing_one(tmp_path):
    with pytest.raises(MissingFileError, match="--ledger FILE"):
        read_ledger(tmp_path / "none.sqlite")
    assert list(tmp_path.iterdir()) == []


def test_every_column_with_a_length_says_its_unit(path):
    with closing(sqlite3.connect(path)) as base:
        names = [
            row[1] for t in ("pass", "pass_band", "band") for row in base.execute(f"PRAGMA table_info({t})")
        ]
    plain = {"gain", "transfer", "u_transfer", "n", "id", "pass_id", "band", "number", "pass_number", "part"}
    assert all(n in plain or n.endswith(("_um", "_mm", "_utc", "_digest", "_rule")) for n in names), names


def test_a_new_ledger_stays_only_if_its_first_pass_was_written(tmp_path: Path) -> None:
    path = tmp_path / "new.ledger"

    with pytest.raises(ZeroDivisionError), adding_pass(path, a_pass(), None, new=EMPTY):
        raise ZeroDivisionError
    assert list(tmp_path.iterdir()) == []

    with adding_pass(path, a_pass(), None, new=EMPTY):
        pass
    assert len(read_ledger(path).passes) == 1
