"""Delimited text as programs and people write it: every shape gives back the printed digits."""

from __future__ import annotations

import codecs

import numpy as np
import pytest
from formats.saddle import INCH_TEXT, INCH_TRUTH, NORMALS, TEXT, TRUTH, printed

from cmm_align.errors import InputError, MalformedInputError, UnitsError, UsageError
from cmm_align.formats import Hints, read_points
from cmm_align.formats.delimited_lines import blocks
from cmm_align.model import PointKind

UM = printed(2, 1e-3)
NUMBERED = [(str(k), *point) for k, point in enumerate(TEXT, 1)]
LARGE = np.array([[-2993.8115, 4139.7103, 1438.1297], [0.5, 1.25, 2.0], [-211.4483, 1234567.125, -3721.0]])


def rows(points, separator=",", comma=False, end="\n"):
    lines = [separator.join(point) for point in points]
    return "".join((line.replace(".", ",") if comma else line) + end for line in lines)


def aligned(points, width=14):
    return "".join("".join(f"{field:>{width}}" for field in point) + "\r\n" for point in points)


def both(points, separator=";"):
    return [(*("99.5", "98.5", "97.5"), *point) for point in points]


SHAPES = {
    "date and names": "Mon Nov 09 10:11:12 2026\r\nPOINT,X,Y,Z,I,J,K\r\n"
    + rows([(*n, *v) for n, v in zip(NUMBERED, NORMALS, strict=True)], end="\r\n"),
    "titles, no names": "STATS\r\nPLANK SCAN\r\n07/16/25 14:39:46\r\nLayer3ScanTopV1.RTN\r\n\r\n"
    + rows(TEXT),
    "German date": "09.11.2026 10:11:12\nPrüfer: Müller\nX;Y;Z\n" + rows(TEXT, ";", True),
    "ISO time": "2026-11-09T10:11:12\n" + rows(TEXT, " "),
    "count": f"{len(TEXT)}\n" + rows(TEXT, " "),
    "announced count": f"Anzahl Punkte: {len(TEXT)}\nX Y Z\n" + rows(TEXT, " "),
    "units below the names": "Nr.;X;Y;Z\n;[mm];[mm];[mm]\n" + rows(NUMBERED, ";", True),
    "units line": "Units: mm\n" + rows(TEXT, "\t"),
    "column of units": "Nr;X;Y;Z;Einheit\r\n" + rows([(*n, "mm") for n in NUMBERED], ";", True, "\r\n"),
    "Istwert and Sollwert": "Sollwert X;Sollwert Y;Sollwert Z;Istwert X;Istwert Y;Istwert Z\n"
    + rows(both(TEXT), ";", True),
    "ist and soll, behind": "X soll [mm]\tY soll [mm]\tZ soll [mm]\tX ist [mm]\tY ist [mm]\tZ ist [mm]\n"
    + rows(both(TEXT), "\t", True),
    "actual and nominal": "nom_x,nom_y,nom_z,x_act,y_act,z_act\n" + rows(both(TEXT)),
    "plain and nominal": "x,y,z,x_nom,y_nom,z_nom\n" + rows([(*p, "1", "2", "3") for p in TEXT]),
    "roles above the names": "Sollwert;;;Istwert;;\nX;Y;Z;X;Y;Z\n" + rows(both(TEXT), ";", True),
    "aligned, names with blanks": "Plug Plate: 2130\r\nDate: 2005-03-07\r\n\r\n"
    "      Meas X        Meas Y        Meas Z         Nom X         Nom Y         Nom Z\r\n"
    + aligned([(*p, "1.5", "2.5", "3.5") for p in TEXT]),
    "ruler": "X      Y      Z\n------ ------ ------\n" + rows(TEXT, "   "),
    "names in a comment": "# z y x\n" + rows([p[::-1] for p in TEXT], " "),
    "names in front": rows([(f"P{k}", *p) for k, p in enumerate(TEXT, 1)], " "),
    "separator at the end of rows": rows([(*p, "") for p in TEXT], ";"),
    "separator at all ends": "x;y;z;\n" + rows([(*p, "") for p in TEXT], ";"),
    "separator behind data only": "x;y;z\n" + rows([(*p, "") for p in TEXT], ";"),
    "quoted names": '"X","Y","Z"\n' + rows(TEXT),
    "quality": "Name;X;Y;Z;Qualität\n" + rows([(f"MP{k}", *p, "OK") for k, p in enumerate(TEXT)], ";", True),
    "three decimals": "X;Y;Z\n" + rows(printed(3), ";", True),
    "comments between": "x,y,z\n" + rows(TEXT[:4]) + "# pause\n\n" + rows(TEXT[4:]),
    "CR": "X\tY\tZ\r" + rows(TEXT, "\t", True, "\r"),
    "mixed ends": rows(TEXT[:3], end="\r\n") + rows(TEXT[3:5], end="\r") + rows(TEXT[5:]),
}


