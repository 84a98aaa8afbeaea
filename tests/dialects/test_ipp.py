"""I++ DME: by name and by tag, with the client's commands and without."""

from __future__ import annotations

import pytest
from dialects.streams import read

from cmm_align.dialects import SERIOUS_SEVERITY, Hit, decoded, profile_of

IPP = {"dialect": "ipp"}


def traffic(*lines, **settings):
    """Return what lines of I++ DME say."""
    return read("".join(f"{line}\r\n" for line in lines).encode(), profile_of({**IPP, **settings}))


def transaction(tag, command, *data):
    """Return the lines of one command that succeeds."""
    return (f"{tag} {command}", f"{tag} &", *(f"{tag} # {one}" for one in data), f"{tag} %")


START = transaction("00001", "StartSession()")


def test_names_may_come_in_any_order_and_events_are_no_points():
    seen = traffic(
        "00169 &",
        "E0001 # X(-42.1), Y(14.8), Z(40.2)",
        "00169 # ER(1.50000), IJK(0.00000,0.00000,1.00000), X(-43.00000), Y(+15), Z(.3150210E2)",
        "00169 %",
        'E0000 ! Error(1, 0009, "", "air")',
    )

    assert seen.points_mm == [(-43.0, 15.0, 31.5021)]
    assert seen.rejected == []
    assert [note.what for note in seen.notes] == [
        "event",
        "effective tip radius 1.5 mm",
        "error 0009 of severity 1: air ()",
    ]


def test_with_the_commands_only_data_of_measuring_ones_are_points():
    seen = traffic(
        *START,
        *transaction("00002", "Get(X(),Y(),Z())", "X(1), Y(2), Z(3)"),
        *transaction("00003", "PtMeas(X(1),Y(2),Z(3),IJK(0,0,1))", "X(4), Y(5), Z(6)"),
        *transaction("00004", "CZ.ScanOnLine(1,2)", "7,8,9,0, 10,11,12,0"),
        "E0005 OnMoveReportE(Dis(10.0),X(),Y(),Z())",
        "E0005 &",
        "E0005 # X(1.0), Y(2.0), Z(3.0)",
        *transaction("00006", "GetDMEVersion()", '"1.4.3"'),
        *transaction("00007", "EndSession()"),
    )

    assert seen.points_mm == [(4.0, 5.0, 6.0), (7.0, 8.0, 9.0), (10.0, 11.0, 12.0)]
    assert seen.rejected == []
    assert [note.what for note in seen.notes if note.ends] == ["end of the session"]


def test_the_report_says_how_many_numbers_a_point_of_a_scan_has():
    report = transaction("00014", "OnScanReport(X(),Y(),Z(),IJK(),Q(),Tool.A())")
    scan = transaction("00017", "ScanOnCurve(Closed(0))", "1,2,3,0,0,1,0,99, 4,5,6,0,0,1,0,99")

    seen = traffic(*START, *report, *scan)

    assert seen.points_mm == [(1.0, 2.0, 3.0), (4.0, 5.0, 6.0)]
    assert seen.rejected == []


def test_a_refused_report_changes_nothing_and_a_new_session_goes_back_to_the_usual_one():
    refused = (
        "00014 OnScanReport(Q(),X(),Y(),Z())",
        "00014 &",
        '00014 ! Error(3, 0509, "OnScanReport", "no")',
        "00014 %",
    )
    taken = transaction("00015", "OnScanReport(Q(),X(),Y(),Z())")
    scan = transaction("00017", "ScanOnLine()", "7,2,3,4")

    assert traffic(*START, *scan).points_mm == [(7.0, 2.0, 3.0)]
    assert traffic(*START, *refused, *scan).points_mm == [(7.0, 2.0, 3.0)]
    assert traffic(*START, *taken, *scan).points_mm == [(2.0, 3.0, 4.0)]
    assert traffic(*taken, *START, *scan).points_mm == [(7.0, 2.0, 3.0)]


def test_the_columns_of_the_profile_outweigh_the_report():
    scan = transaction("00017", "ScanOnLine()", "0,2,3,4")
    report = transaction("00014", "OnScanReport(X(),Y(),Z(),Q())")

    assert traffic(*report, *scan, columns="q,x,y,z").points_mm == [(2.0, 3.0, 4.0)]


