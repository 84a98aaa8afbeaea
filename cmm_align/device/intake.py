"""From bytes to points: the half of a capture that thinks, apart from the half that reads.

It sees the clock only through the times at which bytes came, so that the same arrivals give the same
points, however late they are looked at.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Final, NamedTuple, TypeAlias

from cmm_align.device.ending import Arrival, Ended, EndReason
from cmm_align.dialects import DIALECTS, Event, Hit, MachineProfile, Rejected, lines_of, unfinished
from cmm_align.dialects.line import Fault, rejected
from cmm_align.errors import DeviceError

_BLANKS: Final = b" \t\r\n\x00\x1a"
"""What may be left behind the last line without being the beginning of another: ends, padding, ^Z."""
_CUT_OFF: Final = "cut off: the line has no end"
_HEAD_BYTES: Final = 1 << 16


class Progress(NamedTuple):
    """How far a capture is.

    Attributes
    ----------
    time_s : float
        Seconds since the port was opened.
    n_points, n_rejected, n_bytes : int
    points_per_s : float
        On average since the first byte.
    last : Hit or None
        The last point, mm, frame of the machine.
    idle_left_s : float or None
        Seconds of silence that end the capture; None before the first byte.
    """

    time_s: float
    n_points: int
    n_rejected: int
    n_bytes: int
    points_per_s: float
    last: Hit | None
    idle_left_s: float | None


class Intake(NamedTuple):
    """What came.

    Attributes
    ----------
    events : tuple of Event
        In the order of the lines.
    n_points, n_bytes : int
    fragment : bytes
        What stands behind the last whole line; never a point.
    ended : Ended
    time_s : float
        Seconds since the port was opened, at the end.
    head : bytes
        The beginning of the dump, at least 64 KiB of it or all.
    """

    events: tuple[Event, ...]
    n_points: int
    n_bytes: int
    fragment: bytes
    ended: Ended
    time_s: float
    head: bytes = b""


Watcher: TypeAlias = Callable[[Progress], object]


def take_in(
    arrivals: Iterable[Arrival | Ended],
    profile: MachineProfile,
    *,
    expect: int | None = None,
    watch: Watcher | None = None,
) -> Intake:
    """Frame and parse what arrives until it ends.

    Parameters
    ----------
    arrivals : iterable of Arrival or Ended
        Bytes and silences in the order of time; ends with an `Ended`.
    profile : MachineProfile
        Dialect, terminator, and the times that end a capture.
    expect : int, optional
        Number of points after which to stop.
    watch : callable, optional
        Called with the progress after each arrival.

    Raises
    ------
    DeviceError
        If nothing comes within the first time-out.
    """
    parser = _Parser(profile, expect)
    n_bytes = 0
    head = b""
    first_s = last_s = now_s = 0.0
    ended = Ended(EndReason.HANG_UP, "the line ended without a word")
    for item in arrivals:
        if isinstance(item, Ended):
            ended = item
            break
        now_s, data = item
        found: EndReason | None = None
        if data:
            first_s, last_s = (first_s if n_bytes else now_s), now_s
            n_bytes += len(data)
            head += data if len(head) < _HEAD_BYTES else b""
            found = parser.feed(data)
        elif not n_bytes and now_s >= profile.first_data_timeout_s:
            raise _silent(profile)
        elif n_bytes and now_s - last_s >= profile.idle_end_s:
            found = EndReason.IDLE
        if watch is not None:
            rate = parser.n_points / (now_s - first_s) if now_s > first_s else 0.0
            left_s = max(0.0, profile.idle_end_s - (now_s - last_s)) if n_bytes else None
            watch(Progress(now_s, parser.n_points, parser.n_rejected, n_bytes, rate, parser.last, left_s))
        if found is not None:
            ended = Ended(found)
            break
    events, fragment = parser.finish(ended.reason)
    return Intake(events, parser.n_points, n_bytes, fragment, ended, now_s, head)


class _Parser:
    """Lines to events, counted; stops where the dump is over."""

    def __init__(self, profile: MachineProfile, expect: int | None) -> None:
        self._dialect = DIALECTS[profile.dialect]
        self._state = self._dialect.begin(profile)
        self._terminator = profile.terminator
        self._expect = expect
        self._pending = b""
        self._events: list[Event] = []
        self._n_lines = 0
        self.n_points = 0
        self.n_rejected = 0
        self.last: Hit | None = None

    def feed(self, data: bytes) -> EndReason | None:
        """Take bytes; return why they are the last ones, if they are."""
        lines, self._pending = lines_of(self._pending, data, self._terminator)
        for line in lines:
            self._n_lines += 1
            self._state, events = self._dialect.step(self._state, line)
            for event in events:
                end = self._take(event)
                if end is not None:
                    return end
        return None

    def finish(self, reason: EndReason) -> tuple[tuple[Event, ...], bytes]:
        """Return all events, and the fragment that stands behind the last whole line: it is rejected too."""
        if reason is EndReason.COUNT:  # the machine may go on: what it says is none of ours
            return tuple(self._events), b""
        fragment = b"" if reason is EndReason.MARKER else unfinished(self._pending).strip(_BLANKS)
        if fragment:
            self._events.append(rejected(self._n_lines + 1, fragment, Fault(len(fragment), _CUT_OFF)))
        self._events += self._dialect.end(self._state)
        return tuple(self._events), fragment

    def _take(self, event: Event) -> EndReason | None:
        self._events.append(event)
        if isinstance(event, Hit):
            self.n_points += 1
            self.last = event
            return EndReason.COUNT if self.n_points == self._expect else None
        if isinstance(event, Rejected):
            self.n_rejected += 1
            return None
        return EndReason.MARKER if event.ends else None


def _silent(profile: MachineProfile) -> DeviceError:
    bits = f"{profile.bytesize}{profile.parity}{profile.stopbits:g}"
    return DeviceError(
        f"nothing came for {profile.first_data_timeout_s:g} s",
        expected="points",
        remedy=f"did you start the dump? is the cable in, and the right one (crossed or straight)? are "
        f"{profile.baud} baud {bits} those of the controller? does it wait for flow control?",
    )
