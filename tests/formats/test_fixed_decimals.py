"""Fixed decimals, many at a time: the same text as `%`, and never more than half a last digit away."""

import numpy as np
import pytest

from cmm_align.errors import OutputError
from cmm_align.formats.fixed_decimals import Field, lines_of


def text(pieces, *columns):
    return b"".join(lines_of(pieces, [np.asarray(c, dtype=np.float64) for c in columns])).decode()


@pytest.mark.parametrize("decimals", [0, 1, 3, 6, 9])
def test_the_text_is_that_of_percent(decimals):
    rng = np.random.default_rng(1)
    values = rng.choice([-1.0, 1.0], 2000) * 10.0 ** rng.uniform(-12, min(5, 11 - decimals), 2000)
    expected = [f"{v:.{decimals}f}" for v in values]
    expected = [t.lstrip("-") if float(t) == 0.0 else t for t in expected]  # no minus before zero
    assert text([Field(0, decimals), b"\n"], values).split() == expected


def test_signs_literals_decimal_comma_and_line_ends():
    found = text(
        [b"X", Field(0, 3, plus=True), b" N", Field(1, 0), b";", Field(0, 2, point=b","), b"\r\n"],
        [0.0, -1.5, 123.4567],
        [1, 10, 100],
    )
    assert found == "X+0.000 N1;0,00\r\nX-1.500 N10;-1,50\r\nX+123.457 N100;123,46\r\n"


def test_the_rounding_is_half_a_digit_at_most():
    values = np.random.default_rng(2).uniform(-600.0, 600.0, 200_000)  # more than one block
    back = np.array(text([Field(0, 6), b"\n"], values).split(), dtype=np.float64)
    assert np.abs(back - values).max() <= 0.5e-6 * (1 + 1e-9) + 1e-13


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e11])
def test_numbers_that_do_not_fit_are_refused(bad):
    with pytest.raises(OutputError, match="at most 15 digits"):
        text([Field(0, 6), b"\n"], [0.0, bad])
