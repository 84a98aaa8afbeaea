"""What all dialects do with a line: the numbers they accept, and what they say of one that is no point.

Limits of what can be seen. No dump has a checksum. These leave lines that are as good as any: a digit that
became another digit; digits or a minus sign lost or added in front of a number; a whole line that is
missing, or everything from the middle of one line to the same place of a later one; counts, which have no
decimals that could be missing, cut short at the end of a line. Only the number of columns, a fixed form of
the numbers (`decimals` and `signed` of the profile), a numbering of the points, their expected count, and
jumps along the surface can show such faults. What is refused here is everything else: bytes that are no
characters, fields that are no numbers, numbers and columns too many or too few.
"""

from __future__ import annotations

import re
from typing import Final, NamedTuple

from cmm_align.dialects.events import Note, Rejected
from cmm_align.dialects.framing import LONGEST_LINE
from cmm_align.dialects.profile import MachineProfile

BLANKS: Final = b" \t\r\n"
"""Stripped from both ends of a line: some machines begin their lines with an LF."""

PARITY_HINT: Final = 'wrong parity? try bytesize = 7 with parity = "E" or "O"'
BAUD_HINT: Final = "wrong baud rate?"

_SHOWN: Final = 80
_GARBAGE: Final = 0.15
"""Of random bytes, a quarter is no text even without bit 7; of a damaged line, a few bytes are none."""
_PRINTABLE: Final = bytes([9, *range(32, 127)])
_TEXT: Final = bytes([*_PRINTABLE, *range(128, 256)])
_LETTERS: Final = re.compile(rb"[A-Za-z]")
_DIGITS: Final = re.compile(rb"[0-9]")
_AS_FLOAT: Final = bytes.maketrans(b",dD", b".ee")


class Fault(NamedTuple):
    """Why bytes are not what they should be."""

    offset: int
    """From 0, in the bytes that were looked at."""
    why: str


def number_pattern(decimal: str = ".", decimals: int = -1, *, signed: bool = False) -> str:
    """Return the regular expression of one number; it never backtracks and takes no name of a number."""
    point = re.escape(decimal)
    sign = "[+-]" if signed else "[+-]?"
    if decimals == 0:
        return rf"{sign}\d++"
    if decimals > 0:
        return rf"{sign}\d++{point}\d{{{decimals}}}"
    return rf"{sign}(?:\d++(?:{point}\d++)?+|{point}\d++)(?:[eEdD][+-]?\d{{1,3}})?+"


def number_of(text: bytes) -> float:
    """Return the value of a number that matched `number_pattern`, decimal comma or exponent D and all."""
    return float(text.translate(_AS_FLOAT))


def shown(raw: bytes) -> str:
    """Return a line as a person can read it, cut after 80 characters."""
    text = "".join(chr(byte) if byte in _PRINTABLE else f"\\x{byte:02x}" for byte in raw[:_SHOWN])
    return text[:_SHOWN].strip("\t ")


def rejected(line: int, raw: bytes, fault: Fault) -> Rejected:
    """Return the rejection of a line, unreadable bytes being named before anything else.

    Parameters
    ----------
    raw : bytes
        The line as it came.
    fault : Fault
        What is wrong with it if it consists of characters at all; offset from the start of `raw`.
    """
    fault = unreadable(raw) or fault
    return Rejected(line, fault.offset + 1, shown(raw), fault.why)


def unreadable(raw: bytes) -> Fault | None:
    """Return why bytes are no line of text, or None if they are one."""
    if len(raw) > LONGEST_LINE:
        return Fault(LONGEST_LINE, f"longer than {LONGEST_LINE} bytes: {BAUD_HINT}")
    body = raw.strip(b"\r\n")
    odd = body.translate(None, _PRINTABLE)
    if not odd:
        return None
    offset = next(at for at, byte in enumerate(raw) if byte in odd)
    unprintable = body.translate(bytes(byte & 0x7F for byte in range(256))).translate(None, _PRINTABLE)
    if len(unprintable) > _GARBAGE * len(body):
        return Fault(offset, f"much of it is unprintable: {BAUD_HINT}")
    if odd[0] >= 0x80:
        return Fault(offset, f"byte 0x{odd[0]:02X} is no ASCII character: {PARITY_HINT}")
    return Fault(offset, f"byte 0x{odd[0]:02X} is no character of a point")


def passed_over(profile: MachineProfile, text: bytes, line: int, *, before_points: bool) -> Note | None:
    """Return the note for a line that is no point by design, or None.

    End markers, the stated number of heading lines, and words without a digit before the first point.

    Parameters
    ----------
    text : bytes
        The line, stripped of `BLANKS`.
    """
    if profile.end_marker and text == profile.end_marker.encode("ascii"):
        return Note(line, shown(text), "end marker", ends=True)
    if line <= profile.header_lines and not text.translate(None, _TEXT):
        return Note(line, shown(text), "heading")  # unless line ends in it say that a point has run into it
    if before_points and _LETTERS.search(text) and not _DIGITS.search(text) and unreadable(text) is None:
        return Note(line, shown(text), "heading")
    return None
