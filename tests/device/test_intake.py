"""Points from arrivals: the same ones in whatever pieces, and never one from a piece of a line."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from cmm_align.device.ending import Arrival, Ended, EndReason
from cmm_align.device.intake import Intake, Progress, take_in
from cmm_align.dialects import Hit, MachineProfile, Rejected
from cmm_align.errors import DeviceError

PROFILE = MachineProfile(idle_end_s=3.0, first_data_timeout_s=20.0)
END = Ended(EndReason.END_OF_FILE)


def taken(*pieces: bytes, profile: MachineProfile = PROFILE, expect: int | None = None) -> Intake:
    arrivals = [Arrival(float(number), piece) for number, piece in enumerate(pieces)]
    return take_in([*arrivals, END], profile, expect=expect)


def hits(intake: Intake) -> list[tuple[float, ...]]:
    return [event[:3] for event in intake.events if isinstance(event, Hit)]


def rejected(intake: Intake) -> list[Rejected]:
    return [event for event in intake.events if isinstance(event, Rejected)]


def test_a_cut_at_every_byte_gives_whole_lines_only(dump: bytes) -> None:
    start = dump[:700]
    points = hits(taken(dump))
    for cut in range(len(start) + 1):
        found = taken(start[:cut])

        # CR ends a line, so the last point is there before its LF is.
        assert hits(found) == points[: start[:cut].count(b"\r")]
        assert found.fragment == start[:cut].rpartition(b"\r")[2].strip()
        assert len(rejected(found)) == bool(found.fragment)
        assert found.n_bytes == cut


@pytest.mark.parametrize("size", [1, 2, 3, 17, 1000])
def test_the_pieces_do_not_matter(dump: bytes, size: int) -> None:
    whole = taken(dump)

    assert taken(*(dump[i : i + size] for i in range(0, len(dump), size))).events == whole.events


def test_it_ends_at_the_marker_and_takes_no_notice_of_the_rest() -> None:
    profile = MachineProfile(end_marker="END")
    found = taken(b"1,2,3\nEND\n4,5,6\n7,8", profile=profile)

    assert hits(found) == [(1.0, 2.0, 3.0)]
    assert found.ended.reason is EndReason.MARKER
    assert found.fragment == b""


def test_it_ends_at_the_expected_count() -> None:
    found = taken(b"1,2,3\n4,5,6\n", b"7,8,9\nnonsense\n1,1", expect=3)

    assert found.n_points == 3
    assert not rejected(found)
    assert (found.ended.reason, found.fragment) == (EndReason.COUNT, b"")


def test_it_ends_when_the_line_was_silent_for_long_enough() -> None:
    seen: list[float] = []

    def line() -> Iterator[Arrival]:
        yield Arrival(10.0, b"1,2,3\n")
        for tenth in range(1, 100):
            seen.append(10.0 + tenth / 10.0)
            yield Arrival(seen[-1], b"")

    found = take_in(line(), PROFILE)

    assert found.ended.reason is EndReason.IDLE
    assert seen[-1] == 13.0
    assert hits(found) == [(1.0, 2.0, 3.0)]


def test_silence_from_the_start_is_an_error_with_advice() -> None:
    with pytest.raises(DeviceError, match=r"nothing came for 20 s.*start the dump.*cable.*9600 baud 8N1"):
        take_in((Arrival(float(second), b"") for second in range(30)), PROFILE)


@pytest.mark.parametrize("rest", [b"\x1a", b"  ", b"\x00\x00", b"\n\r\n"])
def test_padding_behind_the_last_line_is_no_fragment(rest: bytes) -> None:
    assert taken(b"1,2,3\n" + rest).fragment == b""


def test_progress_tells_points_rate_and_the_time_left() -> None:
    seen: list[Progress] = []
    arrivals = [Arrival(1.0, b""), Arrival(2.0, b"1,2,3\n"), Arrival(3.0, b"4,5,6\nx\n"), Arrival(5.0, b"")]
    take_in([*arrivals, END], PROFILE, watch=seen.append)

    assert [progress.idle_left_s for progress in seen] == [None, 3.0, 3.0, 1.0]
    assert [progress.n_points for progress in seen] == [0, 1, 2, 2]
    assert seen[2].points_per_s == 2.0
    assert seen[2].n_bytes == 14
    assert seen[3].last is not None
    assert seen[3].last[:3] == (4.0, 5.0, 6.0)
