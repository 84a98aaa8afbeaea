"""Who made a file, from what, with which settings.

The only place that reads the clock. `SOURCE_DATE_EPOCH` (seconds since 1970, UTC) replaces it, so that
the same run can give the same bytes. Paths are kept as the user wrote them.
"""

from __future__ import annotations

import hashlib
import os
import threading
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Future
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

from cmm_align import __version__
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


def hashed(paths: Iterable[Path | str]) -> Callable[[], tuple[InputFile, ...]]:
    """Hash files in the background while other work goes on; call what is returned to wait for them.

    Parameters
    ----------
    paths : iterable of path
        Files that were read, as the user named them.

    Notes
    -----
    What goes wrong is raised by that call. A run that fails meanwhile does not wait.
    """
    names, done = tuple(paths), Future[tuple[InputFile, ...]]()

    def work() -> None:
        try:
            done.set_result(_hashed_now(names))
        except BaseException as error:
            done.set_exception(error)

    threading.Thread(target=work, daemon=True).start()
    return done.result


def this_step(
    command: str,
    parameters: Mapping[str, Any],
    inputs: Iterable[Path | str] | Callable[[], tuple[InputFile, ...]] = (),
) -> Step:
    """Return the step that is being taken now: hashes the inputs and reads the clock.

    Parameters
    ----------
    command : str
    parameters : Mapping
        Settings as JSON knows them.
    inputs : iterable of path, or callable
        Files that were read, as the user named them; or what `hashed` returned.

    Raises
    ------
    MissingFileError
        If an input cannot be read.
    UsageError
        If `SOURCE_DATE_EPOCH` is set to something else than a number of seconds.
    """
    files = inputs() if callable(inputs) else _hashed_now(inputs)
    return Step(command, __version__, _now().strftime("%Y-%m-%dT%H:%M:%SZ"), dict(parameters), files)


def _hashed_now(paths: Iterable[Path | str]) -> tuple[InputFile, ...]:
    return tuple(InputFile(str(path), sha256_of_file(path)) for path in paths)


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
