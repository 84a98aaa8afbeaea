"""Measured rows that are left out by design: each is told, and a strict reading refuses them."""

from __future__ import annotations

import numpy as np
import pytest
from formats.saddle import (
    POINT_ENTITIES,
    TEXT,
    TRUTH,
    calypso,
    dmis,
    geopak,
    iges,
    pc_dmis,
    tracker,
    vda,
)

from cmm_align.errors import MalformedInputError, UsageError
from cmm_align.formats import Hints, read_points
from cmm_align.formats.source import MOST_TOLD
from cmm_align.model import joined

IPP = (
    "00010 &\r\n00010 # X(1.00000), Y(2.00000), Z(3.00000), Q(0.0)\r\n00010 %\r\n"
    "00011 &\r\n00011 # X(4.00000), Y(5.00000), Z(6.00000), Q(100.0)\r\n00011 %\r\n"
    '00012 &\r\n00012 ! Error(2, 1006, "PtMeas", "Surface not found")\r\n00012 %\r\n'
)
QUALITY = "x;y;z;Qualität\n1,5;2;3;OK\n4;5;6;NOK\n7;8;9;ok\n"
CONSTRUCTED = "PLN9 =FEAT/PLANE,CARTESIAN,OUTLINE,NO\r\n  ACTL/<8,8,8>,<0,0,1>\r\n  ENDMEAS/\r\n"
CIRCLE = "C = CIRCLE / 1,2,3,4,5,6,7,8,9,0,1,2\r\nDEMO = END"
CURVE = (110, 0, "110,0.,0.,0.,1.,1.,1.;")

LEFT_OUT = {
    "quality": (QUALITY, ["p:3: 4;5;6;NOK: its quality is bad"]),
    "I++": (IPP, ["p:5: 00011 # X(4.00000)", "p:8: 00012 ! Error(2, 1006"]),
    "CALYPSO": (calypso(), ["p:11: demo Plane1 Plane 0 0 0 mm: a feature that is no point"]),
    "tracker": (tracker(TEXT), ["p:3: Unchecked M2_1 2 "]),
    "DMIS": (dmis(), ["FA(PL1)=FEAT/PLANE"]),
    "VDA": (
        vda(numbered=False).replace("DEMO    = END", CIRCLE),
        ["C = CIRCLE"],
    ),
    "IGES": (iges([*POINT_ENTITIES, CURVE]), ["110,0.,0.,0.,1.,1.,1.: a curve, no point"]),
    "PC-DMIS": (
        pc_dmis() + CONSTRUCTED,
        ["PLN9 =FEAT/PLANE,CARTESIAN,OUTLINE,NO: a feature that is no point"],
    ),
}


@pytest.mark.parametrize(("text", "told"), LEFT_OUT.values(), ids=LEFT_OUT.keys())
def test_what_is_left_out_is_told_and_refused_if_strict(text, told, tmp_path):
    path = tmp_path / "p"
    path.write_bytes(text.encode())

    points = read_points(path)

    assert len(points.passed_over) == len(told)
    for sentence, words in zip(points.passed_over, told, strict=True):
        assert sentence.startswith(f"{path}:")
        assert words.replace("p:", f"{path}:", 1) in sentence
    with pytest.raises(MalformedInputError, match="--strict") as caught:
        read_points(path, hints=Hints(strict=True))
    assert str(caught.value).startswith(points.passed_over[0])


@pytest.mark.parametrize("text", [geopak(), vda(), "# c\nx,y,z\n1,2,3\n", pc_dmis(), "Units: mm\n1 2 3\n"])
def test_a_strict_reading_takes_files_without_such_rows(text, tmp_path):
    (tmp_path / "p").write_text(text)

    assert read_points(tmp_path / "p", hints=Hints(strict=True)).passed_over == ()


def test_points_of_bad_quality_take_their_ids_and_weights_with_them(tmp_path):
    (tmp_path / "p.csv").write_text(
        "id,x,y,z,q,weight,sigma\n7,1,2,3,0,1,1\n8,4,5,6,100,2,2\n9,7,8,9,50,3,3\n"
    )

    points = read_points(tmp_path / "p.csv")

    assert points.points_mm.tolist() == [[1.0, 2.0, 3.0], [7.0, 8.0, 9.0]]
    assert (points.ids.tolist(), points.weight.tolist(), points.sigma_mm.tolist()) == ([7, 9], [1, 3], [1, 3])


def test_many_are_told_by_their_number(tmp_path):
    rows = "1,2,3,OK\n" * 70 + "1,2,3,bad\n" * 60
    (tmp_path / "p.csv").write_text("x,y,z,quality\n" + rows)

    points = read_points(tmp_path / "p.csv")

    assert len(points.passed_over) == MOST_TOLD + 1
    assert points.passed_over[-1].endswith("... and 10 more")
    both = joined([points, points])
    assert both.passed_over == points.passed_over * 2


def test_a_hint_without_use_is_refused(tmp_path):
    (tmp_path / "p").write_text(geopak())

    with pytest.raises(UsageError, match=r"--columns x,y,z for .*p: a GEOPAK scan file says itself"):
        read_points(tmp_path / "p", hints=Hints(columns="x,y,z"))
    with pytest.raises(UsageError, match="--decimal"):
        read_points(tmp_path / "p", hints=Hints(decimal=","))
    np.testing.assert_array_equal(read_points(tmp_path / "p", hints=Hints(decimal=".")).points_mm, TRUTH)


def test_a_comma_in_a_trackers_table_may_be_told(tmp_path):
    (tmp_path / "p").write_text(tracker([["1,234", "2,345", "3,456"]] * 3))

    assert read_points(tmp_path / "p", hints=Hints(decimal=",")).points_mm[0].tolist() == [
        1.234,
        2.345,
        3.456,
    ]
    assert read_points(tmp_path / "p", hints=Hints(decimal=".")).points_mm[0].tolist() == [1234, 2345, 3456]


def test_columns_of_a_scan_may_be_told(tmp_path):
    (tmp_path / "p").write_text("00017 &\n00017 # 0,1.5,2.5,3.5, 0,1.6,2.6,3.6\n00017 %\n")

    points = read_points(tmp_path / "p", hints=Hints(columns="q,x,y,z"))

    assert points.points_mm.tolist() == [[1.5, 2.5, 3.5], [1.6, 2.6, 3.6]]
