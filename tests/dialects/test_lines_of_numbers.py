"""Lines of columns and GMServer hits: every shape, every refusal with its column and its reason."""

from __future__ import annotations

import pytest
from dialects.streams import read

from cmm_align.dialects import Hit, Note, Rejected, decoded, points_of, profile_of

SHAPES = [
    # settings, line, point in mm
    ({"dialect": "xyz"}, "100.000,200.000,300.000", (100.0, 200.0, 300.0)),
    ({"dialect": "xyz", "scale": 0.001}, "100001,200002,300003", (100.001, 200.002, 300.003)),
    ({"dialect": "xyz_letters"}, "X100.000,Y200.000,Z300.000", (100.0, 200.0, 300.0)),
    ({"dialect": "xyz_letters", "scale": 0.001}, "X100001,Y200002,Z-300003", (100.001, 200.002, -300.003)),
    ({"dialect": "xyz", "columns": "x,y,z,w"}, "100.000,200.000,300.000,245.5", (100.0, 200.0, 300.0)),
    ({"dialect": "xyz", "columns": "x,y,z,w", "scale": 0.001}, "1,2,3,2455", (0.001, 0.002, 0.003)),
    ({"dialect": "xyz_letters", "columns": "x,y,z,w"}, "X1.5,Y2.5,Z3.5,W245.5", (1.5, 2.5, 3.5)),
    ({"dialect": "xyz_letters", "columns": "x,y,z,w", "units": "um"}, "X1,Y2,Z3,W9", (0.001, 0.002, 0.003)),
    ({"dialect": "xyz"}, "  +1.5\t-2.5   .5 ", (1.5, -2.5, 0.5)),
    ({"dialect": "xyz"}, "1.5e+01;-2.5D-1;3E0", (15.0, -0.25, 3.0)),
    ({"dialect": "xyz", "decimal": ","}, "1,5;-2,5;3", (1.5, -2.5, 3.0)),
    ({"dialect": "xyz", "axis_map": "+y,-x,+z"}, "1,2,3", (2.0, -1.0, 3.0)),
    ({"dialect": "xyz", "axis_map": "+z,+x,-y", "scale": [2, 4, 8]}, "1,2,3", (24.0, 2.0, -8.0)),
    ({"dialect": "xyz", "columns": "-,z,-,y,x"}, "P 1;3;;2;1", (1.0, 2.0, 3.0)),
    ({"dialect": "xyz", "units": "inch", "scale": 0.5}, "2,4,6", (25.4, 50.8, 76.2)),
]


@pytest.mark.parametrize(("settings", "line", "point_mm"), SHAPES, ids=[line for _, line, _ in SHAPES])
def test_a_shape_gives_its_point(settings, line, point_mm):
    seen = read(f"{line}\r\n".encode(), profile_of(settings))

    assert seen == ([pytest.approx(point_mm, rel=1e-15)], [], [])


REFUSALS = [
    # settings, line, column, words
    ({}, "1,2", 4, "2 columns, expected 3"),
    ({}, "1,2,3,4", 7, "4 columns, expected 3"),
    ({}, "1,2,3,", 7, "4 columns"),
    ({}, "1,,3", 3, "'' is no y"),
    ({}, "1;2,3;4", 3, "'2,3' is no y"),
    ({}, "nan,2,3", 1, "'nan' is no x"),
    ({}, "1,inf,3", 3, "'inf' is no y"),
    ({}, "1,1_0,3", 3, "'1_0' is no y"),
    ({}, "1,0x10,3", 3, "is no y"),
    ({}, "1,2.,3", 3, "'2.' is no y"),
    ({}, "1,2,1e999", 1, "further away"),
    ({}, "1,2,1e99", 1, "further away"),
    ({}, "1,--2,3", 3, "is no y"),
    ({"decimals": 3}, "1.000,2.000,3.00", 13, "with 3 decimals: bytes may be lost"),
    ({"decimals": 3}, "1.000,2.0005,3.000", 7, "with 3 decimals"),
    ({"decimals": 0}, "1,2.0,3", 3, "is no y"),
    ({"signed": True}, "+1,2,+3", 4, "is no y"),
    ({"dialect": "xyz_letters"}, "X1,Z2,Y3", 4, "'Z2' is no y"),
    ({"dialect": "xyz_letters"}, "x1,y2,z3", 1, "is no x"),
    ({"columns": "x,y,z,i,j,k"}, "1,2,3,1,1,1", 7, "length 1.73"),
    ({"columns": "x,y,z,q"}, "1,2,3,100", 7, "calls this point bad"),
    ({"columns": "x,y,z,sigma"}, "1,2,3,-1", 7, "below zero"),
    ({"columns": "id,x,y,z"}, "1.5,1,2,3", 1, "'1.5' is no id"),
    ({"dialect": "gmserver"}, "( 1 2 3 0 0 0 1 HIT", 1, "not between brackets"),
    ({"dialect": "gmserver"}, "( 1 2 3 0 0 0 1 )", 1, "7 numbers"),
    ({"dialect": "gmserver"}, "( 1 2 3x 0 0 0 1 ) HIT", 7, "'3x' is not a number"),
    ({"dialect": "gmserver"}, "( 1 2 3 0 0 0 1 ) ERR", 19, "'ERR' is not 'HIT'"),
    ({"dialect": "gmserver"}, "( 1 2 3 0 0 0 5 ) HIT", 11, "length 5"),
    ({"dialect": "gmserver"}, "( 1 2 3 0 ) HIT", 1, "4 numbers"),
    ({"dialect": "gmserver"}, "1,2,3", 1, "another dialect"),
]


