"""The tables of measured numbers in README.md: written by a script, dated, and not by hand."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parent / "bench"))
from bench_table import README, Line, Table, faults_of_readme, markdown, marked, rows_of, without_numbers

TABLE = Table(
    "speed",
    ("work", "bar", "measured"),
    (Line("align 1.2e6 points", "≤ 1.5 s", "1.2 s", True), Line("help", "≤ 0.15 s", "0.2 s", False)),
    "python tests/bench/speed.py",
)


def page(table: Table) -> str:
    return f"text\n\n<!-- bench {table.name} -->\n{markdown(table)}\n<!-- end {table.name} -->\n\nmore\n"


def test_a_table_fits_what_its_script_writes_whatever_the_numbers() -> None:
    small = replace(
        TABLE, lines=(Line("align 20 points", "≤ 1.5 s", "no"), Line("help", "≤ 0.15 s", "not installed"))
    )

    assert faults_of_readme([TABLE], page(TABLE)) == []
    assert faults_of_readme([small], page(TABLE)) == []


@pytest.mark.parametrize(
    "changed",
    [
        replace(TABLE, words=("work", "limit", "measured")),
        replace(TABLE, lines=TABLE.lines[:1]),
        replace(TABLE, lines=(replace(TABLE.lines[0], bar="≤ 1.5 min"), TABLE.lines[1])),
        replace(TABLE, name="other"),
    ],
)
def test_another_heading_line_bar_or_name_does_not_fit(changed: Table) -> None:
    assert len(faults_of_readme([changed], page(TABLE))) == 1


def test_a_table_without_day_command_or_machine_does_not_fit() -> None:
    text = page(TABLE).replace("Measured 2", "Seen 2")

    assert any("when, how and on what" in fault for fault in faults_of_readme([TABLE], text))


def test_a_missed_bar_is_told() -> None:
    assert [row[2].endswith("**missed**") for row in rows_of(markdown(TABLE))[1:]] == [False, True]


def test_numbers_are_taken_out_whole() -> None:
    assert without_numbers("1.2e6 points, 1 021 × 3e-05") == "# points, # # × #"


@pytest.mark.parametrize("name", ["paper", "peers", "scaling"])
def test_the_readme_holds_the_tables_of_all_benches(name: str) -> None:
    found = marked(name).search(README.read_text(encoding="utf-8"))

    assert found is not None
    assert len(rows_of(found[2])) > 5
    assert "Measured 20" in found[2]
    assert "--small" not in found[2]
    assert "/home" not in found[2]
