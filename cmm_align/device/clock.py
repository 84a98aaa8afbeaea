"""The clock of a capture, handed in so that a test can turn it by hand."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final, NamedTuple


class Clock(NamedTuple):
    """Something that tells the time and lets it pass.

    Attributes
    ----------
    now : callable
        Seconds since some fixed moment; never goes back.
    sleep : callable
        Lets so many seconds pass.
    """

    now: Callable[[], float]
    sleep: Callable[[float], object]


REAL: Final = Clock(time.monotonic, time.sleep)
"""The clock of the computer."""
