"""The ledger of a part family, a machine and a wheel: one SQLite file that several runs may write.

A run that writes holds a lock beside the file (`lock`), which works on a network share and names who holds
it, and makes all its changes in one transaction: they are in the file together or not at all. The journal is
the rolled-back one, not the write-ahead log, whose shared memory must not lie on a share. ``application_id``
tells that a file is ours, ``user_version`` which version of the tables (`ledger_tables`) it has.

Source: SQLite, "File locking and concurrency in SQLite version 3", sqlite.org/lockingv3.html, and
"Write-ahead logging", sqlite.org/wal.html.
"""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Final

from cmm_align.errors import (
    InputError,
    MalformedInputError,
    MissingFileError,
    OutputError,
    OutputLockedError,
    WrongStageError,
)
from cmm_align.io import lock
from cmm_align.io.ledger_tables import TABLES, fill_outcome, insert_head, insert_pass, read_all
from cmm_align.model import Ledger, LedgerPass, PassOutcome

APPLICATION_ID: Final = 0x434D4C47
VERSION: Final = 1
"""Newest version of the tables; newer ones are refused."""
MAGIC: Final = b"SQLite format 3\0"
"""First bytes of the file."""
TIMEOUT_S: Final = 20.0
"""A run waits so long for another one to have written."""

_POLL_S: Final = 0.05


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
        return read_all(base, path)


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
        _begun(path, ledger)


@contextmanager
def adding_pass(
    path: Path | str,
    row: LedgerPass,
    came: PassOutcome | None,
    *,
    replace: bool = False,
    new: Ledger | None = None,
) -> Iterator[bool]:
    """Add a pass, and what came of the one before, when the block ends well; else leave the ledger as it was.

    Parameters
    ----------
    path : path
        A ledger that exists, unless `new` is given.
    row : LedgerPass
    came : PassOutcome or None
        Of the pass with the digest `row.previous_map_digest`; left out where the ledger does not know it.
    replace : bool
        Whether the row may take the place of another one of the same part and pass that was not ground.
    new : Ledger, optional
        What to begin the file with where there is none; it goes again if the block fails.

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
    with _locked(path), _begun_for(path, new), closing(_connected(path)) as base:
        with _refusals(path):
            base.execute("BEGIN IMMEDIATE")
            _check_ours(base, path)
            changed = _make_room(base, row, path, replace=replace)
            if changed:
                insert_pass(base, row)
                if came is not None:
                    fill_outcome(base, row.previous_map_digest, came)
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


def _begun(path: Path, ledger: Ledger) -> bool:
    """Make an empty ledger where there is none, in a lock that is held; return whether it did."""
    if path.exists() and path.stat().st_size > 0:
        return False
    with closing(_connected(path)) as base, _refusals(path):
        base.executescript(
            f"BEGIN IMMEDIATE; {TABLES} PRAGMA application_id = {APPLICATION_ID}; "
            f"PRAGMA user_version = {VERSION};"
        )
        insert_head(base, ledger)
        base.commit()
    return True


@contextmanager
def _begun_for(path: Path, new: Ledger | None) -> Iterator[None]:
    """Have a ledger for the block; one that was made for it goes again if the block fails."""
    made = new is not None and _begun(path, new)
    _check_file(path)
    try:
        yield
    except BaseException:
        if made:
            path.unlink(missing_ok=True)
        raise


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


def _check_file(path: Path) -> None:
    """Refuse what is no SQLite file."""
    try:
        with path.open("rb") as stream:
            head = stream.read(len(MAGIC))
    except OSError as error:
        raise MissingFileError(
            f"cannot read it ({error.strerror})",
            where=str(path),
            remedy="`compensate MAP --ledger FILE` starts a ledger",
        ) from None
    if head != MAGIC:
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
