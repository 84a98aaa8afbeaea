"""The tables of a ledger: one row a pass, one a pass and band; nouns to rows and back.

Units are in the names of the columns; what is not known is NULL.
"""

from __future__ import annotations

import sqlite3
from dataclasses import fields
from math import inf, isfinite
from pathlib import Path
from typing import Any, Final

from cmm_align.errors import MalformedInputError
from cmm_align.model import (
    BandRecord,
    BandResponse,
    Dressing,
    Ledger,
    LedgerPass,
    PassOutcome,
    WaveBand,
)

_NESTED: Final = {"bands", "came"}
_COLUMNS: Final = tuple(field.name for field in fields(LedgerPass) if field.name not in _NESTED)

TABLES: Final = """
CREATE TABLE ledger (
    nominal_digest TEXT NOT NULL, machine TEXT NOT NULL, wheel TEXT NOT NULL, created_utc TEXT NOT NULL);
CREATE TABLE band (number INTEGER PRIMARY KEY, short_mm REAL NOT NULL, long_mm REAL);
CREATE TABLE dressing (
    id INTEGER PRIMARY KEY, time_utc TEXT NOT NULL, wheel TEXT NOT NULL, after_pass INTEGER NOT NULL);
CREATE TABLE pass (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    part TEXT NOT NULL, pass_number INTEGER NOT NULL, time_utc TEXT NOT NULL,
    map_digest TEXT NOT NULL UNIQUE, nominal_digest TEXT NOT NULL, correction_digest TEXT NOT NULL,
    previous_map_digest TEXT NOT NULL,
    n INTEGER NOT NULL, pv_um REAL NOT NULL, rms_um REAL NOT NULL,
    map_pv_um REAL NOT NULL, map_rms_um REAL NOT NULL, u_rms_um REAL, pvr_um REAL,
    constant_um REAL, u_constant_um REAL, told_constant_um REAL,
    gain_rule TEXT NOT NULL, gain REAL NOT NULL,
    predicted_rms_um REAL NOT NULL, predicted_rms_low_um REAL NOT NULL, predicted_rms_high_um REAL NOT NULL,
    predicted_pv_um REAL NOT NULL, predicted_pv_low_um REAL NOT NULL, predicted_pv_high_um REAL NOT NULL,
    floor_um REAL NOT NULL,
    came_map_digest TEXT, came_time_utc TEXT, came_rms_um REAL, came_pv_um REAL,
    UNIQUE (part, pass_number));
CREATE TABLE pass_band (
    pass_id INTEGER NOT NULL REFERENCES pass (id) ON DELETE CASCADE, band INTEGER NOT NULL,
    deviation_rms_um REAL NOT NULL, correction_rms_um REAL NOT NULL,
    response_rms_um REAL, transfer REAL, u_transfer REAL,
    PRIMARY KEY (pass_id, band));
"""


def insert_head(base: sqlite3.Connection, ledger: Ledger) -> None:
    """Write the names and bands of a new ledger."""
    base.execute(
        "INSERT INTO ledger VALUES (?, ?, ?, ?)",
        (ledger.nominal_digest, ledger.machine, ledger.wheel, ledger.created_utc),
    )
    base.executemany(
        "INSERT INTO band VALUES (?, ?, ?)",
        [(k, band.short_mm, _plain(band.long_mm)) for k, band in enumerate(ledger.bands)],
    )


def insert_pass(base: sqlite3.Connection, row: LedgerPass) -> None:
    """Add the row of a pass and those of its bands."""
    marks = ", ".join("?" * len(_COLUMNS))
    values = [_plain(getattr(row, name)) for name in _COLUMNS]
    number = base.execute(f"INSERT INTO pass ({', '.join(_COLUMNS)}) VALUES ({marks})", values).lastrowid
    base.executemany(
        "INSERT INTO pass_band (pass_id, band, deviation_rms_um, correction_rms_um) VALUES (?, ?, ?, ?)",
        [(number, k, one.deviation_rms_um, one.correction_rms_um) for k, one in enumerate(row.bands)],
    )


def fill_outcome(base: sqlite3.Connection, previous_map_digest: str, came: PassOutcome) -> None:
    """Note what came of an earlier pass."""
    found = base.execute("SELECT id FROM pass WHERE map_digest = ?", (previous_map_digest,)).fetchone()
    if found is None:
        return
    base.execute(
        "UPDATE pass SET came_map_digest = ?, came_time_utc = ?, came_rms_um = ?, came_pv_um = ? "
        "WHERE id = ?",
        (came.map_digest, came.time_utc, came.rms_um, came.pv_um, found[0]),
    )
    base.executemany(
        "UPDATE pass_band SET response_rms_um = ?, transfer = ?, u_transfer = ? "
        "WHERE pass_id = ? AND band = ?",
        [
            (
                *((None,) * 3 if one is None else (one.response_rms_um, one.transfer, one.u_transfer)),
                found[0],
                k,
            )
            for k, one in enumerate(came.bands)
        ],
    )


def read_all(base: sqlite3.Connection, path: Path) -> Ledger:
    """Return all of a ledger."""
    head = base.execute("SELECT nominal_digest, machine, wheel, created_utc FROM ledger").fetchone()
    if head is None:
        raise MalformedInputError("a ledger without its head", where=str(path))
    bands = tuple(
        WaveBand(float(short), inf if long is None else float(long))
        for short, long in base.execute("SELECT short_mm, long_mm FROM band ORDER BY number")
    )
    in_bands: dict[int, list[tuple[BandRecord, BandResponse | None]]] = {}
    for number, deviation, correction, response, transfer, u in base.execute(
        "SELECT pass_id, deviation_rms_um, correction_rms_um, response_rms_um, transfer, u_transfer "
        "FROM pass_band ORDER BY pass_id, band"
    ):
        answer = None if transfer is None else BandResponse(float(response), float(transfer), float(u))
        in_bands.setdefault(number, []).append((BandRecord(float(deviation), float(correction)), answer))
    rows = base.execute(
        f"SELECT id, came_map_digest, came_time_utc, came_rms_um, came_pv_um, {', '.join(_COLUMNS)} "
        "FROM pass ORDER BY id"
    ).fetchall()
    passes = tuple(_pass(row, in_bands.get(row[0], [])) for row in rows)
    if any(len(one.bands) != len(bands) for one in passes):
        raise MalformedInputError("a pass without its bands", where=str(path))
    dressings = tuple(
        Dressing(str(when), str(wheel), sum(row[0] <= after for row in rows))
        for when, wheel, after in base.execute("SELECT time_utc, wheel, after_pass FROM dressing ORDER BY id")
    )
    nominal, machine, wheel, created = (str(text) for text in head)
    return Ledger(nominal, machine, wheel, created, bands, passes, dressings)


def _pass(row: tuple[Any, ...], in_bands: list[tuple[BandRecord, BandResponse | None]]) -> LedgerPass:
    """Return a pass of the ledger."""
    _, digest, when, rms, pv, *values = row
    answers = tuple(answer for _, answer in in_bands)
    came = None if digest is None else PassOutcome(str(digest), str(when), float(rms), float(pv), answers)
    table = dict(zip(_COLUMNS, values, strict=True))
    for name in ("u_rms_um", "pvr_um"):
        table[name] = float("nan") if table[name] is None else table[name]
    return LedgerPass(**table, bands=tuple(record for record, _ in in_bands), came=came)


def _plain(value: Any) -> Any:
    """Return a value as SQLite takes it: NULL for a number that is not known."""
    return None if isinstance(value, float) and not isfinite(value) else value
