"""Numbers out of text that machines read, a million lines in a second or two.

Where all numbers of a column have the same decimals, as machines write them, the decimal signs are taken out
and what is left are integers, which are read four times as fast; an integer over a power of ten is the same
float64 as the decimal number (both are rounded once). That every sign stands where it must is looked at
first; anything else goes to NumPy's reader, number by number.
"""

from __future__ import annotations

import io
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from cmm_align.errors import MalformedInputError
from cmm_align.surfaces.protocol import Array

_NEWLINE, _BLANK, _POINT, _ZERO, _NINE = b"\n .09"
_MOST_DIGITS = 15
_BLOCK_BYTES = 1 << 21
_PLAIN = b"0123456789+-. \n"


class Lines:
    """The lines of a text by their places, so that some of them can be blanked out.

    Attributes
    ----------
    raw : bytes
    bytes_ : ndarray of uint8, shape (size,)
    starts, ends : ndarray of int64, shape (n,)
        Of each line; the end is the place of its newline.
    """

    def __init__(self, raw: bytes) -> None:
        self.raw = raw if raw.endswith(b"\n") else raw + b"\n"
        self.bytes_ = np.frombuffer(self.raw, np.uint8)
        self.ends = np.flatnonzero(self.bytes_ == _NEWLINE)
        self.starts = np.concatenate([[0], self.ends[:-1] + 1])

    def start_with(self, text: bytes) -> NDArray[np.bool_]:
        """Return, shape (n,), which lines start so."""
        found: NDArray[np.bool_] = self.ends - self.starts >= len(text)
        last = len(self.bytes_) - 1
        for k, byte in enumerate(text):
            found = found & (self.bytes_[np.minimum(self.starts + k, last)] == byte)
        return found

    def only(self, kept: NDArray[np.bool_]) -> bytes:
        """Return the text with all other lines blank; `kept` has shape (n,)."""
        out = bytearray(self.raw)
        for k in np.flatnonzero(~kept).tolist():
            first, end = int(self.starts[k]), int(self.ends[k])
            out[first:end] = b" " * (end - first)
        return bytes(out)


def table_of(raw: bytes, width: int, where: str, letters: bytes = b"") -> Array:
    """Return the numbers of lines that all look the same; blank lines are passed over.

    Parameters
    ----------
    raw : bytes
    width : int
        Numbers in each line.
    where : str
        Name of the file.
    letters : bytes
        Characters that stand between the numbers besides blanks.

    Returns
    -------
    ndarray, shape (n, width)

    Raises
    ------
    MalformedInputError
        If there is no line, or one has other than `width` numbers.
    """
    between = letters + b"\r"
    blanked = bytes.maketrans(between, b" " * len(between))
    parts = [_part(block.translate(blanked), width, where) for block in _blocks(raw) if block.strip()]
    if not parts:
        raise MalformedInputError("no line of numbers", where=where)
    return np.concatenate(parts)


def _blocks(raw: bytes) -> Iterator[bytes]:
    """Give whole lines that stay in cache."""
    first = 0
    while first < len(raw):
        end = raw.find(b"\n", first + _BLOCK_BYTES) + 1 or len(raw)
        yield raw[first:end]
        first = end


def _part(text: bytes, width: int, where: str) -> Array:
    """Return the numbers of some lines; blanks alone are no line."""
    found = _fixed(text, width)
    if found is None and text.strip():
        try:
            found = np.loadtxt(io.BytesIO(text), dtype=np.float64, ndmin=2, comments=None)
        except ValueError as error:
            raise MalformedInputError(" ".join(str(error).split())[:120], where=where) from None
    if found is None:
        return np.empty((0, width))
    if found.shape[1:] != (width,) or not np.isfinite(found).all():
        raise MalformedInputError(
            f"lines of {found.shape[1]} numbers", where=where, expected=f"{width} numbers in each line"
        )
    return found


def _fixed(text: bytes, width: int) -> Array | None:
    """Return the numbers of a text with fixed decimals; None where NumPy's reader has to decide."""
    first = text.lstrip(b" \n").partition(b"\n")[0].split()
    short = len(first) == width and max(len(word) for word in first) <= _MOST_DIGITS + 2
    decimals = np.array([len(word.partition(b".")[2]) for word in first])
    if not short or text.translate(None, _PLAIN) or not _is_regular(text, decimals):
        return None
    whole = np.fromstring(text.translate(None, b"."), dtype=np.int64, sep=" ").reshape(-1, width)
    return whole / 10.0**decimals if int(np.abs(whole).max()) < 10**_MOST_DIGITS else None


def _is_regular(text: bytes, decimals: NDArray[np.int64]) -> bool:
    """Return whether each line has a number for each entry of `decimals`, with so many decimals."""
    signs = np.frombuffer(text + b"\n", np.uint8)
    inside = (signs != _BLANK) & (signs != _NEWLINE)
    starts = np.flatnonzero(inside & ~np.concatenate([[False], inside[:-1]]))
    digit = (signs >= _ZERO) & (signs <= _NINE)
    points = np.flatnonzero(signs == _POINT)
    after = np.tile(decimals[decimals > 0], len(starts) // len(decimals))
    return (
        len(starts) % len(decimals) == 0
        and len(points) == len(after)
        and _whole_lines(signs, starts, len(decimals))
        # signs stand at the start of numbers only, and before a digit
        and np.count_nonzero(inside & ~digit) - len(points) == np.count_nonzero(~digit[starts])
        and bool(digit[starts + ~digit[starts]].all())
        # each decimal sign is followed by its digits, and by nothing else
        and not inside[np.minimum(points + after + 1, len(signs) - 1)].any()
        and all(bool(digit[points[after > k] + 1 + k].all()) for k in range(int(decimals.max())))
    )


def _whole_lines(signs: NDArray[np.uint8], starts: NDArray[np.intp], width: int) -> bool:
    """Return whether each line that is not blank has `width` numbers."""
    line = np.searchsorted(np.flatnonzero(signs == _NEWLINE), starts).reshape(-1, width)
    return bool((line[:, 0] == line[:, -1]).all() and (line[1:, 0] > line[:-1, 0]).all())
