"""Writing a file whole or not at all.

Temporary file in the same folder -> write -> fsync -> re-open and verify -> rename -> fsync the folder.
An old output stays as it was until the new one is complete; an error leaves nothing behind.
An output that is a symbolic link keeps the link and replaces the file it points to. A file that is not of
the output's kind is somebody else's work and is never replaced.
"""

from __future__ import annotations

import contextlib
import os
import secrets
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Final

from cmm_align.errors import OutputError, OutputExistsError
from cmm_align.io import lock as locks
from cmm_align.io.kinds import refuse_another_kind

_REPLACE_TRIES: Final = 10
_REPLACE_PAUSE_S: Final = 0.05


def check_writable(path: Path | str, overwrite: bool = False, inputs: Iterable[Path | str] = ()) -> Path:
    """Check before computing that an output can be written, and return its real path.

    Parameters
    ----------
    path : path
        The output.
    overwrite : bool
        Whether an existing output may be replaced.
    inputs : iterable of path
        Files that are read; none of them may be the output.

    Raises
    ------
    OutputExistsError
        If the output is there and `overwrite` is False, or it is of another kind than its new content.
    OutputError
        If its folder is missing or not writable, it is a folder, or it is one of the inputs.
    """
    target = Path(os.path.realpath(path))
    where = str(path)
    if target.is_dir():
        raise OutputError("it is a folder", where=where, expected="the name of a file")
    if not target.parent.is_dir():
        raise OutputError(
            f"there is no folder {Path(path).parent}", where=where, remedy="make the folder first"
        )
    if target.exists():
        if not target.is_file():
            raise OutputError("it is not a regular file", where=where)
        for other in inputs:
            if Path(other).exists() and target.samefile(other):
                raise OutputError(f"it is also an input ({other})", where=where, remedy="choose another name")
        if not overwrite:
            raise OutputExistsError("it exists already", where=where, remedy="add --overwrite or another -o")
        refuse_another_kind(target, where)
    if not os.access(target.parent, os.W_OK | os.X_OK):
        raise OutputError(f"the folder {Path(path).parent} is not writable", where=where)
    return target


@contextlib.contextmanager
def atomic_path(
    path: Path | str, overwrite: bool = False, verify: Callable[[Path], None] | None = None
) -> Iterator[Path]:
    """Give a temporary path to write to; it becomes `path` when the block ends without an error.

    Parameters
    ----------
    path : path
        The output.
    overwrite : bool
        Whether an existing output may be replaced.
    verify : callable, optional
        Called with the temporary path before it is renamed; raises if the file is not good.

    Yields
    ------
    Path
        A name in the same folder with the same suffix; no file is there yet.

    Raises
    ------
    OutputExistsError
        If the output is there and `overwrite` is False.
    OutputLockedError
        If another run is writing the same output.
    OutputError
        If writing fails; nothing is left behind, and an old output is as it was.
    """
    target = check_writable(path, overwrite)
    temporary = target.with_name(f".cmm-align-{secrets.token_hex(8)}{target.suffix[:16]}")
    lock = locks.acquire(target, temporary)
    try:
        try:
            yield temporary
            _sync(temporary)
            if verify is not None:
                verify(temporary)
            if not overwrite and target.exists():
                raise OutputExistsError("it appeared meanwhile", where=str(path), remedy="add --overwrite")
            _replace(temporary, target)
            _sync_folder(target.parent)
        except OSError as error:
            reason = error.strerror or " ".join(str(error).split())
            raise OutputError(
                f"cannot write it ({reason})",
                where=str(path),
                remedy="check the space and rights of its folder",
            ) from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink()
        locks.release(lock)


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDWR)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _sync_folder(folder: Path) -> None:
    if sys.platform == "win32":
        return  # a folder cannot be opened there
    with contextlib.suppress(OSError):  # some network drives refuse; the file itself is safe
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def _replace(temporary: Path, target: Path) -> None:
    for attempt in range(_REPLACE_TRIES):
        try:
            temporary.replace(target)
            return
        except PermissionError:
            # On Windows a viewer or virus scanner may hold the old file for a moment.
            if sys.platform != "win32" or attempt == _REPLACE_TRIES - 1:
                raise
            time.sleep(_REPLACE_PAUSE_S)
