"""Tables of limits, weights and datum points: read exactly, or refused with the place."""

from __future__ import annotations

import numpy as np
import pytest

from cmm_align.errors import MalformedInputError, MissingFileError, UnitsError
from cmm_align.formats.point_table import matched, read_fiducials, read_limits, read_weights

INF = np.inf
LIMITS = {
    "comma": "id,lower_um,upper_um\n3,-5,8\n1,-2.5,\n2,nan,4\n",
    "semicolon, decimal comma": "id;lower_um;upper_um\n3;-5;8\n1;-2,5;\n2;nan;4\n",
    "tab": "id\tlower [um]\tupper [µm]\n3\t-5\t8\n1\t-2.5\t\n2\t-inf\t4\n",
    "blanks": "# made by hand\nid lower_um upper_um\n3 -5 8\n\n1 -2.5 inf  \n# the last\n2 nan 4\n",
    "another order, more columns": "upper_um,remark,id,lower_mm\n8,a,3,-0.005\n,b,1,-0.0025\n4,c,2,\n",
}


def written(tmp_path, text):
    path = tmp_path / "table.csv"
    path.write_text(text)
    return path


@pytest.mark.parametrize("text", LIMITS.values(), ids=LIMITS.keys())
def test_limits_are_read_in_mm_and_nothing_is_no_limit(text, tmp_path):
    limits = read_limits(written(tmp_path, text))

    assert limits.ids.tolist() == [3, 1, 2]
    np.testing.assert_allclose(limits.lower_mm, [-5e-3, -2.5e-3, -INF], rtol=1e-15)
    np.testing.assert_allclose(limits.upper_mm, [8e-3, INF, 4e-3], rtol=1e-15)
    for array in (limits.ids, limits.lower_mm, limits.upper_mm):
        assert not array.flags.writeable


def test_units_are_for_columns_that_state_none(tmp_path):
    path = written(tmp_path, "id,lower,upper_mm\n1,-2,0.5\n")

    assert read_limits(path, "um").lower_mm.tolist() == [-2e-3]
    assert read_limits(path, "um").upper_mm.tolist() == [0.5]
    with pytest.raises(UnitsError, match=r"column lower states no unit; expected lower_um, .* --units"):
        read_limits(path)
    with pytest.raises(UnitsError, match="unknown unit 'furlong'"):
        read_limits(path, "furlong")


@pytest.mark.parametrize(
    ("text", "place", "words"),
    [
        ("id,lower_um\n1,2\n", "1:1", "no column upper"),
        ("1,2,3\n4,5,6\n", "1:1", "no column id, lower, upper"),
        ("id,id,lower_um,upper_um\n1,1,2,3\n", "1:4", "two columns id"),
        ("id,lower_um,upper_um\n1,-1,1\n1,-2,2\n", "3:1", "id 1 is there twice"),
        ("id,lower_um,upper_um\n1.5,-1,1\n", "2:1", "id 1.5; expected a whole number"),
        ("id,lower_um,upper_um\n,-1,1\n", "2:1", "an empty field"),
        ("id,lower_um,upper_um\n1,-1,1\n2,3,-3\n", "3:3", "lower limit of point 2 is above"),
        ("id,lower_um,upper_um\n1,-1,wide\n", "2:6", "'wide' is not a number"),
        ("id,lower_um,upper_um\n1,-1,1,1\n", "2:8", "4 columns"),
        ("id,lower_um,upper_um\n1,-1\n", "2:5", "2 columns"),
    ],
)
def test_a_fault_of_limits_is_named_with_its_place(text, place, words, tmp_path):
    path = written(tmp_path, text)

    with pytest.raises(MalformedInputError) as caught:
        read_limits(path)

    assert str(caught.value).startswith(f"{path}:{place}: ")
    assert words in caught.value.one_line()


@pytest.mark.parametrize(
    "text", ["id,lower_um,upper_um\n", "id,lower_um,upper_um\n1,,\n2,nan,inf\n", "# nothing\n"]
)
def test_limits_that_limit_nothing_are_refused(text, tmp_path):
    with pytest.raises(MalformedInputError, match=r"there (is no limit|are no rows) in it"):
        read_limits(written(tmp_path, text))


def test_a_table_that_is_not_there_is_named(tmp_path):
    with pytest.raises(MissingFileError, match=r"no\.csv"):
        read_limits(tmp_path / "no.csv")


def test_weights_are_read_by_id(tmp_path):
    weights = read_weights(written(tmp_path, "id;weight\n7;0,5\n-2;0\n9;1e3\n"))

    assert weights.ids.tolist() == [7, -2, 9]
    assert weights.weight.tolist() == [0.5, 0.0, 1000.0]


