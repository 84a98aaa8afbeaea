"""Delimited text: every honest way to write three points is read exactly."""

from __future__ import annotations

import codecs

import numpy as np
import pytest

from cmm_align.errors import MalformedInputError, UnitsError
from cmm_align.formats import read_points, text_blocks
from cmm_align.formats.delimited_layout import layout_of
from cmm_align.formats.delimited_scan import scan
from cmm_align.model import PointKind

POINTS = [[1.5, 2.25, -3.0], [4.0, 5e-3, 6.0], [0.1, -8.0, 9.125]]

HONEST = {
    "comma": "1.5,2.25,-3\n4,5e-3,6\n.1,-8.,9.125\n",
    "comma and blank": "1.5, 2.25, -3\n4, 5e-3, 6\n.1, -8., 9.125\n",
    "semicolon": "1.5;2.25;-3\n4;5e-3;6\n.1;-8.;9.125\n",
    "tab": "1.5\t2.25\t-3\n4\t5e-3\t6\n.1\t-8.\t9.125\n",
    "comma and tab": "1.5,\t2.25,\t-3\n4,\t5e-3,\t6\n.1,\t-8.,\t9.125\n",
    "blanks": "  1.5   2.25 -3\n 4 5e-3 6\n.1 -8. 9.125\n",
    "no end of line": "1.5 2.25 -3\n4 5e-3 6\n.1 -8. 9.125",
    "decimal comma, semicolon": "1,5;2,25;-3\n4;5e-3;6\n,1;-8,;9,125\n".replace(",1;-8,;", "0,1;-8;"),
    "decimal comma, tab": "1,5\t2,25\t-3\n4\t5e-3\t6\n0,1\t-8\t9,125\n",
    "decimal comma, blanks": "1,5 2,25 -3\n4 5e-3 6\n0,1 -8 9,125\n",
    "CRLF": "1.5,2.25,-3\r\n4,5e-3,6\r\n.1,-8.,9.125\r\n",
    "CR": "1.5,2.25,-3\r4,5e-3,6\r.1,-8.,9.125\r",
    "mixed line ends": "1.5,2.25,-3\r\n4,5e-3,6\r.1,-8.,9.125\n",
    "comments": "# a\n% b\n! c\n// d\n\n1.5,2.25,-3\n# e\n4,5e-3,6\n\n.1,-8.,9.125\n",
    "names": "x,y,z\n1.5,2.25,-3\n4,5e-3,6\n.1,-8.,9.125\n",
    "names in another order": "Z [mm];n;X [mm];Y [mm]\n-3;7;1.5;2.25\n6;7;4;5e-3\n9.125;7;.1;-8.\n",
    "names with blanks between": "X Y Z\n1.5 2.25 -3\n4 5e-3 6\n.1 -8. 9.125\n",
    "words in a column we do not need": "name,x,y,z\na b,1.5,2.25,-3\n#,4,5e-3,6\n".replace("#", "c")
    + "d,.1,-8.,9.125\n",
    "unit vectors": "1.5,2.25,-3,0,0,1\n4,5e-3,6,0,0.6,0.8\n.1,-8.,9.125,1,0,0\n",
    "Fortran exponent": "1.5 2.25D0 -3\n4 5D-3 6\n.1 -8. 9.125d+00\n",
    "plus signs": "+1.5 +2.25 -3\n+4 +5E-03 6\n+.1 -8. 9.125\n",
}


@pytest.mark.parametrize("text", HONEST.values(), ids=HONEST.keys())
def test_honest_text_is_read_exactly(text, tmp_path):
    path = tmp_path / "points.txt"
    path.write_bytes(text.encode())
    points = read_points(path)
    np.testing.assert_array_equal(points.points_mm, POINTS)
    assert points.kind is PointKind.UNSTATED
    assert points.ids.tolist() == [0, 1, 2]


@pytest.mark.parametrize(
    "raw",
    [
        codecs.BOM_UTF8 + HONEST["names"].encode(),
        HONEST["names"].encode("utf-16"),
        codecs.BOM_UTF16_BE + HONEST["names"].encode("utf-16-be"),
        HONEST["names"].encode("utf-16-le"),
        HONEST["names"].encode("utf-16-be"),
        "# 5 µm\n".encode("cp1252") + HONEST["names"].encode(),
        "# 5 µm\n".encode() + HONEST["names"].encode(),
    ],
    ids=["UTF-8 mark", "UTF-16", "UTF-16 BE", "UTF-16 LE no mark", "UTF-16 BE no mark", "cp1252", "UTF-8"],
)
def test_every_encoding_gives_the_same_points(raw, tmp_path):
    (tmp_path / "p.csv").write_bytes(raw)
    np.testing.assert_array_equal(read_points(tmp_path / "p.csv").points_mm, POINTS)


