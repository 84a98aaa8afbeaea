"""A file for HDF5 to write to that never fails: it keeps what went wrong until HDF5 is done.

HDF5 crashes the process when writing fails, as on a full disk (h5py issue 914), or when Python raises while
HDF5 waits for it. Told that all went well, it closes in peace, and the error can be raised then.
"""

from __future__ import annotations

import contextlib
import io
import signal
import threading
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Any, TypeVar

T = TypeVar("T")


@contextlib.contextmanager
def uninterrupted() -> Iterator[None]:
    """Put Ctrl-C and SIGTERM off to the end of the block; signals that nobody handles are left alone."""
    if threading.current_thread() is not threading.main_thread():
        yield  # signals are handled in the main thread
        return
    arrived: list[int] = []

    def note(number: int, _frame: FrameType | None) -> None:
        arrived.append(number)

    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    caught = {number: handler for number, handler in handlers.items() if callable(handler)}
    try:
        for number in caught:
            signal.signal(number, note)
        yield
    finally:
        for number, handler in caught.items():
            signal.signal(number, handler)
        if arrived:
            signal.raise_signal(arrived[0])


class PatientFile(io.RawIOBase):
    """A new file, open for writing and reading.

    Attributes
    ----------
    error : OSError or None
        The first one; nothing is written after it.
    """

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.error: OSError | None = None
        self._file = path.open("x+b", buffering=0)

    def readable(self) -> bool:
        """Return True."""
        return True

    def writable(self) -> bool:
        """Return True."""
        return True

    def seekable(self) -> bool:
        """Return True."""
        return True

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        """Move, and return the new place."""
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        """Return the place."""
        return self._file.tell()

    def readinto(self, buffer: Any) -> int:
        """Fill a buffer, and return how much was read."""
        return self._patiently(lambda: self._file.readinto(buffer) or 0, 0)

    def write(self, data: Any) -> int:
        """Write all of the data; return their length."""
        view = memoryview(data)
        left = view
        while left and self.error is None:  # the system may take a part of it
            left = left[self._patiently(partial(self._file.write, left), 0) :]
        return len(view)

    def truncate(self, size: int | None = None) -> int:
        """Cut or lengthen the file, and return its size."""
        return self._patiently(lambda: self._file.truncate(size), size or 0)

    def close(self) -> None:
        """Close the file."""
        try:
            self._file.close()
        except OSError as error:
            self.error = self.error or error
        super().close()

    def _patiently(self, work: Callable[[], T], otherwise: T) -> T:
        """Do something unless something went wrong before."""
        if self.error is None:
            try:
                return work()
            except OSError as error:
                self.error = error
        return otherwise
