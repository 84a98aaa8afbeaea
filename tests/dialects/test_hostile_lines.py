"""Lines made to take long: the time of a line grows with its length, not with its square."""

from __future__ import annotations

import time

import pytest

from cmm_align.dialects import LONGEST_LINE, decoded, profile_of

PROFILES = [
    {"dialect": "xyz"},
    {"dialect": "xyz", "columns": "-,name,x,y,z,-"},
    {"dialect": "xyz_letters", "columns": "x,y,z,w"},
    {"dialect": "gmserver"},
    {"dialect": "ipp"},
]
BEGINNINGS = (b"", b"00001 # ", b"00001 ! Error(", b"00001 A(", b"X1,Y", b"( 1 2 ")
REPEATED = (b"1", b"1,", b"1.", b"1e", b"-", b" ", b"a ", b"a \t", b",", b"(", b"X(", b"X(1), ", b'"')
LONGEST_CPU_S = 1.0
"""A line takes a few ms; with time growing as the square it would be ten seconds."""


@pytest.mark.parametrize("settings", PROFILES, ids=lambda settings: " ".join(settings.values()))
def test_no_line_takes_long(settings):
    profile = profile_of(settings)
    for beginning in BEGINNINGS:
        for piece in REPEATED:
            line = (beginning + piece * LONGEST_LINE)[: LONGEST_LINE - 1] + b"x\n"
            start = time.process_time()
            list(decoded([line], profile))

            assert time.process_time() - start < LONGEST_CPU_S, (beginning, piece)
