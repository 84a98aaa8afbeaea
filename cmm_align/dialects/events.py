"""What a line of a machine can be: a point, one that should be a point and is none, or none by design."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, NamedTuple, TypeAlias

from cmm_align.dialects.profile import MachineProfile

SERIOUS_SEVERITY: Final = 2
"""From this severity on (I++ DME, 0 to 9), an error of the controller means that the dump is not complete."""

State: TypeAlias = Any
"""What a dialect remembers between two lines: immutable, and nobody's business but its own."""


class Hit(NamedTuple):
    """One point in the machine's own frame: mm, axes as the profile maps them."""

    x_mm: float
    y_mm: float
    z_mm: float
    direction: tuple[float, float, float] | None = None
    """The numbers i, j, k of the line, axes mapped: approach direction or normal, length 0.9 to 1.1."""
    id: int | None = None
    name: str = ""
    sigma_mm: float | None = None


class Rejected(NamedTuple):
    """A line that should be a point, or belongs to one, and is none."""

    line: int
    """From 1."""
    column: int
    """From 1: where in the line the fault is."""
    text: str
    """The line, its unprintable bytes escaped, cut after 80 characters."""
    why: str


class Note(NamedTuple):
    """A line that is no point by design: event, heading, position, end marker, error of the controller."""

    line: int
    text: str
    what: str
    ends: bool = False
    """Whether the machine says with it that the dump is over."""
    severity: int | None = None
    """Of an error of the controller; see `SERIOUS_SEVERITY`."""


Event: TypeAlias = Hit | Rejected | Note


class Dialect(NamedTuple):
    """How one family of machines writes points, as three pure functions."""

    name: str
    begin: Callable[[MachineProfile], State]
    """Give the state before the first line."""
    step: Callable[[State, bytes], tuple[State, tuple[Event, ...]]]
    """Take one whole line without its terminator."""
    end: Callable[[State], tuple[Event, ...]]
    """Say what is missing at the end of the stream; never a point."""
