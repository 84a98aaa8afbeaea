"""Reading numbers of fixed decimals: to the bit what float() makes of them, and nothing that is none."""

from __future__ import annotations

import numpy as np
import pytest

from cmm_align.errors import MalformedInputError
from cmm_align.posts.numbers import Lines, _fixed, table_of


def test_every_bit_is_that_of_float():
    rng = np.random.default_rng(3)
    values = rng.uniform(-500.0, 500.0, (2000, 3))
    words = [[f"{a:.6f}", f"{b:+.9f}", f"{c:.0f}"] for a, b, c in values]
    text = "\n".join(f"X{a} Y{b} N{c}" for a, b, c in words).encode() + b"\n"
    found = table_of(text, 3, "x", b"XYN")
    assert _fixed(text.translate(bytes.maketrans(b"XYN", b"   ")), 3) is not None
    np.testing.assert_array_equal(found, np.array(words, dtype=np.float64))


@pytest.mark.parametrize(
    "text",
    [b"1.5 2.25\n-0.000001 3\n", b"1e3 2\n4 5\n", b"1 2\r\n3 4", b"\n 1.0 2.0\n\n3.0 -0.5\n"],
)
def test_other_numbers_are_read_as_well(text):
    expected = [[float(word) for word in line.split()] for line in text.split(b"\n") if line.strip()]
    np.testing.assert_array_equal(table_of(text, 2, "x"), expected)


@pytest.mark.parametrize(
    "text",
    [
        b"1.0 2.0\n1.0\n2.0 1.0 1.0\n",
        b"1.0 2.0\n1.0-2.0 3.0\n",
        b"1.0 2.0\n1.0.0 20\n",
        b"1.0 2.0\n1.. 2.0\n",
        b"1.0 2.0\n- 2.0\n",
        b"1.0 2.0\n1.0 x\n",
        b"1.0 2.0\n1.0 nan\n",
        b"1.0 2.0 3.0\n",
        b"\n",
    ],
)
@pytest.mark.filterwarnings("ignore:loadtxt")
def test_what_is_no_table_is_refused(text):
    with pytest.raises(MalformedInputError):
        table_of(text, 2, "x")


def test_lines_are_told_apart_and_blanked():
    lines = Lines(b"G0 X1\nX2\nG1 X3\nX")
    assert lines.start_with(b"X").tolist() == [False, True, False, True]
    assert lines.start_with(b"G1 X").tolist() == [False, False, True, False]
    assert lines.only(lines.start_with(b"X")).split() == [b"X2", b"X"]
