"""IGES points: read here where a file holds no surface; Open CASCADE writes the second opinion."""

from __future__ import annotations

import numpy as np
import pytest
from formats.saddle import INCH_TEXT, INCH_TRUTH, NORMALS, POINT_ENTITIES, TEXT, TRUTH, iges

from cmm_align.errors import MalformedInputError, UnitsError
from cmm_align.formats import cad, iges_points, sniff
from cmm_align.formats.source import Source
from cmm_align.model import PointKind

FLAT = ",".join(word for point in TEXT for word in point)
SPATIAL = ",".join(word for pair in zip(TEXT, NORMALS, strict=True) for point in pair for word in point)
PLANE = ",".join(word for point in TEXT for word in point[:2])
COPIOUS = {
    "116": POINT_ENTITIES,
    "106 form 2": [(106, 2, f"106,2,9,{FLAT};")],
    "106 form 3": [(106, 3, f"106,3,9,{SPATIAL};")],
    "106 form 12, a line through points": [(106, 12, f"106,2,9,{FLAT},0,0;")],
    "curves and marks beside them": [
        (110, 0, "110,0.,0.,0.,1.,1.,1.;"),
        (106, 40, "106,1,3,0.,1.,1.,2.,2.,3.,3.;"),
        *POINT_ENTITIES,
    ],
}


def read(text: str, units: str | None = None):
    source = Source("s.igs", text.encode())
    assert iges_points.recognises(source.raw)
    return iges_points.read(source, units)


@pytest.mark.parametrize("entities", COPIOUS.values(), ids=COPIOUS.keys())
def test_the_saddle_comes_back(entities):
    points = read(iges(entities))

    np.testing.assert_array_equal(points.points_mm, TRUTH)
    assert points.kind is PointKind.CONTACT


def test_a_plane_has_one_height_for_all():
    points = read(iges([(106, 1, f"106,1,9,0.25,{PLANE};")]))

    np.testing.assert_array_equal(points.points_mm, np.column_stack([TRUTH[:, :2], np.full(9, 0.25)]))


def test_parameter_lines_alone_are_read():
    text = "\n".join(line for line in iges(POINT_ENTITIES).split("\r\n") if line[72:73] == "P")

    np.testing.assert_array_equal(read(text + "\n").points_mm, TRUTH)
    np.testing.assert_array_equal(read(text, "inch").points_mm, TRUTH * 25.4)


def test_exponents_of_fortran():
    entities = [(kind, form, text.replace("-10.00000", "-1.D1")) for kind, form, text in POINT_ENTITIES]

    np.testing.assert_array_equal(read(iges(entities)).points_mm, TRUTH)


def test_the_unit_is_the_one_of_the_global_section():
    entities = [(116, 0, f"116,{','.join(point)};") for point in INCH_TEXT]
    for unit in ("1,4HINCH", "3,2HIN", "1,"):
        np.testing.assert_allclose(read(iges(entities, unit)).points_mm, INCH_TRUTH, rtol=1e-15)
    with pytest.raises(UnitsError, match="the file states inch, --units says mm"):
        read(iges(entities, "1,4HINCH"), "mm")
    with pytest.raises(UnitsError, match="unit 4 'ft' of the global section"):
        read(iges(entities, "4,2HFT"))


def test_a_file_with_a_surface_is_for_the_reader_of_faces():
    surface = (128, 0, "128,1,1,1,1,0,0,1,0,0,0.,0.,1.,1.,0.,0.,1.,1.,1.,1.,1.,1.;")
    raw = iges([*POINT_ENTITIES * 40, surface]).encode()  # the surface is far behind the first bytes

    assert sniff(Source("s.igs", raw)).read is cad.read
    assert sniff(Source("s.igs", iges(POINT_ENTITIES * 40).encode())).read is iges_points.read


def test_what_places_points_elsewhere_is_refused():
    with pytest.raises(MalformedInputError, match=r"s\.igs:\d+:1: .* is placed by a matrix"):
        read(iges(POINT_ENTITIES, matrix=7))
    with pytest.raises(MalformedInputError, match=r"model scale 0\.5"):
        read(iges(POINT_ENTITIES, scale="0.5"))


LINES = iges(POINT_ENTITIES).split("\r\n")
FIRST = next(k for k, line in enumerate(LINES, 1) if line[72:73] == "P")


@pytest.mark.parametrize(
    ("old", "new", "place", "words"),
    [
        ("116,-10.00000,-9.00000,", "116,-10.OOOOO,-9.00000,", f"{FIRST}:5", "'-10.OOOOO' is not a number"),
        ("116,-10.00000,-9.00000,", "116,          -9.00000,", f"{FIRST}:1", "may be z or a pointer"),
        ("116,-10.00000,-9.00000,", "116,         ,-9.00000,", f"{FIRST}:5", "an empty field"),
        (
            "116,-10.00000,-9.00000,0.14800,0;",
            "116,-10.00000,-9.00000,0.14800,0 ",
            f"{FIRST}:1",
            "not complete",
        ),
        ("1P      1", "1Q      1", f"{FIRST}:73", "S, G, D, P or T in column 73"),
    ],
)
def test_a_fault_is_named_with_its_place(old, new, place, words):
    text = "\r\n".join(LINES)
    assert old in text
    changed = text.replace(old, new, 1)
    with pytest.raises(MalformedInputError) as caught:
        iges_points.read(Source("s.igs", changed.encode()))

    assert str(caught.value).startswith(f"s.igs:{place}: ")
    assert words in str(caught.value)


def test_a_lost_line_and_a_lost_entity_are_seen():
    lost = [line for k, line in enumerate(LINES, 1) if k != FIRST + 2]
    with pytest.raises(MalformedInputError, match=r"8 lines in section P; expected 'P 9'"):
        read("\r\n".join(lost))
    other = "\r\n".join(LINES).replace("116,-10.00000,-9.00000,", "100,-10.00000,-9.00000,", 1)
    with pytest.raises(MalformedInputError, match=r"is not what the directory has at 1"):
        read(other)


def test_points_of_open_cascade_come_back(tmp_path):
    pytest.importorskip("OCP")
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeVertex
    from OCP.gp import gp_Pnt
    from OCP.IGESControl import IGESControl_Writer
    from OCP.Interface import Interface_Static

    Interface_Static.SetCVal_s("write.iges.unit", "MM")
    writer = IGESControl_Writer("MM", 0)
    for point in TRUTH:
        writer.AddShape(BRepBuilderAPI_MakeVertex(gp_Pnt(*point.tolist())).Vertex())
    writer.ComputeModel()
    assert writer.Write(str(tmp_path / "p.igs"))
    source = Source("p.igs", (tmp_path / "p.igs").read_bytes())

    assert sniff(source).read is iges_points.read
    np.testing.assert_array_equal(iges_points.read(source).points_mm, TRUTH)
