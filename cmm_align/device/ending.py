"""Why a capture ended."""

from __future__ import annotations

from enum import StrEnum
from typing import Final, NamedTuple


class EndReason(StrEnum):
    """Why a capture ended; the words stand in journals and in JSON."""

    MARKER = "marker"
    """The machine said that this was all."""
    COUNT = "count"
    """As many points as expected are there."""
    IDLE = "idle"
    """Nothing more came for the time that the profile gives."""
    CLOSED = "closed"
    """The other side of a network connection closed it."""
    END_OF_FILE = "end_of_file"
    """A recording is at its end."""
    INTERRUPTED = "interrupted"
    """Somebody pressed Ctrl-C."""
    HANG_UP = "hang_up"
    """The line broke, or another program reads the same port."""
    MAX_BYTES = "max_bytes"
    """More came than the cap allows."""
    CUT_OFF = "cut_off"
    """A journal breaks off: the run that wrote it was killed, or is not over."""


ORDERLY: Final = frozenset(
    {EndReason.MARKER, EndReason.COUNT, EndReason.IDLE, EndReason.CLOSED, EndReason.END_OF_FILE}
)
"""Ends after which everything may be there."""


class Ended(NamedTuple):
    """The end of what a line says.

    Attributes
    ----------
    reason : EndReason
    detail : str
        For people; may be empty.
    """

    reason: EndReason
    detail: str = ""


class Arrival(NamedTuple):
    """What a line said, and when; silence is told too, for it is what ends most dumps.

    Attributes
    ----------
    time_s : float
        Seconds since the port was opened.
    data : bytes
        Empty where the line was silent up to then.
    """

    time_s: float
    data: bytes
