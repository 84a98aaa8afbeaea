"""What the serial driver has counted: bytes lost or spoilt before any program could read them.

Linux only, through the ioctl TIOCGICOUNT (tty_ioctl(2), `struct serial_icounter_struct` of linux/serial.h:
cts, dsr, rng, dcd, rx, tx, frame, overrun, parity, brk, buf_overrun); unknown on other platforms, and where
there is no UART behind the port.
"""

from __future__ import annotations

import struct
import sys
from typing import Final, NamedTuple

_TIOCGICOUNT: Final = 0x545D
_COUNTERS: Final = struct.Struct("20i")
_FRAME, _OVERRUN, _PARITY, _BUFFER_OVERRUN = 6, 7, 8, 10


class LineErrors(NamedTuple):
    """Errors of the line.

    Attributes
    ----------
    overrun : int
        Bytes that came before their predecessor was fetched from the UART.
    buffer_overrun : int
        Bytes that found the driver's buffer full.
    parity, framing : int
        Bytes whose parity or stop bit was wrong.
    """

    overrun: int
    buffer_overrun: int
    parity: int
    framing: int

    def since(self, earlier: LineErrors) -> LineErrors:
        """Return what was counted after an earlier reading."""
        return LineErrors(*(now - then for now, then in zip(self, earlier, strict=True)))

    def happened(self) -> bool:
        """Return whether anything went wrong."""
        return any(self)


def line_errors(descriptor: int) -> LineErrors | None:
    """Return the driver's counts of an open port, or None where nobody counts."""
    if sys.platform != "linux":
        return None
    import fcntl

    try:
        raw = fcntl.ioctl(descriptor, _TIOCGICOUNT, bytes(_COUNTERS.size))
    except OSError:
        return None
    counts = _COUNTERS.unpack(raw)
    return LineErrors(counts[_OVERRUN], counts[_BUFFER_OVERRUN], counts[_PARITY], counts[_FRAME])
