"""Tables with tabs: CALYPSO's features and a laser tracker's points, and what a comma means in them."""

from __future__ import annotations

import numpy as np
import pytest
from formats.saddle import CALYPSO_NAMES, INCH_TEXT, INCH_TRUTH, TEXT, TRUTH, calypso, tracker

from cmm_align.errors import MalformedInputError, UnitsError
from cmm_align.formats import calypso_table, laser_tracker
from cmm_align.formats.source import Source
from cmm_align.model import PointKind

LARGE = np.array([[-2993.8115, 4139.7103, 1438.1297], [0.5, 1.25, 2.0], [-211.4483, 1000000.125, -3721.0]])
GROUPED = [[f"{v:,.4f}" for v in row] for row in LARGE.tolist()]


def read(text: str, units: str | None = None):
    return calypso_table.read(Source("s.txt", text.encode()), units)


def read_tracker(text: str, units: str | None = None):
    return laser_tracker.read(Source("t.txt", text.encode()), units)


def test_the_saddle_comes_back_from_calypso():
    points = read(calypso())

    np.testing.assert_array_equal(points.points_mm, TRUTH)
    assert points.kind is PointKind.CONTACT
    assert points.ids.tolist() == list(range(7, 16))


def test_columns_are_found_by_name():
    names = ["unit", "nz", "z", "y", "x_nom", "x", "idsymbol", "nx", "ny", "planid", "id"]

    np.testing.assert_array_equal(read(calypso(names=names)).points_mm, TRUTH)


def test_decimal_commas_and_inches_and_utf16():
    german = [[v.replace(".", ",") for v in row] for row in TEXT]
    np.testing.assert_array_equal(read(calypso(german)).points_mm, TRUTH)
    np.testing.assert_allclose(read(calypso(INCH_TEXT, "inch")).points_mm, INCH_TRUTH, rtol=1e-15)
    raw = calypso().encode("utf-16")
    assert calypso_table.recognises(raw[:4096])
    np.testing.assert_array_equal(calypso_table.read(Source("s.txt", raw)).points_mm, TRUTH)


def test_units_that_differ_are_refused():
    lines = calypso().split("\r\n")
    lines[2] = lines[2].replace("mm", "inch")
    with pytest.raises(UnitsError, match=r"s\.txt:3:\d+: unit 'inch' after 'mm'"):
        read("\n".join(lines))
    with pytest.raises(UnitsError, match="the file states mm, --units says inch"):
        read(calypso(), "inch")


@pytest.mark.parametrize(
    ("old", "new", "place", "words"),
    [
        ("\t-10.00000\t", "\t\t", "2:22", "an empty field"),
        ("\t-10.00000\t", "\t-----\t", "2:22", "'-----' is not a number"),
        ("\t-10.00000\t-9.00000\t", "\t-1,000.0\t-\t", "2:31", "'-' is not a number"),
        ("\t-10.00000\t", "\t-1,000\t", "2:22", "has two readings: -1.000 with a decimal comma, -1000 with"),
        ("\t-10.00000\t", "\tinf\t", "2:22", "'inf' is not finite"),
        ("\t0.99734\tmm", "\t0.99z34\tmm", "2:71", "'0.99z34' is not a number"),
        ("\t0.99734\tmm", "\t0.99734\tmm\t\t\t\tmore", "2:85", "19 columns"),
        ("\ty\t", "\tu\t", "1:1", "no columns x, y, z"),
    ],
)
def test_a_fault_is_named_with_its_place(old, new, place, words):
    with pytest.raises(MalformedInputError) as caught:
        read(calypso().replace(old, new, 1))

    assert str(caught.value).startswith(f"s.txt:{place}: ")
    assert words in str(caught.value)


def test_tables_without_points_are_refused():
    with pytest.raises(MalformedInputError, match=r"there are no points in it; expected rows of SpacePoint"):
        read(calypso().replace("SpacePoint", "Circle"))
    with pytest.raises(MalformedInputError, match=r"characteristics \(\*_chr\.txt\) are no points"):
        read("planid\tpartnb\tid\ttype\tidsymbol\tactual\r\nd\t1\tA\tx\ty\t1.5\r\n")
    assert len(CALYPSO_NAMES) == 17


def test_commas_between_thousands_are_read_where_a_decimal_point_shows_them():
    points = read_tracker(tracker(GROUPED))

    np.testing.assert_array_equal(points.points_mm, LARGE[[0, 2]])  # the second one is not enabled
    assert points.ids.tolist() == [1, 3]
    assert points.kind is PointKind.TIP_CENTRE


def test_a_direction_leaves_the_kind_open_and_is_checked():
    text = tracker(GROUPED, directions=True)

    assert read_tracker(text).kind is PointKind.UNSTATED
    with pytest.raises(MalformedInputError, match=r"t\.txt:2:\d+: '0\.01OOO' is not a number"):
        read_tracker(text.replace("0.01000", "0.01OOO"))


def test_decimal_commas_of_a_tracker_are_told_from_thousands_or_refused():
    german = [[f"{v:.4f}".replace(".", ",") for v in row] for row in LARGE.tolist()]
    np.testing.assert_array_equal(read_tracker(tracker(german)).points_mm, LARGE[[0, 2]])
    three = [[f"{v % 100:.3f}".replace(".", ",") for v in row] for row in LARGE.tolist()]
    assert read_tracker(tracker(three)).points_mm[1, 1] == 0.125  # no group of thousands starts with 0
    three[2][1] = "1,125"
    with pytest.raises(MalformedInputError, match=r"t\.txt:2:\d+: '6,189' has two readings: 6\.189 .* 6189"):
        read_tracker(tracker(three))
    whole = [["1,234", "5.5", "6.5"]] * 3
    with pytest.raises(MalformedInputError, match="'1,234' has two readings"):
        read_tracker(tracker(whole))


@pytest.mark.parametrize(
    ("old", "new", "place", "words"),
    [
        ("Checked", "Maybe", "2:1", "flag 'Maybe'"),
        ("\tV1", "", "2:89", "11 columns"),
        ("\tV1", "\tV1\t\tmore", "2:93", "14 columns"),
        ("-2,993.8115", "-29,93.8115", "2:21", "'-29,93.8115' is not a number"),
        ("-2,993.8115", "           ", "2:21", "an empty field"),
    ],
)
def test_a_fault_in_a_trackers_table_is_named_with_its_place(old, new, place, words):
    with pytest.raises(MalformedInputError) as caught:
        read_tracker(tracker(GROUPED).replace(old, new, 1))

    assert str(caught.value).startswith(f"t.txt:{place}: ")
    assert words in str(caught.value)
