"""Ctrl-C as a wish, not as an accident."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from types import FrameType


@contextlib.contextmanager
def on_ctrl_c(act: Callable[[], None]) -> Iterator[None]:
    """Let the first Ctrl-C call `act`; the second one interrupts as ever.

    Outside the main thread, and where somebody else handles Ctrl-C already, nothing is changed.
    """
    ours = threading.current_thread() is threading.main_thread()
    if not ours or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return

    def once(_number: int, _frame: FrameType | None) -> None:
        """Act, and stand back."""
        signal.signal(signal.SIGINT, signal.default_int_handler)
        act()

    signal.signal(signal.SIGINT, once)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
