"""A lock beside an output, so that two runs never write the same file.

The lock is a file `<out>.lock` made with O_EXCL; it names the process, its host and its temporary file.
A lock whose process has died on this host is taken over, and what that process left behind is removed.
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import platform
import secrets
import sys
from pathlib import Path
from typing import NamedTuple

from cmm_align.errors import OutputError, OutputLockedError


class Holder(NamedTuple):
    """Who holds a lock."""

    pid: int
    host: str
    temporary: str


def lock_path(target: Path) -> Path:
    """Return the name of the lock of an output."""
    return target.with_name(target.name + ".lock")


def acquire(target: Path, temporary: Path) -> Path:
    """Lock an output and return the lock's path; `release` it in the end.

    Parameters
    ----------
    target : Path
        The output.
    temporary : Path
        The file, in the same folder, that will become the output.

    Raises
    ------
    OutputLockedError
        If a living process, or one on another host, holds the lock.
    OutputError
        If the lock cannot be made.
    """
    lock = lock_path(target)
    text = json.dumps({"pid": os.getpid(), "host": platform.node(), "temporary": temporary.name})
    for _ in range(3):
        try:
            descriptor = os.open(lock, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666)
        except FileExistsError:
            _remove_if_stale(lock, target)
            continue
        except OSError as error:
            raise OutputError(f"cannot write here ({error.strerror})", where=str(target)) from None
        try:
            os.write(descriptor, text.encode())
        except OSError as error:
            os.close(descriptor)
            release(lock)
            raise OutputError(f"cannot write here ({error.strerror})", where=str(target)) from None
        os.close(descriptor)
        return lock
    raise _locked(lock, target, None)


def release(lock: Path) -> None:
    """Remove a lock of ours."""
    with contextlib.suppress(OSError):
        lock.unlink()


def _remove_if_stale(lock: Path, target: Path) -> None:
    holder = _holder(lock)
    if holder is None:
        if lock.exists():
            raise _locked(lock, target, None)
        return  # it went away by itself
    if holder.host != platform.node() or _is_alive(holder.pid):
        raise _locked(lock, target, holder)
    # Another run may see the same stale lock. Renaming is atomic: only one run gets this very file, and
    # whoever finds a fresh lock in its hands puts it back.
    aside = lock.with_name(f".{secrets.token_hex(8)}.lock")
    try:
        lock.rename(aside)
    except OSError:
        return
    if _holder(aside) != holder:
        aside.rename(lock)
        raise _locked(lock, target, None)
    if holder.temporary and Path(holder.temporary).name == holder.temporary:
        release(lock.with_name(holder.temporary))
    release(aside)


def _holder(lock: Path) -> Holder | None:
    try:
        table = json.loads(lock.read_text(encoding="utf-8"))
        return Holder(int(table["pid"]), str(table["host"]), str(table["temporary"]))
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _locked(lock: Path, target: Path, holder: Holder | None) -> OutputLockedError:
    who = f"process {holder.pid} on {holder.host}" if holder else "another process"
    return OutputLockedError(
        f"{who} is writing it", where=str(target), remedy=f"wait, or remove {lock} if that run is dead"
    )


def _is_alive(pid: int) -> bool:
    if pid <= 0:
        return False
    if sys.platform == "win32":
        synchronize, timeout = 0x00100000, 0x00000102
        kernel = ctypes.windll.kernel32
        handle = kernel.OpenProcess(synchronize, False, pid)
        if not handle:
            return False
        waiting: bool = kernel.WaitForSingleObject(handle, 0) == timeout
        kernel.CloseHandle(handle)
        return waiting
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        return True
    return True