@pytest.mark.parametrize(
    ("text", "place", "words"),
    [
        ("id,weight\n1,1\n2,-0.5\n", "3:3", "weight -0.5 of point 2; expected 0 or more"),
        ("id,weight\n1,1\n2,nan\n", "3:3", "'nan' is not finite"),
        ("id,weight\n1,1\n2,\n", "3:3", "an empty field"),
        ("id,weight\n1,0\n2,0\n", "2:3", "all weights are 0"),
        ("id,weight\n1,1\n1,1\n", "3:1", "id 1 is there twice"),
    ],
)
def test_a_fault_of_weights_is_named_with_its_place(text, place, words, tmp_path):
    path = written(tmp_path, text)

    with pytest.raises(MalformedInputError) as caught:
        read_weights(path)

    assert str(caught.value).startswith(f"{path}:{place}: ")
    assert words in caught.value.one_line()


def test_a_weight_has_no_unit(tmp_path):
    with pytest.raises(MalformedInputError, match="column weight in mm; expected weight, without a unit"):
        read_weights(written(tmp_path, "id,weight_mm\n1,1\n"))


HEAD = "name,measured_x_mm,measured_y_mm,measured_z_mm,nominal_x_mm,nominal_y_mm,nominal_z_mm"


def test_datum_points_have_names_places_and_uncertainties(tmp_path):
    text = f"{HEAD},sigma_x_um,sigma_y_um,sigma_z_um\nball A,1,2,3,4,5,6,2,,inf\nB,-1,-2,-3,-4,-5,-6,1,2,3\n"

    fiducials = read_fiducials(written(tmp_path, text))

    assert fiducials.names == ("ball A", "B")
    assert fiducials.measured_mm.tolist() == [[1, 2, 3], [-1, -2, -3]]
    assert fiducials.nominal_mm.tolist() == [[4, 5, 6], [-4, -5, -6]]
    np.testing.assert_allclose(fiducials.sigma_mm, [[2e-3, INF, INF], [1e-3, 2e-3, 3e-3]], rtol=1e-15)
    assert not fiducials.sigma_mm.flags.writeable


def test_one_sigma_holds_for_the_three_axes(tmp_path):
    fiducials = read_fiducials(written(tmp_path, f"{HEAD},sigma_um\nA,1,2,3,4,5,6,2\nB,1,2,3,4,5,7,\n"))

    np.testing.assert_allclose(fiducials.sigma_mm, [[2e-3] * 3, [INF] * 3], rtol=1e-15)


@pytest.mark.parametrize(
    ("text", "place", "words"),
    [
        (f"{HEAD},sigma_mm\nA,1,2,3,4,5,6,0\n", ":2:15", "sigma 0 mm of 'A'; expected above 0; lock"),
        (f"{HEAD},sigma_mm\nA,1,2,3,4,5,6,-1\n", ":2:15", "sigma -1 mm"),
        (f"{HEAD},sigma_mm\nA,1,2,3,4,5,6,\n", "", "no axis of a datum point is used"),
        (f"{HEAD},sigma_mm\nA,1,2,3,4,5,,1\n", ":2:13", "an empty field"),
        (f"{HEAD},sigma_mm\n,1,2,3,4,5,6,1\n", ":2:1", "an empty name"),
        (f"{HEAD},sigma_mm\nA,1,2,3,4,5,6,1\nA,1,2,3,4,5,6,1\n", ":3:1", "the name 'A' is there twice"),
        (f"{HEAD}\nA,1,2,3,4,5,6\n", "", "columns without sigma"),
        (f"{HEAD},sigma_x_mm\nA,1,2,3,4,5,6,1\n", "", "columns sigmax; expected sigma_mm, or sigma_x_mm"),
        (
            f"{HEAD},sigma_mm,sigma_x_mm,sigma_y_mm,sigma_z_mm\nA,1,2,3,4,5,6,1,1,1,1\n",
            "",
            "columns sigma, sigmax",
        ),
        ("name,measured_x_mm\nA,1\n", ":1:1", "no column measured_y, measured_z, nominal_x"),
    ],
)
def test_a_fault_of_datum_points_is_named_with_its_place(text, place, words, tmp_path):
    path = written(tmp_path, text)

    with pytest.raises(MalformedInputError) as caught:
        read_fiducials(path)

    assert str(caught.value).startswith(f"{path}{place}: ")
    assert words in caught.value.one_line()


def test_rows_are_matched_by_id(rng):
    table = rng.permutation(1000) - 300
    points = rng.choice(table, 400)  # some of them several times

    rows = matched(points, table, "limits.csv")

    assert table[rows].tolist() == points.tolist()


def test_a_table_with_other_ids_is_refused_with_the_first_of_them():
    with pytest.raises(MalformedInputError) as caught:
        matched(np.arange(10), np.arange(3, 25), "limits.csv")
    words = "no row for 3 (0, 1, 2) of 10 ids; of its 22 ids 15 (10, 11, 12, 13, 14 ...) belong to no point"
    assert caught.value.what == words

    with pytest.raises(
        MalformedInputError, match=r"no row for 7 \(3, 4, 5, 6, 7 \.\.\.\) of 10 ids; expected"
    ):
        matched(np.arange(10), np.arange(3), "limits.csv")
