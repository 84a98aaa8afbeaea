"""DMIS output: the actual points, never the nominal ones."""

from __future__ import annotations

import numpy as np
import pytest
from formats.saddle import INCH_TEXT, INCH_TRUTH, TRUTH, dmis

from cmm_align.errors import MalformedInputError, UnitsError
from cmm_align.formats import dmis_fa
from cmm_align.formats.source import Source
from cmm_align.model import PointKind


def read(text: str, units: str | None = None):
    return dmis_fa.read(Source("s.dms", text.encode()), units)


def test_the_saddle_comes_back():
    points = read(dmis())

    np.testing.assert_array_equal(points.points_mm, TRUTH)
    assert points.kind is PointKind.CONTACT
    assert points.ids.tolist() == list(range(7, 16))


@pytest.mark.parametrize(
    "change",
    [
        lambda text: text.replace("FA(P7)=FEAT/POINT,CART,", "fa ( P7 ) = Feat / Point , Cart , "),
        lambda text: text.replace("FA(P7)=FEAT/POINT,", "FA(P7)=FEAT/$\r\n$$ between\r\nPOINT,$\r\n"),
        lambda text: text.replace("-10.00000", "-1.000000D+01"),
        lambda text: text.replace("(P7)", "(Maß7)"),
        lambda text: text.replace("\r\n", "\r"),
        lambda text: text.replace(",$\r\n", ", $  \n "),
    ],
    ids=["case and blanks", "continued twice", "Fortran exponent", "umlauts", "CR", "blanks around the mark"],
)
def test_the_same_text_written_in_another_way(change):
    np.testing.assert_array_equal(read(change(dmis())).points_mm, TRUTH)


def test_the_unit_holds_for_what_follows():
    inch = dmis(INCH_TEXT, "INCH")
    np.testing.assert_allclose(read(inch).points_mm, INCH_TRUTH, rtol=1e-15)
    both = read(inch.replace("ENDFIL", "UNITS/MM,ANGDEC\r\nFA(A1)=FEAT/POINT,CART,1,2,3\r\nENDFIL"))
    np.testing.assert_array_equal(both.points_mm[-1], [1, 2, 3])
    with pytest.raises(UnitsError, match=r"s\.dms:2:7: the file states inch, --units says mm"):
        read(inch, "mm")
    with pytest.raises(UnitsError, match=r"s\.dms:2:7: UNITS/FEET"):
        read(dmis(unit="FEET"))


FIRST = "FA(P7)=FEAT/POINT,CART,-10.00000,-9.00000,"


@pytest.mark.parametrize(
    ("new", "place", "words"),
    [
        ("FA(P7)=FEAT/POINT,CART,-10.00000,-9.00000,,", "6:43", "an empty field"),
        ("FA(P7)=FEAT/POINT,CART,-10.00000,", "6:1", "5 numbers"),
        ("FA(P7)=FEAT/POINT,CART,-10.00$\n000,-9.00000,", "6:24", "is not a number"),
        ("FA(P7)=FEAT/POINT,CART,x,-9.00000,", "6:24", "'x' is not a number"),
        ("FA(P7)=FEAT/POINT,POL,-10.00000,-9.00000,", "6:1", "is no actual point"),
        ("FA(P7=FEAT/POINT,CART,-10.00000,-9.00000,", "6:1", "is no actual point"),
        ("FA(P7)=FEAT/POINT,CART,-10,00000,-9,00000,", "6:1", "8 numbers"),
    ],
)
def test_a_fault_is_named_with_its_place(new, place, words):
    assert FIRST in dmis()
    with pytest.raises(MalformedInputError) as caught:
        read(dmis().replace(FIRST, new, 1))

    assert str(caught.value).startswith(f"s.dms:{place}: ")
    assert words in str(caught.value)


def test_a_fault_in_a_continued_line_has_the_place_of_that_line():
    with pytest.raises(MalformedInputError, match=r"^s\.dms:7:10: '0\.O1000' is not a number"):
        read(dmis().replace("-0.07216,0.01000", "-0.07216,0.O1000", 1))


def test_a_program_holds_targets_and_a_file_without_end_was_cut_off():
    with pytest.raises(MalformedInputError, match=r"there are no points .* not its program"):
        read("DMISMN/'a',05.2\nF(P1)=FEAT/POINT,CART,1,2,3,0,0,1\nPTMEAS/CART,1,2,3,0,0,1\nENDFIL\n")
    with pytest.raises(MalformedInputError, match="may have been cut off; expected ENDFIL"):
        read(dmis().replace("ENDFIL\r\n", ""))
