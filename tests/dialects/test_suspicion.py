"""What a dump looks like that is not as its profile says."""

from __future__ import annotations

from dataclasses import replace

import pytest
from dialects.streams import WRITERS, stream_of

from cmm_align.dialects import MachineProfile, profile_of, suspicions


@pytest.mark.parametrize(("letter", "wrong"), [("E", 1), ("O", 0)])
def test_seven_bits_read_as_eight_name_the_parity(letter, wrong):
    profile, raw, _ = stream_of("generic_xyz")
    sent = bytes(byte | ((byte.bit_count() & 1) == wrong) << 7 for byte in raw)

    (hint,) = suspicions(sent, profile)

    assert f'bytesize = 7, parity = "{letter}"' in hint
    assert "(now 8N)" in hint


def test_a_few_flipped_bits_leave_the_parity_open():
    profile, raw, _ = stream_of("generic_xyz")
    (hint,) = suspicions(bytes([raw[0] | 0x80]) + raw[1:], profile)

    assert hint.startswith(f"1 of {len(raw)} bytes")
    assert '"E" or "O"' in hint


def test_garbage_suggests_the_baud_rate(rng):
    (hint,) = suspicions(rng.integers(0, 256, 2000).astype("u1").tobytes(), MachineProfile(baud=4800))

    assert "wrong baud rate? (now 4800)" in hint


@pytest.mark.parametrize("name", WRITERS)
def test_the_dialect_that_fits_is_named(name):
    profile, raw, _ = stream_of(name)
    other = profile_of({"dialect": "xyz" if profile.dialect == "gmserver" else "gmserver"})

    (hint,) = (one for one in suspicions(raw, other) if "points as the profile says" in one)

    assert hint.startswith("0 points")
    assert f'dialect = "{profile.dialect}"' in hint
    assert ('decimal = ","' in hint) == (profile.decimal == ",")


def test_the_columns_that_fit_are_named():
    raw = b"1,1.5,2.5,3.5\r\n2,1.5,2.5,3.5\r\n"

    (hint,) = suspicions(raw, profile_of({"dialect": "xyz"}))

    assert 'columns = "id,x,y,z"' in hint


def test_a_text_that_is_nothing_we_know_is_called_so():
    (hint,) = suspicions(b"lorem 1 ipsum\r\ndolor 2 sit\r\n", MachineProfile())

    assert "nothing in it reads as a point" in hint


@pytest.mark.parametrize(
    ("terminator", "words"), [("CRLF", 'no CRLF but 25 CR in it: set terminator = "CR"'), ("LF", "no LF but")]
)
def test_another_line_end_is_named(terminator, words):
    profile, raw, _ = stream_of("generic_letters_counts_rotary")
    wrong = replace(profile, terminator={"CRLF": "\r\n", "LF": "\n"}[terminator])

    assert words in suspicions(raw, wrong)[0]
    assert suspicions(b"1,2,3", wrong)[0] == "no line end in 5 bytes"


def test_counts_taken_for_lengths_are_noticed():
    profile, raw, _ = stream_of("generic_counts")

    (hint,) = suspicions(raw, replace(profile, scale=(1.0, 1.0, 1.0)))

    assert "up to 10075: are they counts? set scale" in hint


def test_a_line_with_fewer_decimals_than_all_others_is_noticed():
    profile, raw, _ = stream_of("generic_xyz")
    (hint,) = suspicions(raw.replace(b"1.422\r\n", b"1.42\r\n", 1), replace(profile, decimals=-1))

    assert hint.startswith("24 of 25 lines have (3, 3, 3) decimals")
    assert "1.42'" in hint


def test_nothing_is_no_suspicion():
    assert suspicions(b"", MachineProfile()) == ()