def read(raw, tmp_path, units=None, **hints):
    path = tmp_path / "p.txt"
    path.write_bytes(raw if isinstance(raw, bytes) else raw.encode())
    return read_points(path, units, Hints(**hints))


@pytest.mark.parametrize("text", SHAPES.values(), ids=SHAPES.keys())
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "cp1252"])
def test_every_shape_in_every_encoding_gives_the_printed_digits(text, encoding, tmp_path):
    points = read(text.encode(encoding), tmp_path)

    printed_mm = np.array(printed(3), dtype=np.float64) if text == SHAPES["three decimals"] else TRUTH
    np.testing.assert_array_equal(points.points_mm, printed_mm)
    assert points.passed_over == ()


@pytest.mark.parametrize("name", ["date and names", "names in front", "column of units", "quality"])
def test_numbers_and_names_become_ids(name, tmp_path):
    first = 0 if name == "quality" else 1

    assert read(SHAPES[name], tmp_path).ids.tolist() == list(range(first, first + len(TEXT)))


@pytest.mark.parametrize("micro", ["µm", "μm", "um"])
def test_each_column_may_have_its_own_unit(micro, tmp_path):
    mixed = [(x, y, um) for (x, y, _), (_, _, um) in zip(TEXT, UM, strict=True)]
    head = f"X [mm]\tY [mm]\tZ [{micro}]\r\n"
    raw = codecs.BOM_UTF16_LE + (head + rows(mixed, "\t", True, "\r\n")).encode("utf-16-le")

    points = read(raw, tmp_path).points_mm

    np.testing.assert_allclose(points, TRUTH, rtol=3e-16)
    with pytest.raises(UnitsError):
        read(raw, tmp_path, units="mm")


@pytest.mark.parametrize(
    "head",
    [
        "Units: inch\n",
        "Einheit;inch\n",
        "# units = in\n",
        "x_in y_in z_in\n",
        "X Y Z\ninch inch inch\n",
        "# cmm-align points v1; units=inch\n",
        "All dimensions in inches\n",
    ],
)
def test_a_stated_inch_is_an_inch(head, tmp_path):
    np.testing.assert_allclose(
        read(head + rows(INCH_TEXT, " "), tmp_path).points_mm, INCH_TRUTH, rtol=3e-16, atol=0
    )


def test_an_unknown_unit_is_not_taken_for_mm(tmp_path):
    with pytest.raises(UnitsError, match=r"p\.txt:1:1: unknown unit 'furlong'"):
        read("Units: furlong\n" + rows(TEXT), tmp_path)


@pytest.mark.parametrize(
    ("group", "decimal", "separator"),
    [
        (",", ".", "\t"),
        (".", ",", ";"),
        ("'", ".", ";"),
        ("’", ",", ";"),
        ("\u2009", ",", "\t"),
        ("\u202f", ".", ","),
        ("\u00a0", ",", ";"),
        (",", ".", "   "),
        ("'", ".", " "),
    ],
)
def test_marks_between_thousands_are_read_where_they_can_be_nothing_else(group, decimal, separator, tmp_path):
    texts = [[f"{v:,.4f}".replace(",", "G").replace(".", decimal) for v in row] for row in LARGE.tolist()]
    text = "".join(separator.join(row).replace("G", group) + "\n" for row in texts)

    np.testing.assert_array_equal(read(text, tmp_path).points_mm, LARGE)


def test_nominal_coordinates_alone_are_a_nominal(tmp_path):
    assert read("x_nom,y_nom,z_nom\n" + rows(TEXT), tmp_path).kind is PointKind.NOMINAL


