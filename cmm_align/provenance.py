"""Who made a file, from what, with which settings.

The only place that reads the clock. `SOURCE_DATE_EPOCH` (seconds since 1970, UTC) replaces it, so that
the same run can give the same bytes. Paths are kept as the user wrote them.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any, Final

from cmm_align.errors import MissingFileError, UsageError

_BLOCK: Final = 1 << 20
_EPOCH_VARIABLE: Final = "SOURCE_DATE_EPOCH"


@dataclass(frozen=True, slots=True)
class InputFile:
    """A file that a step read: its path as the user wrote it and its SHA-256 (hex)."""

    path: str
    sha256: str


@dataclass(frozen=True, slots=True)
class Step:
    """One command in the life of a datum.

    Attributes
    ----------
    command : str
        Name of the subcommand, as ``align``.
    version : str
        Version of cmm-align that ran.
    time_utc : str
        ISO 8601 in whole seconds, as ``2026-01-31T12:00:00Z``.
    parameters : Mapping
        Settings that shaped the result; values as JSON knows them.
    inputs : tuple of InputFile
    """

    command: str
    version: str
    time_utc: str
    parameters: Mapping[str, Any]
    inputs: tuple[InputFile, ...] = ()


@cache
def program_version() -> str:
    """Return the version of the installed cmm-align; ``0`` if it runs without being installed."""
    try:
        return metadata.version("cmm-align")
    except metadata.PackageNotFoundError:
        return "0"


def sha256_of_file(path: Path | str) -> str:
    """Return the SHA-256 of a file as hex digits, read in blocks of 1 MiB.

    Raises
    ------
    MissingFileError
        If the file cannot be read.
    """
    digest = hashlib.sha256()
    try:
        with Path(path).open("rb") as stream:
            while block := stream.read(_BLOCK):
                digest.update(block)
    except OSError as error:
        raise MissingFileError(f"cannot read it ({error.strerror})", where=str(path)) from None
    return digest.hexdigest()


def this_step(command: str, parameters: Mapping[str, Any], inputs: Iterable[Path | str] = ()) -> Step:
    """Return the step that is being taken now: hashes the inputs and reads the clock.

    Parameters
    ----------
    command : str
    parameters : Mapping
        Settings as JSON knows them.
    inputs : iterable of path
        Files that were read, as the user named them.

    Raises
    ------
    MissingFileError
        If an input cannot be read.
    UsageError
        If `SOURCE_DATE_EPOCH` is set to something else than a number of seconds.
    """
    files = tuple(InputFile(str(path), sha256_of_file(path)) for path in inputs)
    return Step(command, program_version(), _now().strftime("%Y-%m-%dT%H:%M:%SZ"), dict(parameters), files)


def _now() -> datetime:
    fixed = os.environ.get(_EPOCH_VARIABLE)
    if not fixed:
        return datetime.now(UTC)
    try:
        return datetime.fromtimestamp(int(fixed), UTC)
    except (ValueError, OverflowError, OSError):
        raise UsageError(
            f"{_EPOCH_VARIABLE} is {fixed!r}", expected="seconds since 1970 as a whole number"
        ) from None
