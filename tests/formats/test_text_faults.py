"""Delimited text that is wrong: refused with the exact place, never read as other numbers."""

from __future__ import annotations

import pytest

from cmm_align.errors import MalformedInputError, MissingFileError
from cmm_align.formats import read_points

FAULTS = [
    # text, line:column, words that must be in the message
    ("1,2\n3,4\n", "1:1", "2 columns"),
    ("1,2,3,4\n", "1:1", "two readings"),
    ("1.0,2,3,4\n", "1:1", "4 columns"),
    ("1,234,5,678\n", "1:1", "two readings"),
    ("1,5,2,5,3,5\n", "1:1", "two readings"),
    ("1 2 3\n4 5\n", "2:4", "2 columns"),
    ("1,2,3\n4,5,6,7\n", "2:7", "4 columns"),
    ("1,2,3\n4,5,6,\n", "2:7", "separator at the end"),
    ("1,2,3\n4,,6\n", "2:3", "an empty field"),
    ("1\t2\t3\n4\t\t6\n", "2:3", "an empty field"),
    ("1\t2\t3\n4\t\t5\t6\n", "2:6", "4 columns"),
    (",2,3\n", "1:1", "an empty field"),
    ("1,2,3\n4,5,six\n", "2:5", "'six' is not a number"),
    ("1 2 3\n4 5 6#7\n", "2:5", "'6#7' is not a number"),
    ("1,2,3\n4,nan,6\n", "2:3", "'nan' is not finite"),
    ("1,2,3\n4,5, -inf\n", "2:6", "'-inf' is not finite"),
    ("1,2,3\n4,5,1e999\n", "2:5", "too large"),
    ("1,2,3\n4,5,1_0\n", "2:5", "'1_0' is not a number"),
    ("1,2,3\n4,5,٣\n", "2:5", "is not a number"),
    ("1,2,3\n4,5,0x10\n", "2:5", "is not a number"),
    ("1,2,3\n4,5,−6\n", "2:5", "is not a number"),
    ('1,2,3\n4,5,"6"\n', "2:5", "is not a number"),
    ("1,2,3\n4,5,6 7\n", "2:5", "'6 7' is not a number"),
    ("1,2,3\n4,5,-\n", "2:5", "'-' is not a number"),
    ("1,2,3\n4,5,1.2.3\n", "2:5", "is not a number"),
    ("1.5;2;3\n4;2,50;6\n", "2:3", "a comma and a point"),
    ("2,500\t1.0\t2.0\n", "1:1", "two readings: 2.500 with a decimal comma, 2500 with commas"),
    ("2,500\t1,000\t2\n", "1:1", "--decimal"),
    ("2,500.02\t1.0\t25,00.0\n", "1:14", "'25,00.0' is not a number"),
    ("2.500,02;1,0;1.500\n", "1:14", "decimal comma"),
    ("2'500.02;1.0;25'00.0\n", "1:14", "is not a number"),
    ("1,5;2;3\n" * 60 + "1.5;2;3\n", "61:1", "decimal comma"),
    ("1.5;2;3\n" * 60 + "1,5;2;3\n", "61:1", "decimal point"),
    ("# c\n\nx,y,z\n1,2,3\nx,y,z\n", "5:1", "'x' is not a number"),
    ("x,y\n1,2\n", "1:1", "neither numbers nor names"),
    ("x,y,y\n1,2,3\n", "1:1", "two columns mean y"),
    ("x,y,z\n1,5,2,5,3,5\n", "2:7", "6 columns"),
    ("nan nan nan\n1 2 3\n", "1:1", "'nan' is not finite"),
    ("1 2 3 0 0 1\n1 2 3 4 5 6\n", "2:7", "no unit vector"),
    ("x,y,z,id\n1,2,3,1\n1,2,3,1.5\n", "3:7", "id 1.5"),
    ("1,2,3\n4,5\x00,6\n", "2:4", "NUL"),
    ("# cmm-align points v9; units=mm\n1,2,3\n", "1:1", "version 'v9'"),
    ("# cmm-align points v1; kind=guess\n1,2,3\n", "1:1", "kind=guess"),
    ("# cmm-align points v1; frame=lab\n1,2,3\n", "1:1", "frame=lab"),
]


@pytest.mark.parametrize(("text", "place", "words"), FAULTS)
def test_a_fault_is_named_with_its_place(text, place, words, tmp_path):
    path = tmp_path / "p.csv"
    path.write_bytes(text.encode())
    with pytest.raises(MalformedInputError) as caught:
        read_points(path)
    assert str(caught.value).startswith(f"{path}:{place}: ")
    assert words in caught.value.one_line()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["", "\n\n", "# only a comment\n", "x,y,z\n"])
def test_a_file_without_points_is_refused(text, tmp_path):
    (tmp_path / "p.csv").write_text(text)
    with pytest.raises(MalformedInputError, match=r"p\.csv: (the file is empty|there are no points)"):
        read_points(tmp_path / "p.csv")


def test_a_line_without_end_is_refused(tmp_path):
    (tmp_path / "p.csv").write_text("1,2,3\n4,5," + "6" * 70000)
    with pytest.raises(MalformedInputError, match=r"p\.csv:2:1: a line of 70004 characters"):
        read_points(tmp_path / "p.csv")


@pytest.mark.parametrize("name", ["missing.csv", "."])
def test_a_missing_file_or_a_folder_is_named(name, tmp_path):
    with pytest.raises(MissingFileError) as caught:
        read_points(tmp_path / name)
    assert caught.value.where == str(tmp_path / name)


def test_a_binary_file_is_not_read_as_text(tmp_path):
    (tmp_path / "p.bin").write_bytes(bytes(range(256)) * 4)
    with pytest.raises(MalformedInputError):
        read_points(tmp_path / "p.bin")