AMBIGUOUS = "9,910;-10,075;1,595\n4,955;10,064;1,373\n"


def test_an_ambiguous_comma_shows_both_readings_and_a_hint_settles_it(tmp_path):
    with pytest.raises(
        MalformedInputError, match=r"p\.txt:1:1: '9,910' has two readings: 9\.910 .* 9910 with"
    ):
        read(AMBIGUOUS, tmp_path)
    with pytest.raises(MalformedInputError, match="--decimal"):
        read(AMBIGUOUS, tmp_path)
    assert read(AMBIGUOUS, tmp_path, decimal=",").points_mm[0].tolist() == [9.910, -10.075, 1.595]
    assert read(AMBIGUOUS, tmp_path, decimal=".").points_mm[0].tolist() == [9910.0, -10075.0, 1595.0]


def test_commas_both_ways_are_pairs_where_the_user_says_so(tmp_path):
    text = "1,5,2,25,-3,0\n4,0,0,5,6,0\n"
    with pytest.raises(MalformedInputError, match="two readings: 6 whole numbers, 3 decimal commas"):
        read(text, tmp_path)
    assert read(text, tmp_path, decimal=",").points_mm.tolist() == [[1.5, 2.25, -3.0], [4.0, 0.5, 6.0]]
    for wrong in ("1,5,2,25,-3,0\n4,0,5,6,0\n", "1,5,2,25,-3\n", "1.5,2.25,3,0,1,0\n"):
        with pytest.raises(MalformedInputError):
            read(wrong, tmp_path, decimal=",")


def test_columns_are_as_the_user_says(tmp_path):
    text = "1,10.5,11.5,12.5,0.1\n2,20.5,21.5,22.5,0.2\n"
    with pytest.raises(MalformedInputError, match=r"5 columns .* --columns"):
        read(text, tmp_path)
    points = read(text, tmp_path, columns="id,z,y,x,sigma_um")
    assert points.points_mm.tolist() == [[12.5, 11.5, 10.5], [22.5, 21.5, 20.5]]
    assert points.ids.tolist() == [1, 2]
    np.testing.assert_allclose(points.sigma_mm, [1e-4, 2e-4])
    np.testing.assert_allclose(read(text, tmp_path, columns="-,x,y,z,sigma").sigma_mm, [0.1, 0.2])


@pytest.mark.parametrize(
    ("text", "hints", "words"),
    [
        ("1.5;2.5;3.5\n", {"decimal": ","}, "expected a decimal comma, as --decimal says"),
        ("1,5;2,5;3,5\n", {"decimal": "."}, "'1,5' is not a number"),
        ("1,2,3\n", {"columns": "id,x,y,z"}, "expected 4, as --columns id,x,y,z"),
        ("z,y,x\n1,2,3\n", {"columns": "x,y,z"}, "not those of --columns"),
        ("1.5,2.5,3.5\n", {"decimal": ","}, "every second comma decimal"),
    ],
)
def test_hints_that_contradict_the_file_are_refused(text, hints, words, tmp_path):
    with pytest.raises(MalformedInputError) as caught:
        read(text, tmp_path, **hints)
    assert words in str(caught.value)


@pytest.mark.parametrize("hints", [{"columns": "x,y"}, {"columns": "x,y,z,colour"}, {"columns": "x,x,y,z"}])
def test_hints_that_are_none_are_a_wrong_use(hints, tmp_path):
    with pytest.raises(UsageError, match="--columns"):
        read("1,2,3\n", tmp_path, **hints)
    with pytest.raises(UsageError, match="decimal"):
        Hints(decimal=";")