@pytest.mark.parametrize(
    ("data", "column", "words"),
    [
        ("1,2,3,0,4,5,6", 9, "7 numbers are no multiple of the 4"),
        ("1.5,2,3,100", 17, "calls this point bad"),
        ("1.5,2,3,0, 1.5,2,3,100", 28, "calls this point bad"),
        ("0.0,5.49806,6.35743,8.24709", 29, 'set columns = "q,x,y,z"'),
        ("1,2,x,0", 13, "'x' is not a number"),
        ("1,2,,0", 13, "'' is not a number"),
        ("X(1), Y(2)", 9, "a point without Z"),
        ("X(1), Y(2), Z(nan)", 23, "'nan' is not a number"),
        ("X(1), Y(2), Z(3,4)", 21, "Z with 2 numbers, expected 1"),
        ("X(1), Y(2), Z(3), X(4)", 26, "X is there twice"),
        ("X(1), Y(2), Z(3", 20, "expected a value with its name"),
        ("X(1), Y(2), Z(3), IJK(1,1,1)", 27, "no unit vector"),
        ("X(1), Y(2), Z(3), Q(100)", 27, "calls this point bad"),
        ("X(1), Y(2), Z(3e9)", 9, "further away"),
    ],
)
def test_data_that_are_no_point_are_rejected_with_their_place(data, column, words):
    seen = traffic("00017 &", f"00017 # {data}", "00017 %")

    assert len(seen.rejected) == 1
    assert seen.rejected[0][:2] == (2, column)
    assert words in seen.rejected[0].why


@pytest.mark.parametrize("data", ["R(1.5)", '"Tool 1"', "IsHomed(1)", 'Tool.Name("x"), Speed(2.5)'])
def test_data_of_unknown_commands_without_coordinates_are_notes(data):
    seen = traffic("00017 &", f"00017 # {data}", "00017 %")

    assert (seen.points_mm, seen.rejected) == ([], [])
    assert [note.what for note in seen.notes] == ["data, no point"]


def test_errors_tell_their_severity():
    seen = traffic("00018 &", '00018 ! Error(2, 1006, "PtMeas", "Surface not found")', "00018 %")

    assert [note.severity for note in seen.notes] == [SERIOUS_SEVERITY]
    assert "Surface not found" in seen.notes[0].what
    assert len(traffic('00018 ! Error(2, 1006, "PtMeas')[1]) == 1


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        (transaction("00003", "PtMeas(X(1))"), "complete without a point"),
        (("00003 PtMeas(X(1))", "00003 &", "00003 # X(1), Y(2), Z(3)"), "not complete at the end"),
        ((*START, "00003 # X(1), Y(2), Z(3)"), "no command with the tag 00003"),
        (("00000 &",), "neither a command nor a response"),
        (("0001 # X(1), Y(2), Z(3)",), "neither a command nor a response"),
        (("00001 $ X(1), Y(2), Z(3)",), "neither a command nor a response"),
    ],
)
def test_what_is_missing_in_a_recording_is_rejected(lines, words):
    rejected = traffic(*lines).rejected

    assert len(rejected) == 1
    assert words in rejected[0].why


def test_a_command_that_cannot_measure_may_stay_open():
    assert traffic(*START, "00005 GoTo(X(1))", "00005 &").rejected == []


def test_points_of_another_tip_or_another_coordinate_system_are_no_part_of_the_set():
    one, other = "ER(1.5), X(1), Y(2), Z(3)", "ER(2.5), X(1), Y(2), Z(3)"
    tips = traffic("00001 &", f"00001 # {one}", f"00001 # {other}", "00001 %")
    stated = traffic("00001 &", f"00001 # {one}", "00001 %", tip_radius_mm=2.5)
    systems = traffic(
        *transaction("00001", "SetCoordSystem(PartCsy)"),
        *transaction("00002", "PtMeas()", one),
        *transaction("00003", "SetCoordSystem(PartCsy)"),
        *transaction("00004", "PtMeas()", one),
        *transaction("00005", "SetCoordSystem(MachineCsy)"),
        *transaction("00006", "PtMeas()", one),
    )

    assert (len(tips.points_mm), "another tip" in tips.rejected[0].why) == (1, True)
    assert "expected 2.5: another tip" in stated.rejected[0].why
    assert len(systems.points_mm) == 2
    assert "the coordinate system became MachineCsy" in systems.rejected[0].why
    assert "coordinate system PartCsy" in [note.what for note in systems.notes]


def test_recorders_may_write_around_the_lines():
    seen = traffic(
        "10:22:26_14:39:46 Sent: 00003 PtMeas(X(1))",
        "10:22:26_14:39:46 Received: 00003 &\r",
        "S: 00003 # X(1), Y(2), Z(3)",
        "\\\\",
        "00003 %",
        "\\\\",
        ":",
    )

    assert seen == ([(1.0, 2.0, 3.0)], [], [])


def test_directions_come_along():
    profile = profile_of({**IPP, "axis_map": "-y,+x,+z"})
    raw = b"00003 # IJK(0.6,0.8,0.0), X(1), Y(2), Z(3)\r\n"

    assert list(decoded([raw], profile)) == [Hit(-2.0, 1.0, 3.0, (-0.8, 0.6, 0.0))]
