r"""Bytes to whole lines: CR, LF, CRLF or a mixture, in pieces of any size.

A stated terminator is the safer choice: inside a line of a CRLF machine, a stray CR or LF is a fault that
is seen, while ``any`` would make two lines of it, and each half of a number is a number.
"""

from __future__ import annotations

from typing import Final

LONGEST_LINE: Final = 65_536
"""No dialect has longer lines (I++ DME 1.4.3 states this limit); what lies beyond is garbage."""

_CR_SEEN: Final = b"\r"


def lines_of(pending: bytes, chunk: bytes, terminator: str = "any") -> tuple[tuple[bytes, ...], bytes]:
    r"""Return the whole lines of a stream so far, and what is left for the next call.

    Parameters
    ----------
    pending : bytes
        What the call before left; empty at the start.
    chunk : bytes
        What came since.
    terminator : str
        ``"\r"``, ``"\n"``, ``"\r\n"``, or ``"any"`` of them, mixed as may be.

    Returns
    -------
    lines : tuple of bytes
        Without terminators.
    pending : bytes
        See `unfinished`. Of a line longer than `LONGEST_LINE` only the beginning is kept: long enough
        to be refused when its end comes.

    Examples
    --------
    >>> lines_of(b"1,2", b",3\r\n4,5")
    ((b'1,2,3',), b'4,5')
    """
    if terminator != "any":
        *lines, rest = (pending + chunk).split(terminator.encode("ascii"))
        return tuple(lines), _capped(rest)
    if pending == _CR_SEEN:
        if not chunk:
            return (), pending
        pending, chunk = b"", chunk.removeprefix(b"\n")  # the second half of a CRLF that came in two pieces
    data = pending + chunk
    *lines, rest = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n").split(b"\n")
    return tuple(lines), _CR_SEEN if data.endswith(b"\r") else _capped(rest)


def unfinished(pending: bytes) -> bytes:
    """Return the fragment without terminator in what `lines_of` left: never a point.

    A CR ends a line at once, so that a machine that sends CR alone is not one point behind; `pending` is
    then one CR, as a reminder to skip an LF, and there is no fragment.
    """
    return b"" if pending == _CR_SEEN else pending


def _capped(rest: bytes) -> bytes:
    if len(rest) <= LONGEST_LINE + 1:
        return rest
    return rest[: LONGEST_LINE + 1] + (b"\r" if rest.endswith(b"\r") else b"")
