"""Bytes to whole lines, against Python's own idea of lines."""

from __future__ import annotations

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from cmm_align.dialects import LONGEST_LINE, lines_of, unfinished

STREAMS = st.lists(st.sampled_from([b"1", b"ab", b"\r", b"\n", b"\r\n", b" "]), max_size=40).map(b"".join)


def fed(pieces, terminator):
    """Return all lines and the fragment of a stream in pieces."""
    pending, lines = b"", []
    for piece in pieces:
        found, pending = lines_of(pending, piece, terminator)
        lines += found
    return lines, unfinished(pending)


@given(STREAMS, st.integers(1, 9))
@example(b"1\r\n2\r\n", 2)
@example(b"1\r\r\n\n", 1)
def test_any_terminator_makes_the_lines_that_python_makes(raw, size):
    pieces = [raw[at : at + size] for at in range(0, len(raw), size)]
    expected = raw.splitlines()
    fragment = b"" if raw.endswith((b"\r", b"\n")) or not raw else expected.pop()

    assert fed(pieces, "any") == (expected, fragment)


@pytest.mark.parametrize("terminator", ["\r", "\n", "\r\n"])
@given(raw=STREAMS, size=st.integers(1, 9))
def test_a_stated_terminator_is_the_only_one(terminator, raw, size):
    pieces = [raw[at : at + size] for at in range(0, len(raw), size)]
    *expected, fragment = raw.split(terminator.encode())

    assert fed(pieces, terminator) == (expected, fragment if fragment != b"\r" else b"")


def test_a_cr_ends_a_line_at_once():
    lines, pending = lines_of(b"1,2", b",3\r")

    assert lines == (b"1,2,3",)
    assert unfinished(pending) == b""
    assert lines_of(pending, b"") == ((), pending)
    assert lines_of(pending, b"\n4") == ((), b"4")


@pytest.mark.parametrize("terminator", ["any", "\r\n"])
def test_a_line_without_end_takes_no_memory_and_swallows_no_other_line(terminator):
    pending = b""
    for _ in range(100):
        found, pending = lines_of(pending, b"7" * 4096, terminator)
        assert found == ()
        assert len(pending) <= LONGEST_LINE + 2
    found, pending = lines_of(pending, b"\r", terminator)
    more, pending = lines_of(pending, b"\n1,2,3\r\n", terminator)

    overlong, following = (*found, *more)
    assert len(overlong) == LONGEST_LINE + 1
    assert following == b"1,2,3"
    assert unfinished(pending) == b""
