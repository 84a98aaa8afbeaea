"""`socket://` that keeps every byte from the first to the last.

pySerial's own throws away what came between connecting and the end of `open`, tells only that something
is there and not how much, and drops the bytes in hand where the other side closes.
"""

from __future__ import annotations

import select
import socket
from typing import TYPE_CHECKING, Final

from serial import PortNotOpenError
from serial.urlhandler import protocol_socket

PEEK_BYTES: Final = 1 << 16


class Serial(protocol_socket.Serial):
    """A TCP connection in the place of a port."""

    if TYPE_CHECKING:
        _socket: socket.socket | None

    @property
    def in_waiting(self) -> int:
        """Number of bytes that are there now, counted up to 64 KiB; none too where the other side closed.

        Raises
        ------
        PortNotOpenError
            If it is not open.
        """
        if self._socket is None:
            raise PortNotOpenError
        ready, _, _ = select.select([self._socket], [], [], 0)
        return len(self._socket.recv(PEEK_BYTES, socket.MSG_PEEK)) if ready else 0

    def reset_input_buffer(self) -> None:
        """Keep what is there: whatever a server says after the connection is part of its dump."""
