"""A ledger in rows of one screen, and as a table for other programs."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import fields
from io import StringIO
from math import isfinite, log
from typing import Final

import numpy as np

from cmm_align.model import LearnedBand, LearnedTransfer, Ledger, LedgerPass, WaveBand, WheelWear
from cmm_align.report.wording import two_digits

Rows = list[tuple[str, str]]

_NESTED: Final = {"bands", "came"}
_HEAD: Final = "{:>4}  {:<10}  {:>6}  {:>6}  {:>6}  {:>6}  {:<21}  {:>6}"
_SURE: Final = 2.0


def of_ledger(
    ledger: Ledger,
    shown: Sequence[LedgerPass],
    learned: LearnedTransfer | None,
    wear: WheelWear | None,
    *,
    left_out: int = 0,
) -> Rows:
    """Return the summary of a ledger: its passes one by one, what was learned, wear, predictions.

    Parameters
    ----------
    ledger : Ledger
    shown : sequence of LedgerPass
    learned : LearnedTransfer or None
    wear : WheelWear or None
    left_out : int
        Earlier passes that are not shown.
    """
    parts = len({one.part for one in ledger.passes})
    names = [
        *([ledger.machine] if ledger.machine else []),
        *([f"wheel {ledger.wheel}"] if ledger.wheel else []),
        f"nominal {ledger.nominal_digest[:12]}",
    ]
    rows = [
        ("ledger", f"{', '.join(names)}; {_count(len(ledger.passes), 'pass')} of {_count(parts, 'part')}")
    ]
    if not ledger.passes:
        return [*rows, ("", "no pass yet: `cmm-align compensate MAP --ledger FILE` adds one")]
    rows.append(
        ("part", _HEAD.format("pass", "day", "PV um", "RMS", "PVr", "gain", "RMS predicted (95 %)", "came"))
    )
    rows += [(one.part, _pass_words(one)) for one in shown]
    if left_out:
        rows.append(("", f"and {left_out} before; --csv has them all"))
    return [*rows, *of_learned(learned), *_wear(wear, ledger), *_predictions(ledger)]


def details_of_ledger(shown: Sequence[LedgerPass]) -> Rows:
    """Return the response of each pass in each band.

    Parameters
    ----------
    shown : sequence of LedgerPass
    """
    rows = []
    for one in shown:
        if one.came is not None:
            words = [
                "-" if answer is None else f"{answer.transfer:.2f} +- {answer.u_transfer:.2f}"
                for answer in one.came.bands
            ]
            rows.append(
                (f"{one.part} {one.pass_number}", f"transfer, long to short waves: {', '.join(words)}")
            )
    return rows


def table_of_ledger(ledger: Ledger) -> str:
    """Return all passes as comma-separated text: units in the names of the columns, empty = not known."""
    plain = [field.name for field in fields(LedgerPass) if field.name not in _NESTED]
    came = ["came_time_utc", "came_rms_um", "came_pv_um", "interval_held"]
    kinds = ("deviation_rms_um", "correction_rms_um", "response_rms_um", "transfer", "u_transfer")
    names = [f"{_column(band)}_{kind}" for band in ledger.bands for kind in kinds]
    text = StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*plain, *came, *names])
    for one in ledger.passes:
        answers = (None,) * len(one.bands) if one.came is None else one.came.bands
        outcome = (
            ["", "", "", ""]
            if one.came is None
            else [one.came.time_utc, one.came.rms_um, one.came.pv_um, int(bool(one.interval_held))]
        )
        cells: list[object] = [_cell(getattr(one, name)) for name in plain] + [*outcome]
        for record, answer in zip(one.bands, answers, strict=True):
            cells += [record.deviation_rms_um, record.correction_rms_um]
            cells += (
                ["", "", ""]
                if answer is None
                else [answer.response_rms_um, answer.transfer, answer.u_transfer]
            )
        writer.writerow(cells)
    return text.getvalue()


def _pass_words(one: LedgerPass) -> str:
    """Return the numbers of a pass, aligned under `_HEAD`."""
    interval = (
        f"{one.predicted_rms_um:.2f} ({one.predicted_rms_low_um:.2f} to {one.predicted_rms_high_um:.2f})"
    )
    came = "" if one.came is None else f"{one.came.rms_um:.2f}"
    held = "  outside" if one.interval_held is False else ""
    gain = "Wiener" if one.gain_rule == "wiener" else f"{one.gain:.2f}"
    return (
        _HEAD.format(
            one.pass_number,
            one.time_utc[:10],
            f"{one.pv_um:.2f}",
            f"{one.rms_um:.2f}",
            f"{one.pvr_um:.2f}" if isfinite(one.pvr_um) else "-",
            gain,
            interval,
            came,
        ).rstrip()
        + held
    )


def of_learned(learned: LearnedTransfer | None) -> Rows:
    """Return what is known of the transfer in each band."""
    if learned is None:
        return [("transfer", "not known yet: it takes a pass, and the measurement after it, in one ledger")]
    rows = [
        (
            "" if k else "transfer",
            f"{one.transfer:.2f} +- {one.u:.2f}  {_waves(one.band)} ({_of(one)})",
        )
        for k, one in enumerate(learned.bands)
        if one.n_passes or k == 0
    ]
    return [*rows, ("", "+- is for the next part: of the mean, and the scatter between parts")]


def _wear(wear: WheelWear | None, ledger: Ledger) -> Rows:
    """Return the slope of wear."""
    if wear is None:
        told = any(one.constant_um is not None for one in ledger.passes)
        why = "too few passes" if told else "on this surface it looks like a shift of the part"
        return [("wheel wear", f"not known: {why}")]
    sure = "" if abs(wear.um_per_pass) > _SURE * wear.u_um_per_pass else ": not significant"
    dressed = f", dressed {_count(wear.n_dressings, 'time')} between" if wear.n_dressings else ""
    return [
        (
            "wheel wear",
            f"{wear.um_per_pass:+.2f} +- {two_digits(wear.u_um_per_pass)} um along the normal a pass"
            f"{sure} ({_count(wear.n_passes, 'pass')}{dressed})",
        )
    ]


def _predictions(ledger: Ledger) -> Rows:
    """Return how good the predictions were."""
    judged = [one for one in ledger.passes if one.came is not None]
    if not judged:
        return []
    held = sum(bool(one.interval_held) for one in judged)
    ratios = [log(one.came.rms_um / one.predicted_rms_um) for one in judged if one.came is not None]
    return [
        (
            "predictions",
            f"{held} of {len(judged)} within their 95 % intervals; what came over what was predicted "
            f"{np.exp(np.mean(ratios)):.2f} on average",
        )
    ]


def _of(one: LearnedBand) -> str:
    """Return what a transfer was learned from."""
    if not one.n_passes:
        return "not known, taken as 1"
    return f"{_count(one.n_passes, 'pass')} of {_count(one.n_parts, 'part')}"


def _waves(band: WaveBand) -> str:
    """Return the name of a band."""
    if not isfinite(band.long_mm):
        return f"waves over {band.short_mm:.3g} mm"
    return f"waves of {band.short_mm:.3g} to {band.long_mm:.3g} mm"


def _column(band: WaveBand) -> str:
    """Return the name of a band in the head of a table."""
    if not isfinite(band.long_mm):
        return f"waves_over_{band.short_mm:.4g}_mm"
    return f"waves_{band.short_mm:.4g}_to_{band.long_mm:.4g}_mm"


def _cell(value: object) -> object:
    """Return a value for a table: nothing for what is not known."""
    return "" if value is None or (isinstance(value, float) and not isfinite(value)) else value


def _count(number: int, noun: str) -> str:
    """Return a number and its noun."""
    plural = f"{noun}es" if noun.endswith("s") else f"{noun}s"
    return f"{number} {noun if number == 1 else plural}"
