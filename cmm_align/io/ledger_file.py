"""The ledger of a part family, a machine and a wheel: one SQLite file that several runs may write.

A run that writes holds a lock beside the file (`lock`), which works on a network share and names who holds
it, and makes all its changes in one transaction: they are in the file together or not at all. The journal is
the rolled-back one, not the write-ahead log, whose shared memory must not lie on a share. ``application_id``
tells that a file is ours, ``user_version`` which version of the tables it has. Units are in the names of the
columns; what is not known is NULL.

Source: SQLite, "File locking and concurrency in SQLite version 3", sqlite.org/lockingv3.html, and
"Write-ahead logging", sqlite.org/wal.html.
"""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import fields
from math import inf, isfinite
from pathlib import Path
from typing import Any, Final

from cmm_align.errors import (
    InputError,
    MalformedInputError,
    MissingFileError,
    OutputError,
    OutputLockedError,
    WrongStageError,
)
from cmm_align.io import lock
from cmm_align.model import (
    BandRecord,
    BandResponse,
    Dressing,
    Ledger,
    LedgerPass,
    PassOutcome,
    WaveBand,
)

APPLICATION_ID: Final = 0x434D4C47
VERSION: Final = 1
"""Newest version of the tables; newer ones are refused."""
TIMEOUT_S: Final = 20.0
"""A run waits so long for another one to have written."""

_MAGIC: Final = b"SQLite format 3\0"
_POLL_S: Final = 0.05
_NESTED: Final = {"bands", "came"}
_COLUMNS: Final = tuple(field.name for field in fields(LedgerPass) if field.name not in _NESTED)

