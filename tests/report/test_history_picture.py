"""The picture of a ledger and its table: what is drawn, what is told, and that neither needs luck."""

from __future__ import annotations

import csv
import math
from dataclasses import replace

import pytest

from cmm_align.model import (
    BandRecord,
    BandResponse,
    LearnedBand,
    LearnedTransfer,
    Ledger,
    LedgerPass,
    PassOutcome,
    WaveBand,
    WheelWear,
)
from cmm_align.report.history_picture import MOST_COLOURS, draw_history
from cmm_align.report.ledger_summary import of_ledger, table_of_ledger

BANDS = (WaveBand(31.0, math.inf), WaveBand(15.5, 31.0))


def a_pass(part: str, number: int, rms: float, came: float | None) -> LedgerPass:
    answers = (BandResponse(2.0, 0.5, 0.05), None)
    return LedgerPass(
        part, number, "2026-01-31T12:00:00Z", f"{part}{number}", "a" * 64, "", "", 2000, 6.0 * rms, rms,
        5.5 * rms, rms, 0.01, float("nan"), 1.0, 0.5, 0.0, "fixed", 1.0, 0.9 * rms, 0.6 * rms, 1.3 * rms,
        5.0 * rms, 4.0 * rms, 7.0 * rms, 0.6, (BandRecord(4.0, 3.5), BandRecord(1.0, 0.5)),
        None if came is None else PassOutcome("", "2026-02-01T12:00:00Z", came, 6.0 * came, answers),
    )  # fmt: skip


PASSES = (a_pass("W1", 1, 4.0, 4.0), a_pass("W1", 2, 2.0, 1.0), a_pass("W2", 1, 3.0, None))
LEDGER = Ledger("a" * 64, "MCG 250", "D46", "2026-01-31T12:00:00Z", BANDS, PASSES)


@pytest.mark.parametrize("suffix", ["png", "svg"])
def test_the_same_ledger_gives_the_same_bytes(tmp_path, suffix):
    files = [tmp_path / f"{k}.{suffix}" for k in "ab"]
    for file in files:
        draw_history(PASSES, file, title="$window$", source="MCG 250")
    assert files[0].read_bytes() == files[1].read_bytes()
    assert files[0].stat().st_size > 5000


def test_one_pass_and_many_parts_can_be_drawn(tmp_path):
    draw_history(PASSES[2:], tmp_path / "one.png")
    many = [a_pass(f"W{k}", 1, 3.0 + 0.1 * k, None) for k in range(MOST_COLOURS + 3)]
    draw_history(many, tmp_path / "many.png")


def test_the_summary_says_what_was_predicted_what_came_and_what_was_outside():
    learned = LearnedTransfer(
        (LearnedBand(BANDS[0], 0.5, 0.07, 0.05, 2, 1), LearnedBand(BANDS[1], 0.5, 0.14, 0, 0, 0)), 0.07
    )
    rows = of_ledger(LEDGER, PASSES, learned, WheelWear(0.25, 0.05, 3, 1))
    text = "\n".join(f"{label}  {value}" for label, value in rows)
    assert "MCG 250, wheel D46, nominal aaaaaaaaaaaa; 3 passes of 2 parts" in text
    assert "3.60 (2.40 to 5.20)" in text
    assert text.count("outside") == 1  # 1.0 is below 0.6 * 2.0
    assert "0.50 +- 0.07  waves over 31 mm (2 passes of 1 part)" in text
    assert "15.5 to 31" not in text  # nothing was learned there
    assert "+0.25 +- 0.050 um along the normal a pass (3 passes, dressed 1 time between)" in text
    assert "1 of 2 within their 95 % intervals" in text


def test_columns_stand_under_their_heads():
    rows = [value for _, value in of_ledger(LEDGER, PASSES, None, None)]
    head = next(value for value in rows if value.startswith("pass"))
    first = rows[rows.index(head) + 1]
    for name, number in (("PV um", "24.00"), ("gain", "1.00"), ("came", "4.00")):
        assert first[: head.index(name) + len(name)].endswith(number)


def test_wear_that_is_not_known_says_why():
    flat = tuple(replace(one, constant_um=None) for one in PASSES)
    for passes, why in ((PASSES, "too few passes"), (flat, "looks like a shift of the part")):
        rows = of_ledger(replace(LEDGER, passes=passes), passes, None, None)
        assert any(label == "wheel wear" and why in value for label, value in rows)


def test_the_table_has_a_row_for_each_pass_and_units_in_its_heads():
    rows = list(csv.DictReader(table_of_ledger(LEDGER).splitlines()))
    assert [(row["part"], row["pass_number"]) for row in rows] == [("W1", "1"), ("W1", "2"), ("W2", "1")]
    assert [row["interval_held"] for row in rows] == ["1", "0", ""]
    assert rows[0]["pvr_um"] == ""
    assert float(rows[0]["waves_over_31_mm_transfer"]) == 0.5
    assert rows[0]["waves_15.5_to_31_mm_transfer"] == ""
    assert float(rows[0]["waves_15.5_to_31_mm_correction_rms_um"]) == 0.5
