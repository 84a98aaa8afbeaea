"""VDA-FS points: records of 80 columns, statements over many of them, counts that must hold."""

from __future__ import annotations

import numpy as np
import pytest
from formats.saddle import NORMALS, TRUTH, printed, vda

from cmm_align.errors import MalformedInputError
from cmm_align.formats import vda_fs
from cmm_align.formats.source import Source
from cmm_align.model import PointKind


def read(text: str, units: str | None = None):
    return vda_fs.read(Source("s.vda", text.encode()), units)


@pytest.mark.parametrize("numbered", [True, False])
@pytest.mark.parametrize("word", ["POINT", "PSET", "MDI"])
def test_the_saddle_comes_back_from_every_statement(word, numbered):
    points = read(vda(word, numbered=numbered))

    np.testing.assert_array_equal(points.points_mm, TRUTH)
    assert points.kind is PointKind.CONTACT
    assert points.ids.tolist() == list(range(7, 16) if word == "POINT" else range(9))


def test_exponents_of_fortran_and_the_unit_of_the_user():
    text = vda("POINT").replace("-10.00000", "-1.0D+01 ")

    np.testing.assert_array_equal(read(text, "inch").points_mm, TRUTH * 25.4)


def test_fixed_width_up_to_column_72_is_parted_from_the_record_number():
    lines = [f"{'POINTS  =HEADER/1':<72}00000000", f"{'$$ one record a point':<72}00000000"]
    for k, (point, normal) in enumerate(zip(printed(3), NORMALS, strict=True), 1):
        x, y, z, *direction = (float(v) for v in (*point, *normal))
        cosines = ",".join(f"{v:8.4f}" for v in direction)
        lines.append(f"P{k:<7}=MDI/1,{x:10.3f},{y:9.3f},{z:9.3f},{cosines}{10 * k:08d}")
    lines.append(f"{'POINTS  =END':<72}00000000\n")

    assert {len(line) for line in lines[:-1]} == {80}
    points = read("\n".join(lines))
    np.testing.assert_array_equal(points.points_mm, np.array(printed(3), dtype=np.float64))
    assert points.ids.tolist() == list(range(1, 10))


def test_eight_digits_that_may_be_a_number_are_refused_in_a_file_with_long_lines():
    lines = vda("PSET").split("\r\n")
    long = f"SCAN2 = PSET / 1, {'1.5':>50},{'2.5':>20},{'3.5':>20}"
    digits = f"SCAN3 = PSET / 1, 1.5,2.5,{'3.5':0<46}00000012"
    with pytest.raises(MalformedInputError, match=r"s\.vda:2:73: .* has two readings"):
        read("\n".join([long, digits, *lines]))


@pytest.mark.parametrize(
    ("old", "new", "place", "words"),
    [
        ("PSET / 9", "PSET / 8", "5:1", "27 numbers in PSET / 8"),
        ("PSET / 9", "PSET / 9.5", "5:1", "27 numbers in PSET / 9.5"),
        ("-3.50000,", "-3.5O000,", "7:1", "'-3.5O000' is not a number"),
        ("-3.50000,", "-3.50000 ", "7:1", "is not a number"),
        ("-3.50000,", "        ,", "7:1", "an empty field"),
        ("SCAN = PSET", "T = TMAT / 1, 0, 0\nSCAN = PSET", "5:1", "is not read"),
        ("SCAN = PSET", "SCAN = PEST", "5:1", "is not read"),
        ("SCAN = PSET / 9,", "", "6:1", "'-10.00000, -9.00000"),
    ],
)
def test_a_fault_is_named_with_its_place(old, new, place, words):
    with pytest.raises(MalformedInputError) as caught:
        read(vda(numbered=False).replace(old, new, 1))

    assert str(caught.value).startswith(f"s.vda:{place}: ")
    assert words in str(caught.value)


def test_a_file_without_end_was_cut_off():
    with pytest.raises(MalformedInputError, match="may have been cut off; expected END"):
        read(vda("POINT").replace("DEMO    = END", "$$           "))


def test_curves_beside_the_points_are_passed_over_and_alone_refused():
    curve = "C1 = CURVE / 1, 0., 1., 2, 0., 1., 0., 1., 0., 1.\n"
    np.testing.assert_array_equal(read(curve + vda()).points_mm, TRUTH)
    with pytest.raises(MalformedInputError, match="there are no points"):
        read(curve + "A = END\n")