_TABLES: Final = """
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


def read_ledger(path: Path | str) -> Ledger:
    """Return what a ledger holds.

    Raises
    ------
    MissingFileError
        If there is no such file.
    MalformedInputError
        If it is no ledger, or damaged.
    InputError
        If a newer version wrote it.
    OutputLockedError
        If another run writes it all the time.
    """
    path = Path(path)
    _check_file(path)
    with closing(_connected(path)) as base, _refusals(path):
        base.execute("BEGIN")
        _check_ours(base, path)
        return _read(base, path)


def create_ledger(path: Path | str, ledger: Ledger) -> None:
    """Make an empty ledger; one that is there already is left as it is.

    Parameters
    ----------
    path : path
    ledger : Ledger
        Its bands and names; passes are added by `adding_pass`.

    Raises
    ------
    OutputError
        If it cannot be written.
    """
    path = Path(path)
    with _locked(path):
        if path.exists() and path.stat().st_size > 0:
            return
        with closing(_connected(path)) as base, _refusals(path):
            base.executescript(
                f"BEGIN IMMEDIATE; {_TABLES} PRAGMA application_id = {APPLICATION_ID}; "
                f"PRAGMA user_version = {VERSION};"
            )
            base.execute(
                "INSERT INTO ledger VALUES (?, ?, ?, ?)",
                (ledger.nominal_digest, ledger.machine, ledger.wheel, ledger.created_utc),
            )
            base.executemany(
                "INSERT INTO band VALUES (?, ?, ?)",
                [
                    (k, b.short_mm, b.long_mm if isfinite(b.long_mm) else None)
                    for k, b in enumerate(ledger.bands)
                ],
            )
            base.commit()


@contextmanager
def adding_pass(
    path: Path | str, row: LedgerPass, came: PassOutcome | None, *, replace: bool = False
) -> Iterator[bool]:
    """Add a pass, and what came of the one before, when the block ends well; else leave the ledger as it was.

    Parameters
    ----------
    path : path
        A ledger that exists.
    row : LedgerPass
    came : PassOutcome or None
        Of the pass with the digest `row.previous_map_digest`; left out where the ledger does not know it.
    replace : bool
        Whether the row may take the place of another one of the same part and pass that was not ground.

    Yields
    ------
    bool
        Whether the ledger changes: the same map with the same correction is in it once only.

    Raises
    ------
    WrongStageError
        If the map is of another nominal, or is in the ledger with a correction that was ground, or the
        part has another map of this pass.
    OutputLockedError
        If another run holds it for longer than `TIMEOUT_S`.
    """
    path = Path(path)
    _check_file(path)
    with _locked(path), closing(_connected(path)) as base:
        with _refusals(path):
            base.execute("BEGIN IMMEDIATE")
            _check_ours(base, path)
            changed = _make_room(base, row, path, replace=replace)
            if changed:
                _insert(base, row)
                if came is not None:
                    _fill(base, row.previous_map_digest, came)
        yield changed  # an error in the block closes the file without a commit
        with _refusals(path):
            base.commit()


def add_dressing(path: Path | str, time_utc: str, wheel: str = "") -> None:
    """Note that the wheel was dressed, or a new one mounted, after the passes so far.

    Raises
    ------
    OutputLockedError
        If another run holds the ledger for longer than `TIMEOUT_S`.
    """
    path = Path(path)
    _check_file(path)
    with _locked(path), closing(_connected(path)) as base, _refusals(path):
        base.execute("BEGIN IMMEDIATE")
        _check_ours(base, path)
        base.execute(
            "INSERT INTO dressing (time_utc, wheel, after_pass) SELECT ?, ?, coalesce(max(id), 0) FROM pass",
            (time_utc, wheel),
        )
        base.commit()


def _make_room(base: sqlite3.Connection, row: LedgerPass, path: Path, *, replace: bool) -> bool:
    """Return whether a pass is to be added; remove the one whose place it takes."""
    found = base.execute(
        "SELECT id, part, pass_number, correction_digest, came_map_digest, map_digest FROM pass "
        "WHERE map_digest = ? OR (part = ? AND pass_number = ?)",
        (row.map_digest, row.part, row.pass_number),
    ).fetchall()
    for number, part, pass_number, correction, came, digest in found:
        same_map = digest == row.map_digest
        if same_map and correction == row.correction_digest and part == row.part:
            return False
        name = f"pass {pass_number} of {part}"
        if came is not None:
            raise WrongStageError(
                f"this map is in the ledger as {name}, which was ground with another correction"
                if same_map
                else f"{name} is in the ledger, with another map, and was ground",
                where=str(path),
                expected="a map that is new",
                remedy="leave --ledger out" if same_map else "give another part with --part",
            )
        if not same_map and not replace:
            raise WrongStageError(
                f"{name} is in the ledger, with another map",
                where=str(path),
                expected="one map for each pass of a part",
                remedy="for another part give its name with --part; for a new measurement of the same one, "
                "--overwrite",
            )
        base.execute("DELETE FROM pass WHERE id = ?", (number,))
    return True


def _insert(base: sqlite3.Connection, row: LedgerPass) -> None:
    """Add the row of a pass and those of its bands."""
    marks = ", ".join("?" * len(_COLUMNS))
    values = [_plain(getattr(row, name)) for name in _COLUMNS]
    number = base.execute(f"INSERT INTO pass ({', '.join(_COLUMNS)}) VALUES ({marks})", values).lastrowid
    base.executemany(
        "INSERT INTO pass_band (pass_id, band, deviation_rms_um, correction_rms_um) VALUES (?, ?, ?, ?)",
        [(number, k, one.deviation_rms_um, one.correction_rms_um) for k, one in enumerate(row.bands)],
    )


def _fill(base: sqlite3.Connection, previous_map_digest: str, came: PassOutcome) -> None:
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


def _read(base: sqlite3.Connection, path: Path) -> Ledger:
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


def _check_file(path: Path) -> None:
    """Refuse what is no SQLite file."""
    try:
        with path.open("rb") as stream:
            head = stream.read(len(_MAGIC))
    except OSError as error:
        raise MissingFileError(
            f"cannot read it ({error.strerror})",
            where=str(path),
            remedy="`compensate MAP --ledger FILE` starts a ledger",
        ) from None
    if head != _MAGIC:
        raise MalformedInputError(
            "is no ledger", where=str(path), expected="what `compensate --ledger` wrote"
        )


def _check_ours(base: sqlite3.Connection, path: Path) -> None:
    """Refuse the database of another program, and one of a newer version."""
    if base.execute("PRAGMA application_id").fetchone()[0] != APPLICATION_ID:
        raise MalformedInputError(
            "is the database of another program",
            where=str(path),
            expected="what `compensate --ledger` wrote",
        )
    version = base.execute("PRAGMA user_version").fetchone()[0]
    if version > VERSION:
        raise InputError(
            f"is a ledger of version {version}",
            where=str(path),
            expected=f"at most {VERSION}",
            remedy="install a newer cmm-align",
        )


def _connected(path: Path) -> sqlite3.Connection:
    """Return a connection whose transactions are begun and ended by hand."""
    with _refusals(path):
        base = sqlite3.connect(path, timeout=TIMEOUT_S, isolation_level=None)
        base.execute("PRAGMA trusted_schema = OFF")
        base.execute("PRAGMA foreign_keys = ON")
        return base


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Hold the lock of a ledger, after waiting for other runs."""
    end = time.monotonic() + TIMEOUT_S
    while True:
        try:
            held = lock.acquire(path, Path())  # no temporary file that a dead run may leave
            break
        except OutputLockedError:
            if time.monotonic() > end:
                raise
            time.sleep(_POLL_S)
    try:
        yield
    finally:
        lock.release(held)


@contextmanager
def _refusals(path: Path) -> Iterator[None]:
    """Tell what SQLite complains of as errors of ours."""
    try:
        yield
    except sqlite3.OperationalError as error:
        text = str(error)
        if "locked" in text or "busy" in text:
            raise OutputLockedError(
                "another program holds it open for writing",
                where=str(path),
                remedy="close that, and try again",
            ) from None
        if "readonly" in text or "unable to open" in text or "full" in text or "I/O" in text:
            raise OutputError(f"cannot write it ({text})", where=str(path)) from None
        raise MalformedInputError(f"is no ledger of ours ({text})", where=str(path)) from None
    except (sqlite3.DatabaseError, TypeError, ValueError) as error:
        raise MalformedInputError(f"is damaged ({error})", where=str(path)) from None
