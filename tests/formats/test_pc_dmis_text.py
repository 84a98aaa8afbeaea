"""PC-DMIS routines as text: actual places, not the nominal ones beside them."""

from __future__ import annotations

import numpy as np
import pytest
from formats.saddle import TEXT, TRUTH, pc_dmis

from cmm_align.errors import MalformedInputError
from cmm_align.formats import pc_dmis_text
from cmm_align.formats.source import Source
from cmm_align.model import PointKind


def read(text: str, units: str | None = None):
    return pc_dmis_text.read(Source("s.txt", text.encode()), units)


def test_the_saddle_comes_back():
    points = read(pc_dmis())

    np.testing.assert_array_equal(points.points_mm, TRUTH)
    assert points.kind is PointKind.CONTACT


def test_names_and_case_do_not_matter():
    text = pc_dmis().replace("PNT1 ", "Maß1 ").replace("ACTL", "Actl").replace("PLN1", "straße")

    np.testing.assert_array_equal(read(text).points_mm, TRUTH)


def test_a_point_feature_without_actual_place_gives_its_hit():
    text = "\r\n".join(line for line in pc_dmis().split("\r\n") if "ACTL" not in line)

    np.testing.assert_array_equal(read(text).points_mm, TRUTH)


def test_names_with_numbers_become_ids_and_the_unit_is_the_users():
    text = pc_dmis().split("PLN1")[0]
    points = read(text, "inch")

    assert points.ids.tolist() == [1, 2, 3, 4, 5, 6]
    np.testing.assert_array_equal(points.points_mm, TRUTH[:6] * 25.4)


def test_the_older_way_of_writing_with_bare_numbers_that_go_on_in_the_next_line():
    lines = []
    for k, point in enumerate(TEXT, 1):
        lines += [f"V{k}   =AUTO/VECTOR POINT,SHOWALLPARAMS=YES,$", "       THEO/99,99,99,0,0,1,$"]
        lines += [f"       ACTL/{','.join(point)},0,$", "       0,1,$", "       TARG/98,98,98,0,0,1"]

    np.testing.assert_array_equal(read("\n".join(lines) + "\n").points_mm, TRUTH)


@pytest.mark.parametrize(
    ("old", "new", "place", "words"),
    [
        ("ACTL/<-10.00000,", "ACTL/<-10.OOOOO,", "7:19", "'-10.OOOOO' is not a number"),
        ("ACTL/<-10.00000,", "ACTL/<-10,00000,", "7:18", "4 numbers"),
        ("ACTL/<-10.00000,", "ACTL/<", "7:18", "2 numbers"),
        ("ACTL/<-10.00000,", "ACTL/-10.00000,", "7:37", "is not a number"),
        ("ACTL/<-10.00000,", "ACTL/<-10.00000,<", "7:18", "is not complete"),
        ("<99,99,99>,<0,0,1>,<-10.00000", "<-10.00000", "9:15", "has no actual place"),
        ("MEAS/POINT,1", "MEAS/POINT,2", "5:1", "1 hits in feature PNT1"),
        ("ENDMEAS/", "", "5:1", "ENDMEAS"),
        ("PNT1       =FEAT/POINT,CARTESIAN", "PNT1       =FEAT/POINT,POLAR", "5:1", "polar"),
    ],
)
def test_a_fault_is_named_with_its_place(old, new, place, words):
    with pytest.raises(MalformedInputError) as caught:
        read(pc_dmis().replace(old, new, 1))

    assert str(caught.value).startswith(f"s.txt:{place}: ")
    assert words in str(caught.value)


def test_a_routine_that_never_ran_has_no_points():
    with pytest.raises(MalformedInputError, match=r"s\.txt:1:1: 'P1=FEAT/POINT,CARTESIAN' was not measured"):
        read("P1=FEAT/POINT,CARTESIAN\nTHEO/<1,2,3>,<0,0,1>\n")
    with pytest.raises(MalformedInputError, match="there are no points"):
        read("PART NAME  : A\nA0=ALIGNMENT/START\n")
