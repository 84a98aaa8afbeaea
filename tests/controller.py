"""A controller without hardware: the far end of a pseudo terminal (no Windows)."""

from __future__ import annotations

import os
import threading
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass


@dataclass
class Controller:
    """The machine's end of a line."""

    descriptor: int
    port: str

    def say(self, data: bytes) -> threading.Thread:
        """Write everything from a thread, as fast as it is read; a line that is gone ends it."""

        def write() -> None:
            view = memoryview(data)
            try:
                while view:
                    view = view[os.write(self.descriptor, view) :]
            except OSError:
                return

        thread = threading.Thread(target=write, daemon=True)
        thread.start()
        return thread

    def hang_up(self) -> None:
        """Pull the plug."""
        if self.descriptor >= 0:
            os.close(self.descriptor)
            self.descriptor = -1


@contextmanager
def plugged_in() -> Iterator[Controller]:
    """Give a controller on a pseudo terminal, in raw mode."""
    master, slave = os.openpty()
    tty.setraw(slave)
    machine = Controller(master, os.ttyname(slave))
    try:
        yield machine
    finally:
        machine.hang_up()
        os.close(slave)
