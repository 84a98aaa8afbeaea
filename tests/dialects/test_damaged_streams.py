"""Streams that lost, gained or repeated bytes: no wrong point, and the right count of rejected lines."""

from __future__ import annotations

import numpy as np
import pytest
from dialects.streams import WRITERS, read, stream_of
from hypothesis import given
from hypothesis import strategies as st

from cmm_align.dialects import DIALECTS, MachineProfile, decoded

SMALL = 2
"""Points along each side: 4 points are enough to cut between, and few enough to cut everywhere."""

LINE_DIALECTS = [name for name in WRITERS if not name.startswith("ipp")]
WITH_DECIMALS = [name for name in LINE_DIALECTS if "counts" not in name]
NO_CHARACTERS_OF_NUMBERS = b"\x00\x07\x1b@q~#\x80\xff"
CHARACTERS_OF_NUMBERS = b".,;+eE \t\r\n"
"""Without digits and the minus sign: in front of a number they make another number, and nothing shows it."""


@pytest.mark.parametrize("name", WRITERS)
def test_cut_at_every_byte_the_points_are_a_prefix(name):
    profile, raw, _ = stream_of(name, SMALL)
    whole = read(raw, profile).points_mm
    for at in range(len(raw) + 1):
        seen = read(raw[:at], profile)

        assert seen.points_mm == whole[: len(seen.points_mm)]
        ending = {"\r": b"\r", "\r\n": b"\r\n"}[profile.terminator]
        complete, _, fragment = raw[:at].rpartition(ending)
        assert seen.points_mm == read(complete + ending, profile).points_mm
        if not name.startswith("ipp"):
            assert len(seen.rejected) == bool(fragment.strip())


@pytest.mark.parametrize("name", ["ipp_tap", "ipp_scan_sorted"])
def test_cut_ipp_traffic_names_the_fragment_and_the_open_transaction(name):
    profile, raw, _ = stream_of(name, SMALL)
    for at in range(len(raw) + 1):
        complete, _, fragment = raw[:at].rpartition(b"\r\n")
        open_tags = complete.count(b" &") - complete.count(b" %")

        assert len(read(raw[:at], profile).rejected) == bool(fragment.strip()) + open_tags


@pytest.mark.parametrize("name", WRITERS)
def test_pieces_of_any_size_make_no_difference(name):
    profile, raw, _ = stream_of(name, SMALL)
    whole = list(decoded([raw], profile))

    for size in (1, 2, 3, 7, 64):
        assert list(decoded([raw[at : at + size] for at in range(0, len(raw), size)], profile)) == whole


@pytest.mark.parametrize("name", WRITERS)
def test_an_inserted_byte_that_belongs_to_no_number_costs_its_line_and_is_counted(name):
    profile, raw, _ = stream_of(name, SMALL)
    whole = read(raw, profile)
    for at in range(len(raw) + 1):
        for byte in NO_CHARACTERS_OF_NUMBERS:
            seen = read(raw[:at] + bytes([byte]) + raw[at:], profile)

            _is_the_rest_of(seen.points_mm, whole.points_mm)
            lost = len(whole.points_mm) - len(seen.points_mm)
            assert len(seen.rejected) >= min(lost, 1)
            if not name.startswith("ipp"):  # there a data line may hold several points
                between_cr_and_lf = raw[at - 1 : at + 1] == b"\r\n" and profile.terminator == "\r\n"
                assert lost <= 1 + between_cr_and_lf
                assert len(seen.rejected) <= 1


@pytest.mark.parametrize("name", WITH_DECIMALS)
def test_an_inserted_character_of_numbers_gives_no_wrong_point_where_decimals_are_stated(name):
    profile, raw, _ = stream_of(name, SMALL)
    whole = read(raw, profile).points_mm
    for at in range(len(raw) + 1):
        for byte in CHARACTERS_OF_NUMBERS:
            seen = read(raw[:at] + bytes([byte]) + raw[at:], profile)

            _is_the_rest_of(seen.points_mm, whole)
            assert len(seen.rejected) >= (len(seen.points_mm) < len(whole))


