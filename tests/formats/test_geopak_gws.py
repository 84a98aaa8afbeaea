"""GEOPAK scans: the plane decides the order of the columns, the header may be missing."""

from __future__ import annotations

import numpy as np
import pytest
from formats.saddle import INCH_TEXT, INCH_TRUTH, TRUTH, geopak

from cmm_align.errors import MalformedInputError, UnitsError
from cmm_align.formats import geopak_gws
from cmm_align.formats.source import Source
from cmm_align.model import PointKind


def read(text: str, units: str | None = None):
    return geopak_gws.read(Source("s.gws", text.encode()), units)


@pytest.mark.parametrize("plane", ["XY(Z)", "YZ(X)", "ZX(Y)"])
def test_the_saddle_comes_back_from_every_plane(plane):
    points = read(geopak(plane=plane))

    np.testing.assert_array_equal(points.points_mm, TRUTH)
    assert points.kind is PointKind.UNSTATED


def test_inches_are_stated_in_the_file():
    np.testing.assert_allclose(read(geopak(INCH_TEXT, unit="Inch")).points_mm, INCH_TRUTH, rtol=1e-15)
    with pytest.raises(UnitsError, match=r"s\.gws:5:5: the file states Inch, --units says mm"):
        read(geopak(INCH_TEXT, unit="Inch"), "mm")


def test_without_a_header_the_plane_is_xy_and_the_unit_is_the_users():
    text = "\n".join(line for line in geopak().split("\r\n") if not line.startswith("#0") or "#03" in line)

    np.testing.assert_array_equal(read(text).points_mm, TRUTH)
    np.testing.assert_array_equal(read(text, "inch").points_mm, TRUTH * 25.4)


def test_each_contour_has_its_own_plane_and_unit():
    points = read(geopak(INCH_TEXT, plane="YZ(X)", unit="Inch") + geopak())

    np.testing.assert_allclose(points.points_mm, np.concatenate([INCH_TRUTH, TRUTH]), rtol=1e-15)


@pytest.mark.parametrize(
    ("old", "new", "place", "words"),
    [
        ("#03: -10.00000 -9.00000", "#03: -10.00000 -9.0O000", "6:16", "'-9.0O000' is not a number"),
        ("#03: -10.00000 -9.00000", "#03: -10.00000", "6:5", "2 numbers"),
        ("#03: -10.00000 -9.00000", "#03: -10,00000 -9,00000", "6:6", "decimals or thousands"),
        ("#03: -10.00000 -9.00000", "#12: -10.00000 -9.00000", "6:5", "3 numbers"),
        ("#03: -10.00000", "#03: nan", "6:6", "'nan' is not a number"),
        ("#03: -10.00000", "#03: 1e999", "6:6", "too large"),
        ("#03: -10.00000", "#03: 1_0", "6:6", "'1_0' is not a number"),
        ("#03: -10.00000", "#08: -10.00000", "6:1", "is not known"),
        ("#03: -10.00000", "-10.00000", "6:1", "a tag as #03:"),
        ("XY(Z)", "RZ(P)", "3:5", "polar"),
    ],
)
def test_a_fault_is_named_with_its_place(old, new, place, words):
    with pytest.raises(MalformedInputError) as caught:
        read(geopak().replace(old, new, 1))

    assert str(caught.value).startswith(f"s.gws:{place}: ")
    assert words in str(caught.value)


def test_a_header_without_points_and_an_unknown_unit_are_refused():
    with pytest.raises(MalformedInputError, match="there are no points"):
        read("#00:GEOPAK-WIN Scanning\n#04:XY(Z)\n")
    with pytest.raises(UnitsError, match=r"s\.gws:5:5: unknown unit 'Foot'"):
        read(geopak(unit="Foot"))
