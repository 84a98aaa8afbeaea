"""A journal gives back what was written, wherever it was torn off."""

from __future__ import annotations

import errno
import os
import threading
from pathlib import Path

import pytest

from cmm_align.device import journal as journals
from cmm_align.device.journal import FROM_CLIENT, RECEIVED, JournalWriter, Record, framed, read_journal
from cmm_align.errors import MalformedInputError, MissingFileError, OutputError

SETTINGS = {"profile": {"dialect": "xyz"}, "expect": None}
RECORDS = (
    Record(RECEIVED, 0.25, b"1,2,3\r\n4,"),
    Record(FROM_CLIENT, 1.5, b""),
    Record(RECEIVED, 1e6, bytes(range(0, 256, 8))),
)


@pytest.fixture
def written(tmp_path: Path) -> Path:
    """A journal of three records and an end."""
    with JournalWriter(tmp_path / "part.journal", SETTINGS) as writer:
        for record in RECORDS:
            writer.append(*record)
        writer.end(1e6, {"end_reason": "idle"})
    return tmp_path / "part.journal"


def test_what_was_written_comes_back(written: Path) -> None:
    found = read_journal(written)

    assert found.settings == SETTINGS
    assert found.records == RECORDS
    assert found.end == {"end_reason": "idle"}
    assert found.torn_bytes == 0


def test_every_whole_record_survives_a_tear_at_every_byte(written: Path, tmp_path: Path) -> None:
    whole = written.read_bytes()
    start = whole.index(b"\n") + 1
    ends = [start]
    for record in RECORDS:
        ends.append(ends[-1] + len(framed(*record)))
    torn = tmp_path / "torn.journal"
    for cut in range(start, len(whole)):
        torn.write_bytes(whole[:cut])
        found = read_journal(torn)

        kept = sum(end <= cut for end in ends[1:])
        assert found.records == RECORDS[:kept]
        assert found.torn_bytes == cut - ends[kept]
        assert found.end is None


def test_a_journal_without_its_whole_header_is_none(written: Path, tmp_path: Path) -> None:
    torn = tmp_path / "torn.journal"
    torn.write_bytes(written.read_bytes()[:20])

    with pytest.raises(MalformedInputError, match="no journal"):
        read_journal(torn)


def test_zeros_of_a_power_cut_are_a_tear(written: Path) -> None:
    with written.open("ab") as stream:
        stream.write(bytes(5000))

    assert read_journal(written).records == RECORDS
    assert read_journal(written).torn_bytes == 5000


def test_a_hole_is_an_error_with_its_place(written: Path) -> None:
    raw = bytearray(written.read_bytes())
    place = raw.index(b"1,2,3")
    raw[place] ^= 1
    written.write_bytes(raw)

    with pytest.raises(MalformedInputError, match=r"part.journal: byte \d+: .*damaged"):
        read_journal(written)


def test_every_flipped_bit_is_seen(written: Path) -> None:
    whole = written.read_bytes()
    start = whole.index(b"\n") + 1
    for place in range(start, len(whole)):
        raw = bytearray(whole)
        raw[place] ^= 0x10
        written.write_bytes(raw)
        try:
            found = read_journal(written)
        except MalformedInputError:
            continue

        assert found.end is None
        assert found.records == RECORDS  # only the last record, the end, may go without a word


def test_a_newer_version_is_refused(written: Path) -> None:
    written.write_bytes(written.read_bytes().replace(b"journal v1 ", b"journal v7 ", 1))

    with pytest.raises(MalformedInputError, match=r"version 7.*at most 1"):
        read_journal(written)


def test_a_journal_is_never_overwritten(written: Path) -> None:
    before = written.read_bytes()
    with JournalWriter(written, {}) as second, JournalWriter(written, {}) as third:
        assert second.path.name == "part.2.journal"
        assert third.path.name == "part.3.journal"
    assert written.read_bytes() == before


def test_a_journal_without_data_can_be_thrown_away_and_no_other(tmp_path: Path) -> None:
    empty, full = JournalWriter(tmp_path / "a.journal", {}), JournalWriter(tmp_path / "b.journal", {})
    full.append(RECEIVED, 0.0, b"1")
    empty.discard()
    full.discard()

    assert [path.name for path in tmp_path.iterdir()] == ["b.journal"]


def test_every_record_is_in_the_file_before_the_next(tmp_path: Path) -> None:
    with JournalWriter(tmp_path / "part.journal", {}) as writer:
        for number in range(5):
            writer.append(RECEIVED, float(number), b"x")

            assert len(read_journal(writer.path).records) == number + 1


def test_what_came_is_synced_without_waiting_for_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    synced = threading.Event()
    real = os.fsync
    monkeypatch.setattr(journals, "SYNC_S", 0.01)
    monkeypatch.setattr(journals.os, "fsync", lambda descriptor: (real(descriptor), synced.set()))
    with JournalWriter(tmp_path / "part.journal", {}) as writer:
        assert synced.wait(10.0)
        for _ in range(2):
            synced.clear()
            writer.append(RECEIVED, 0.0, b"1,2,3\n")

            assert synced.wait(10.0)


def test_a_full_disk_is_an_error_that_says_what_is_safe(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_descriptor: int, _data: bytes) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    with JournalWriter(tmp_path / "part.journal", {}) as writer:
        writer.append(RECEIVED, 0.0, b"1,2,3\n")
        monkeypatch.setattr(journals.os, "write", full)
        with pytest.raises(OutputError, match=r"No space left.*6 bytes before are safe"):
            writer.append(RECEIVED, 0.0, b"4,5,6\n")
        monkeypatch.undo()

    assert read_journal(writer.path).records == (Record(RECEIVED, 0.0, b"1,2,3\n"),)


def test_places_where_no_journal_can_be(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="cannot make the journal"):
        JournalWriter(tmp_path / "nowhere" / "part.journal", {})
    with pytest.raises(MissingFileError):
        read_journal(tmp_path / "missing.journal")