@pytest.mark.parametrize("name", WITH_DECIMALS)
def test_a_doubled_byte_gives_no_wrong_point_save_for_digits_before_the_decimal_sign(name):
    profile, raw, _ = stream_of(name, SMALL)
    whole = read(raw, profile).points_mm
    for at in range(len(raw)):
        tail = raw[at:].lstrip(b"0123456789")
        if raw[at : at + 1].isdigit() and tail[:1] == profile.decimal.encode():
            continue
        seen = read(raw[: at + 1] + raw[at:], profile)

        _is_the_rest_of(seen.points_mm, whole)


@pytest.mark.parametrize("name", LINE_DIALECTS)
def test_a_doubled_piece_gives_points_twice_but_no_other_ones_if_it_is_made_of_lines(name):
    profile, raw, _ = stream_of(name)
    ending = profile.terminator.encode()
    lines = [line + ending for line in raw.split(ending)[:-1]]
    whole = read(raw, profile).points_mm

    seen = read(b"".join([*lines[:4], *lines[2:]]), profile)

    assert set(seen.points_mm) == set(whole)
    assert len(seen.points_mm) == len(whole) + 2


@pytest.mark.parametrize("name", WITH_DECIMALS)
def test_a_lost_byte_gives_no_wrong_point_save_in_front_of_a_decimal_sign(name):
    profile, raw, _ = stream_of(name, SMALL)
    whole = read(raw, profile).points_mm
    for at in range(len(raw)):
        front = raw[at:].lstrip(b"+-0123456789")[:1] == profile.decimal.encode()
        if front and raw[at] in b"+-0123456789":
            continue
        seen = read(raw[:at] + raw[at + 1 :], profile)

        _is_the_rest_of(seen.points_mm, whole)
        assert len(seen.rejected) >= (len(seen.points_mm) < len(whole))


def test_counts_cut_short_by_a_stray_line_end_are_seen_where_the_terminator_is_stated():
    profile, raw, _ = stream_of("generic_counts", SMALL)
    whole = read(raw, profile).points_mm
    for at in range(len(raw) + 1):
        for byte in b"\r\n":
            _is_the_rest_of(read(raw[:at] + bytes([byte]) + raw[at:], profile).points_mm, whole)


def test_high_bits_suggest_parity_and_garbage_the_baud_rate():
    profile, raw, _ = stream_of("generic_xyz", SMALL)
    even = bytes(byte | (byte.bit_count() & 1) << 7 for byte in raw)
    noise = np.random.default_rng(5).integers(0, 256, 300, dtype=np.uint8).tobytes() + b"\r\n"

    assert "parity" in read(even.replace(b"\x8d", b"\r").replace(b"\x8a", b"\n"), profile).rejected[0].why
    assert "baud" in read(noise.replace(b"\r\n", b"") + b"\r\n", profile).rejected[-1].why


@given(st.lists(st.binary(max_size=200), max_size=8), st.sampled_from(sorted(DIALECTS)))
def test_no_bytes_make_a_dialect_fall_over(pieces, dialect):
    profile = MachineProfile(dialect=dialect)

    for event in decoded(pieces, profile):
        assert not hasattr(event, "x_mm") or np.isfinite(event[:3]).all()


@given(
    st.text(alphabet="0123456789+-.,;eEdDXYZW()#&%! \tHITER\r\n", max_size=300),
    st.sampled_from(sorted(DIALECTS)),
    st.integers(1, 17),
)
def test_characters_of_machines_in_any_order_read_the_same_in_any_pieces(text, dialect, size):
    raw, profile = text.encode(), MachineProfile(dialect=dialect)

    pieces = [raw[at : at + size] for at in range(0, len(raw), size)]
    assert list(decoded(pieces, profile)) == list(decoded([raw], profile))


def _is_the_rest_of(points, whole):
    """All points are true ones, in their order: what is missing was rejected."""
    rest = iter(whole)
    assert all(point in rest for point in points)
