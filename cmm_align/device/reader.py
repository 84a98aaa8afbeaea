"""The half of a capture that reads: takes what has come, writes it down, hands it on, and nothing else."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator
from queue import SimpleQueue
from typing import TypeAlias

from cmm_align.device.clock import Clock
from cmm_align.device.ending import Arrival, Ended, EndReason
from cmm_align.device.journal import RECEIVED, JournalWriter
from cmm_align.device.link import Link

Item: TypeAlias = Arrival | Ended | BaseException


class Reader:
    """A thread that reads a line into a journal; what it read waits in a queue, however long that takes.

    Parameters
    ----------
    link : Link
        Open.
    journal : JournalWriter or None
        Where every byte goes before anybody looks at it.
    max_bytes : int
        The cap.
    clock : Clock
    """

    def __init__(self, link: Link, journal: JournalWriter | None, max_bytes: int, clock: Clock) -> None:
        self._link = link
        self._journal = journal
        self._max_bytes = max_bytes
        self._clock = clock
        self._queue: SimpleQueue[Item] = SimpleQueue()
        self._enough = threading.Event()
        self._interrupted = threading.Event()
        self._thread = threading.Thread(target=self._run, name="reader", daemon=True)

    def interrupt(self) -> None:
        """Ask for an end as after Ctrl-C: what came up to now is still handed on."""
        self._interrupted.set()

    @contextlib.contextmanager
    def reading(self) -> Iterator[Iterator[Arrival | Ended]]:
        """Read as long as the block lasts; give what arrives, up to the end of the line.

        Raises
        ------
        OutputError
            From the iterator, if the journal cannot be written.
        """
        self._thread.start()
        try:
            yield self._arrivals()
        finally:
            self._enough.set()
            self._thread.join()

    def _arrivals(self) -> Iterator[Arrival | Ended]:
        while True:
            item = self._queue.get()
            if isinstance(item, BaseException):
                raise item
            yield item

    def _run(self) -> None:
        try:
            self._queue.put(read_out(self._link, self._hand_on, self._max_bytes, self._clock, self._is_over))
        except BaseException as error:  # it is raised again in the thread that listens
            self._queue.put(error)

    def _hand_on(self, arrival: Arrival) -> None:
        if self._journal is not None and arrival.data:
            self._journal.append(RECEIVED, arrival.time_s, arrival.data)
        self._queue.put(arrival)

    def _is_over(self) -> Ended | None:
        if self._interrupted.is_set():
            return Ended(EndReason.INTERRUPTED)
        return Ended(EndReason.COUNT) if self._enough.is_set() else None


def read_out(
    link: Link,
    hand_on: Callable[[Arrival], object],
    max_bytes: int,
    clock: Clock,
    is_over: Callable[[], Ended | None],
) -> Ended:
    """Read a line until it ends, and return why it did.

    Parameters
    ----------
    link : Link
    hand_on : callable
        Called with every arrival, silences too.
    max_bytes : int
        The cap.
    clock : Clock
    is_over : callable
        Asked before each read; returns the end if somebody wants it.
    """
    began_s = clock.now()
    n_bytes = 0
    while (ended := is_over()) is None:
        got = link.read()
        if isinstance(got, Ended):
            return got
        data = got[: max_bytes - n_bytes]
        n_bytes += len(data)
        hand_on(Arrival(clock.now() - began_s, data))
        if len(data) < len(got):
            return Ended(EndReason.MAX_BYTES, f"the dump is larger than the cap of {max_bytes} bytes")
    return ended
