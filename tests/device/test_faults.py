"""A bad line is bad in the same way each time, and only as bad as it was told to be."""

from __future__ import annotations

import pytest

from cmm_align.device.faults import NONE, Chunk, Faults, faults_of, faulty
from cmm_align.errors import UsageError

CHUNKS = tuple(Chunk(float(i), bytes((i + j) % 256 for j in range(40))) for i in range(10))
WHOLE = b"".join(chunk.data for chunk in CHUNKS)


def data_of(chunks: tuple[Chunk, ...]) -> bytes:
    return b"".join(chunk.data for chunk in chunks)


def test_without_faults_nothing_changes() -> None:
    assert faulty(CHUNKS, NONE, 1) == (CHUNKS, False)


def test_the_seed_decides() -> None:
    faults = Faults(drop=5, flip=5, split=3)

    assert faulty(CHUNKS, faults, 1) == faulty(CHUNKS, faults, 1)
    assert faulty(CHUNKS, faults, 1) != faulty(CHUNKS, faults, 2)


@pytest.mark.parametrize("seed", range(20))
def test_as_many_bytes_are_lost_as_asked_for(seed: int) -> None:
    left = iter(WHOLE)
    found = data_of(faulty(CHUNKS, Faults(drop=7), seed)[0])

    assert len(found) == len(WHOLE) - 7
    assert all(byte in left for byte in found)  # what is left is in its old order


@pytest.mark.parametrize("seed", range(20))
def test_as_many_bits_are_turned_as_asked_for(seed: int) -> None:
    found = data_of(faulty(CHUNKS, Faults(flip=7), seed)[0])

    assert len(found) == len(WHOLE)
    assert sum((a ^ b).bit_count() for a, b in zip(found, WHOLE, strict=True)) == 7


def test_pieces_are_short_and_lose_nothing() -> None:
    found, _ = faulty(CHUNKS, Faults(split=3), 5)

    assert data_of(found) == WHOLE
    assert {len(chunk.data) for chunk in found} == {1, 2, 3}


def test_a_stall_is_one_pause() -> None:
    found, broken = faulty(CHUNKS, Faults(stall=2.5), 3)
    late = [after.time_s - before.time_s for before, after in zip(CHUNKS, found, strict=True)]

    assert data_of(found) == WHOLE
    assert not broken
    assert late == sorted(late)
    assert set(late) <= {0.0, 2.5}
    assert late[-1] == 2.5


@pytest.mark.parametrize("share", [0.0, 0.31, 0.99])
def test_a_line_breaks_after_its_share(share: float) -> None:
    found, broken = faulty(CHUNKS, Faults(disconnect=share), 0)

    assert broken
    assert data_of(found) == WHOLE[: int(share * len(WHOLE))]


def test_more_faults_than_bytes_are_no_problem() -> None:
    assert data_of(faulty(CHUNKS, Faults(drop=10_000), 0)[0]) == b""
    assert faulty((), Faults(drop=1, flip=1, split=1, stall=1.0), 0) == ((), False)


def test_faults_as_they_are_written() -> None:
    assert faults_of("", "url") == NONE
    assert faults_of("drop:3,flip:1,split:7,stall:2.5,disconnect:0.4", "url") == Faults(3, 1, 7, 2.5, 0.4)


@pytest.mark.parametrize("text", ["drop", "drop:-1", "drop:x", "drop:1.5", "stall:nan", "stall:inf"])
def test_a_fault_needs_its_number(text: str) -> None:
    with pytest.raises(UsageError, match="and a number"):
        faults_of(text, "url")


def test_the_known_faults_are_named() -> None:
    with pytest.raises(UsageError, match=r"unknown fault 'dorp'.*drop, flip"):
        faults_of("dorp:1", "url")
