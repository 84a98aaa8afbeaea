"""Faults of a line, dealt out by a seed: what a test does to a recording.

`faulty` is a pure function over chunks: the same seed makes the same faults.
"""

from __future__ import annotations

import random
from collections.abc import Sequence
from typing import Final, NamedTuple

from cmm_align.errors import UsageError


class Chunk(NamedTuple):
    """Bytes that arrive together.

    Attributes
    ----------
    time_s : float
        Seconds since the port was opened.
    data : bytes
    """

    time_s: float
    data: bytes


class Faults(NamedTuple):
    """What goes wrong.

    Attributes
    ----------
    drop : int
        So many bytes are lost, each at a place of its own.
    flip : int
        So many bytes have one bit turned over.
    split : int
        Chunks come in pieces of one to so many bytes; 0 leaves them whole.
    stall : float
        Once, nothing comes for so many seconds.
    disconnect : float
        The line breaks after this share of the bytes; 1 never.
    """

    drop: int = 0
    flip: int = 0
    split: int = 0
    stall: float = 0.0
    disconnect: float = 1.0


NONE: Final = Faults()


def faults_of(text: str, where: str) -> Faults:
    """Return faults written as ``drop:3,flip:1,split:7,stall:2.5,disconnect:0.4``.

    Raises
    ------
    UsageError
        If a fault is unknown, or its number is none or below zero.
    """
    found = NONE
    for item in filter(None, text.split(",")):
        name, _, value = item.partition(":")
        if name not in Faults._fields:
            raise UsageError(
                f"unknown fault {name!r}", where=where, expected=f"one of {', '.join(Faults._fields)}"
            )
        try:
            number = type(getattr(NONE, name))(value)
        except ValueError:
            number = -1
        if not 0 <= number < float("inf"):
            raise UsageError(f"{item!r}", where=where, expected=f"{name}: and a number, as {name}:1")
        found = found._replace(**{name: number})
    return found


def faulty(chunks: Sequence[Chunk], faults: Faults, seed: int) -> tuple[tuple[Chunk, ...], bool]:
    """Return what is left of chunks on a bad line, and whether the line broke.

    Parameters
    ----------
    chunks : sequence of Chunk
        In the order of time.
    faults : Faults
    seed : int
    """
    chance = random.Random(seed)
    length = sum(len(chunk.data) for chunk in chunks)
    dropped = _places(chance, length, faults.drop)
    flipped = {place: 1 << chance.randrange(8) for place in _places(chance, length, faults.flip)}
    broken = faults.disconnect < 1.0
    stop = int(faults.disconnect * length) if broken else length
    stalled = chance.randrange(length) if faults.stall and length else length
    made: list[Chunk] = []
    start = 0
    for time_s, data in chunks:
        late_s = faults.stall if start + len(data) > stalled else 0.0
        kept = bytes(
            byte ^ flipped.get(place, 0)
            for place, byte in enumerate(data[: max(0, stop - start)], start)
            if place not in dropped
        )
        start += len(data)
        made += [Chunk(time_s + late_s, piece) for piece in _pieces(chance, kept, faults.split)]
    return tuple(made), broken


def _places(chance: random.Random, length: int, count: int) -> set[int]:
    return set(chance.sample(range(length), min(count, length)))


def _pieces(chance: random.Random, data: bytes, longest: int) -> list[bytes]:
    """Return bytes cut into pieces of one to `longest` bytes."""
    if not data or longest <= 0:
        return [data] if data else []
    pieces = []
    start = 0
    while start < len(data):
        stop = start + chance.randint(1, longest)
        pieces.append(data[start:stop])
        start = stop
    return pieces