@pytest.mark.parametrize(
    ("text", "place", "words"),
    [
        ("26\n" + rows(TEXT), "1:1", "26 points are announced, 9 are there"),
        ("Points: 8\n" + rows(TEXT), "1:1", "8 points are announced, 9 are there"),
        ("title\nP1 1.5 2.5\n" + rows(NUMBERED, " "), "2:1", "neither numbers nor names"),
        ("1 2 three\n" + rows(TEXT, " "), "1:1", "neither numbers nor names"),
        ("Rechts;Hoch;Tief\n" + rows(TEXT, ";"), "1:1", "neither numbers nor names"),
        ("X;Y;Z;X;Y;Z\n" + rows(both(TEXT), ";"), "1:1", "--columns"),
        ("x;y;z\n1;2\n" + rows(TEXT, ";"), "2:4", "2 columns"),
        ("x,y,z,quality\n1,2,3,fine\n", "2:7", "quality 'fine' is not known"),
        ("x,y,z,quality\n1,2,3,100\n4,5,6,100\n7,8,9,0\n", "2:7", "100 may be the best or the worst"),
        (rows(TEXT)[:-4], f"{len(TEXT)}:22", "it may have been cut off"),
    ],
)
def test_what_looks_like_points_that_are_lost_is_refused(text, place, words, tmp_path):
    with pytest.raises(MalformedInputError) as caught:
        read(text, tmp_path)
    assert str(caught.value).startswith(f"{tmp_path / 'p.txt'}:{place}: ")
    assert words in str(caught.value)


@pytest.mark.parametrize("name", ["date and names", "Istwert and Sollwert", "column of units", "count", "CR"])
def test_a_text_cut_anywhere_gives_no_wrong_point(name, tmp_path):
    raw, separator = SHAPES[name].encode(), "\r" if name == "CR" else "\n"
    whole = read(raw, tmp_path).points_mm
    first = raw.decode().index(TEXT[0][0][:3])
    for end in range(first, len(raw)):
        try:
            points = read(raw[:end], tmp_path).points_mm
        except InputError:
            continue
        np.testing.assert_array_equal(points, whole[: len(points)])
        lines = raw[first:end].decode().count(separator)
        assert len(points) in {lines, lines + 1}


def test_a_strict_reading_wants_an_end_of_the_last_line(tmp_path):
    text = "1 2 3.5\n4 5 6.25\n7 8 9.5"
    assert len(read(text, tmp_path)) == 3
    with pytest.raises(MalformedInputError, match=r"p\.txt:3:8: the last line '7 8 9\.5' has no end"):
        read(text, tmp_path, strict=True)
    with pytest.raises(MalformedInputError, match="it may have been cut off"):
        read("9910,-10075,1595\n9910,-10075,15", tmp_path)


@pytest.mark.parametrize("fault", ["1_000", "nan", "inf", "0x1p3", "1,5", "", "1e999", "٣", "2 3"])
@pytest.mark.parametrize("names", ["", "x;y;z;note\n"], ids=["all columns", "some columns"])
def test_a_fault_far_down_is_found_with_its_place(fault, names, tmp_path):
    tail = ";a.b" if names else ""
    line = f"1.234567;-2.5;3.25{tail}\n"
    number = 70_000
    text = names + line * number + f"1.5;{fault};3.25{tail}\n" + line * 10

    assert len(list(blocks(text, 0, 1))) > 1
    with pytest.raises(MalformedInputError) as caught:
        read(text, tmp_path)

    where = f"{tmp_path / 'p.txt'}:{number + 1 + bool(names)}:5: "
    assert str(caught.value).startswith(where)
    assert fault in str(caught.value)


@pytest.mark.parametrize("line", ["1.5;2.5\n", "1.5;2.5;3.5;4.5;5.5\n", "1.5;2.5;3.5\n1.5;2.5;3.5;4.5;5.5\n"])
def test_a_row_with_another_number_of_columns_far_down_is_found(line, tmp_path):
    row = "1.234567;-2.5;3.25;abc\n"
    text = "x;y;z;note\n" + row * 60_000 + line + row

    with pytest.raises(MalformedInputError, match=r"p\.txt:60002:\d+: \d columns .*; expected 4"):
        read(text, tmp_path)


def test_random_tables_come_back_to_the_bit(tmp_path):
    rng = np.random.default_rng(1)
    for separator, comma in [(",", False), (";", True), ("\t", True), ("  ", False), (" ", True)]:
        values = rng.normal(size=(300, 3)) * 10.0 ** rng.integers(-8, 6, size=(300, 3))
        text = "".join(separator.join(map(repr, row)) + "\r\n" for row in values.tolist())
        got = read(text.replace(".", ",") if comma else text, tmp_path).points_mm
        np.testing.assert_array_equal(got, values)