@pytest.mark.parametrize(("settings", "line", "column", "words"), REFUSALS, ids=[row[1] for row in REFUSALS])
def test_a_line_that_is_no_point_is_rejected_with_its_place(settings, line, column, words):
    points, rejected, _ = read(f"\r\n{line}\r\n".encode(), profile_of({"dialect": "xyz", **settings}))

    assert points == []
    assert len(rejected) == 1
    assert rejected[0][:3] == (2, column, line)
    assert words in rejected[0].why


def test_the_first_point_decides_on_the_separator():
    seen = read(b"1;2;3\n4,5,6\n7;8;9\n", profile_of({"dialect": "xyz"}))

    assert seen.points_mm == [(1.0, 2.0, 3.0), (7.0, 8.0, 9.0)]
    assert [one.line for one in seen.rejected] == [2]


@pytest.mark.parametrize(
    ("settings", "lines"),
    [
        ({"dialect": "xyz", "columns": "x,y,z,w"}, ("1,2,3,359.995", "1,2,3,0.003", "1,2,3,10")),
        (
            {"dialect": "gmserver"},
            ("( 1 2 3 359.995 0 0 1 ) HIT", "( 1 2 3 0.003 0 0 1 ) HIT", "( 1 2 3 10 0 0 1 ) HIT"),
        ),
    ],
)
def test_points_at_another_place_of_the_rotary_table_are_rejected(settings, lines):
    raw = "".join(f"{line}\r" for line in lines).encode()
    profile = profile_of({**settings, "rotary_band_deg": 0.01})

    assert [one.line for one in read(raw, profile).rejected] == [3]
    assert "the part has moved" in read(raw, profile).rejected[0].why
    assert len(read(raw, profile_of({**settings, "rotary_band_deg": 180.0})).points_mm) == 3


def test_headings_and_end_markers_are_notes_and_later_words_are_not():
    profile = profile_of({"dialect": "xyz", "end_marker": "%", "header_lines": 2})
    raw = b"Part 17\n2026-11-22 10:00\nX,Y,Z\n\n1,2,3\nEND\n % \n"

    seen = read(raw, profile)

    assert [(note.line, note.what, note.ends) for note in seen.notes] == [
        (1, "heading", False),
        (2, "heading", False),
        (3, "heading", False),
        (7, "end marker", True),
    ]
    assert [(one.line, one.text) for one in seen.rejected] == [(6, "END")]
    assert seen.points_mm == [(1.0, 2.0, 3.0)]
    bare = read(b"1,2,3\nEND\n", profile_of({"dialect": "xyz"}))
    assert "end_marker = 'END'" in bare.rejected[0].why


def test_gmserver_positions_are_no_points():
    events = list(decoded([b"\n ( 1 2 3 0 )\r\n ( 1 2 3 0 ) POS\r\n ( 1 2 3 0 0 0 0 ) HIT\r"], _gmserver()))

    assert [type(event) for event in events] == [Note, Note, Hit]
    assert events[2].direction is None


def test_directions_turn_with_the_axes():
    profile = profile_of({"dialect": "xyz", "columns": "x,y,z,i,j,k", "axis_map": "+y,-x,+z", "scale": 0.001})

    (hit,) = decoded([b"1000 2000 3000 0.6 0.8 0\n"], profile)

    assert hit == Hit(2.0, -1.0, 3.0, (0.8, -0.6, 0.0))


def test_ids_names_and_uncertainties_reach_the_points_and_gaps_are_noted():
    profile = profile_of(
        {"dialect": "xyz", "columns": "id,name,x,y,z,sigma", "units": "um", "kind": "tip_centre"}
    )
    raw = b"7,a b,1000,2,3,0.5\n8,c,4,5,6,0.5\n9,d,4,5,6,0.5\n12,e,7,8,9,1.5\n"

    events = list(decoded([raw], profile))
    points, rejected, notes = points_of(events, "here", profile)

    assert [event.name for event in events] == ["a b", "c", "d", "e"]
    assert points.ids.tolist() == [7, 8, 9, 12]
    assert points.sigma_mm.tolist() == pytest.approx([0.0005, 0.0005, 0.0005, 0.0015])
    assert points.points_mm[0].tolist() == [1.0, 0.002, 0.003]
    assert (points.kind, points.source, rejected) == ("tip_centre", "here", ())
    assert [note.what for note in notes] == [
        "the numbers of the points go from 9 to 12: lines may be missing"
    ]


def test_no_points_are_an_empty_set():
    profile = profile_of({"dialect": "xyz"})

    points, rejected, notes = points_of(decoded([b"1,2\n"], profile), "here", profile)

    assert points.points_mm.shape == (0, 3)
    assert rejected == (Rejected(1, 4, "1,2", "2 columns, expected 3: x,y,z"),)
    assert notes == ()


def test_an_overlong_line_is_no_point_though_it_reads_as_one():
    raw = b"1.0,2.0,3." + b"0" * 70_000 + b"\n4,5,6\n"

    seen = read(raw, profile_of({"dialect": "xyz"}))

    assert seen.points_mm == [(4.0, 5.0, 6.0)]
    assert "longer than" in seen.rejected[0].why
    assert len(seen.rejected[0].text) <= 80


def _gmserver():
    return profile_of({"dialect": "gmserver", "terminator": "CR"})