def test_the_suffix_does_not_matter(tmp_path):
    (tmp_path / "p.stl").write_text(HONEST["comma"])
    np.testing.assert_array_equal(read_points(tmp_path / "p.stl").points_mm, POINTS)


def test_our_header_states_unit_kind_and_frame(tmp_path):
    (tmp_path / "p.csv").write_text(
        "# cmm-align points v1; units=um; kind=contact; frame=part\nx_um,y_um,z_um,id,sigma_um\n"
        "1500,2250,-3000,7,2\n4000,5,6000,-9,4\n"
    )
    points = read_points(tmp_path / "p.csv")
    np.testing.assert_allclose(points.points_mm, POINTS[:2], rtol=1e-15)
    assert (points.kind, points.frame) == (PointKind.CONTACT, "part")
    assert points.ids.tolist() == [7, -9]
    np.testing.assert_allclose(points.sigma_mm, [2e-3, 4e-3], rtol=1e-15)


@pytest.mark.parametrize(
    ("text", "units"),
    [
        ("# cmm-align points v1; units=mm\n1,2,3\n", "inch"),
        ("x_um,y_um,z_um\n1,2,3\n", "mm"),
        ("# cmm-align points v1; units=mm\nx_um,y_um,z_um\n1,2,3\n", None),
        ("x_um,y,z_mm\n1,2,3\n", None),
        ("x,y,z,unit\n1,2,3,mm\n1,2,3,inch\n", None),
        ("Units: inch\nx_um,y_um,z_um\n1,2,3\n", None),
        ("Units: mm\n1,2,3\n", "inch"),
        ("# cmm-align points v1; units=furlong\n1,2,3\n", None),
        ("1,2,3\n", "furlong"),
    ],
)
def test_units_that_contradict_are_refused(text, units, tmp_path):
    (tmp_path / "p.csv").write_text(text)
    with pytest.raises(UnitsError):
        read_points(tmp_path / "p.csv", units)


@pytest.mark.parametrize(("units", "scale"), [(None, 1.0), ("um", 1e-3), ("inch", 25.4), ("mm", 1.0)])
def test_a_given_unit_scales_a_file_without_one(units, scale, tmp_path):
    (tmp_path / "p.csv").write_text(HONEST["comma"])
    np.testing.assert_allclose(
        read_points(tmp_path / "p.csv", units).points_mm, np.array(POINTS) * scale, rtol=1e-15
    )


def test_the_fast_and_the_exact_reader_agree_to_the_bit(tmp_path):
    values = np.random.default_rng(0).normal(size=(500, 3)) * 10.0 ** np.arange(-3, 6, 3)
    text = "\n".join(",".join(repr(v) for v in row) for row in values.tolist())
    (tmp_path / "p.csv").write_text(text)
    np.testing.assert_array_equal(read_points(tmp_path / "p.csv").points_mm, values)
    np.testing.assert_array_equal(scan(text, layout_of(text, "p"), "p"), values)


def test_weights_have_no_unit_and_come_back_as_they_were_written(tmp_path):
    (tmp_path / "p.csv").write_text(
        "x_um,y_um,z_um,id,sigma_um,Weight\n1500,2250,-3000,7,2,0.25\n4000,5,6000,-9,4,0\n"
    )

    points = read_points(tmp_path / "p.csv")

    assert points.weight.tolist() == [0.25, 0.0]
    (tmp_path / "again.csv").write_bytes(b"".join(text_blocks(points, with_ids=True)))
    again = read_points(tmp_path / "again.csv")
    assert (again.weight.tolist(), again.ids.tolist()) == ([0.25, 0.0], [7, -9])
    np.testing.assert_allclose(again.sigma_mm, [2e-3, 4e-3], rtol=1e-3)  # written with four digits


@pytest.mark.parametrize(
    ("rows", "place", "words"),
    [
        ("x,y,z,weight\n1,2,3,1\n1,2,3,-0.5\n", "3:7", "weight -0.5; expected 0 or more"),
        ("x,y,z,weight\n1,2,3,1\n1,2,3,nan\n", "3:7", "'nan' is not finite"),
        ("x,y,z,weight\n1,2,3,\n", "2:7", "an empty field"),
        ("# c\nx,y,z,weight\n1,2,3,0\n1,2,3,0\n", "3:7", "all weights are 0"),
        ("x,y,z,sigma_mm\n1,2,3,0.1\n# c\n1,2,3,0\n", "4:7", "sigma 0; expected above 0"),
        ("x,y,z,sigma_mm\n1,2,3,-1e-3\n", "2:7", "sigma -0.001"),
    ],
)
def test_weights_and_uncertainties_that_cannot_steer_a_fit_are_refused(rows, place, words, tmp_path):
    path = tmp_path / "p.csv"
    path.write_text(rows)

    with pytest.raises(MalformedInputError) as caught:
        read_points(path)

    assert str(caught.value).startswith(f"{path}:{place}: ")
    assert words in caught.value.one_line()
