"""Dumps and logs of machines as files: letters before numbers, GMServer's hits, I++ responses."""

from __future__ import annotations

import numpy as np
import pytest
from formats.saddle import NORMALS, TEXT, TRUTH, printed

from cmm_align.errors import MalformedInputError, UnitsError
from cmm_align.formats import generic_dump, gmserver_log, ipp_log, sniff
from cmm_align.formats.source import Source
from cmm_align.model import PointKind

COUNTS = [[str(round(float(v) * 1000)) for v in point] for point in printed(3)]
MM = np.array(printed(3), dtype=np.float64)


def lettered(points, more: str = "", end: str = "\r\n") -> str:
    return "".join("X{},Y{},Z{}{}{}".format(*point, more, end) for point in points)


def hits(w: str = "0.000000") -> str:
    rows = zip(TEXT, NORMALS, strict=True)
    return "".join("\n ( {} {} {} {} {} {} {} ) HIT\r".format(*point, w, *normal) for point, normal in rows)


def responses(commands: bool = False) -> str:
    lines = ["00001 StartSession()", "00001 &", "00001 %", "E0001 OnMoveReportE(Dis(10.0),X(),Y(),Z())"]
    for k, (point, normal) in enumerate(zip(TEXT, NORMALS, strict=True), 10):
        x, y, z = point
        lines += [f"{k:05d} PtMeas(X({x}),Y({y}),Z(99),IJK(0,0,1))", f"{k:05d} &", "E0001 # X(9), Y(9), Z(9)"]
        lines += [f"{k:05d} # ER(1.50000), IJK({','.join(normal)}), X({x}), Y({y}), Z({z})", f"{k:05d} %"]
    keep = [line for line in lines if commands or line[6] in "&%#!"]
    return "\r\n".join(keep) + "\r\n"


def scan(quality: str = "0") -> str:
    values = [f"{','.join(point)},{quality if k == 4 else 0}" for k, point in enumerate(TEXT)]
    blocks = [values[:5], values[5:8], values[8:]]
    data = [f"00017 # {', '.join(block)}" for block in blocks]
    return "\r\n".join(["00017 &", *data, "00017 %"]) + "\r\n"


def read(text: str, units: str | None = None):
    source = Source("s.txt", text.encode())
    return sniff(source).read(source, units)


SHAPES = {
    "3": (lettered(printed(3)), None, MM),
    "4": (lettered(COUNTS), "um", MM),
    "4 in mm": (lettered(COUNTS), "mm", MM * 1000.0),
    "4, CR only": (lettered(COUNTS, end="\r"), "um", MM),
    "7": (lettered(printed(3), ",W245.5"), None, MM),
    "8": (lettered(COUNTS, ",W2455"), "um", MM),
    "3 in inches": (lettered(printed(3)), "inch", MM * 25.4),
    "GMServer": (hits(), None, TRUTH),
    "I++ responses": (responses(), None, TRUTH),
    "I++ both sides": (responses(commands=True), None, TRUTH),
    "I++ scan": (scan(), "mm", TRUTH),
    "I++ scan, recorded by NIST": (scan().replace("\r\n", "\r\n\\\\\r\n") + ":\r\n", None, TRUTH),
}


@pytest.mark.parametrize(("text", "units", "truth"), SHAPES.values(), ids=SHAPES.keys())
def test_the_saddle_comes_back(text, units, truth):
    points = read(text, units)

    np.testing.assert_allclose(points.points_mm, truth, rtol=1e-15)
    assert points.kind is PointKind.TIP_CENTRE


def test_counts_without_a_unit_show_both_readings_and_the_flag():
    with pytest.raises(
        UnitsError, match=r"s\.txt:1:1: 'X-10000,Y-9000,Z148' has two readings.*--units um .*mm"
    ):
        read(lettered(COUNTS))


def test_positions_are_no_hits_and_bad_points_are_left_out():
    positions = "\n ( 9.0 9.0 9.0 0.0 )\r" + hits()
    np.testing.assert_array_equal(read(positions).points_mm, TRUTH)
    np.testing.assert_array_equal(read(scan("100")).points_mm, np.delete(TRUTH, 4, axis=0))


FAULTS = [
    (lettered(printed(3)).replace("Y-9.000", "Y-9.00", 1), "1:10", "3 decimals"),
    (lettered(printed(3)).replace("Y-9.000", "-9.000", 1), "1:10", "is no y"),
    (lettered(printed(3)).replace("Y12.500", "Yx", 1), "7:10", "is no y"),
    (lettered(printed(3)).removesuffix("\r\n"), "9:1", "cut off"),
    (lettered(printed(3), ",W10.0") + "X1.000,Y1.000,Z1.000,W55.0\r\n", "10:23", "rotary table"),
    (hits().replace("0.14800 0.000000", "0.14800 0.O00000", 1), "2:31", "is not a number"),
    (hits().replace(" ) HIT", " ", 1), "2:", "brackets"),
    (hits()[:-8], "10:1", "cut off"),
    (hits() + "\n ( 1 2 3 90.0 0 0 1 ) HIT\r", "11:", "rotary table"),
    (scan().replace(",0\r\n00017 %", "\r\n00017 %"), "4:", "no multiple of the 4"),
    (scan().replace("00017 %\r\n", ""), "1:1", "not complete"),
    (responses().replace("00012 %\r\n", ""), "", "not complete"),
    (responses().replace("Z(0.14800)", "Z(0.14 800)", 1), "", "Z"),
]


@pytest.mark.parametrize(("text", "place", "words"), FAULTS)
def test_a_fault_is_named_with_its_place(text, place, words):
    with pytest.raises(MalformedInputError) as caught:
        read(text)

    assert str(caught.value).startswith(f"s.txt:{place}")
    assert words in str(caught.value)


def test_the_protocol_knows_millimetres_only():
    with pytest.raises(UnitsError, match=r"I\+\+ DME is in mm, --units says inch"):
        read(scan(), "inch")


@pytest.mark.parametrize("module", [generic_dump, gmserver_log, ipp_log])
def test_plain_columns_are_left_to_the_delimited_reader(module):
    for text in ("1.5,2.5,3.5\n", "x,y,z\n1,2,3\n", "00001 2 3\n", "X Y Z\n1 2 3\n", ""):
        assert not module.recognises(text.encode())
