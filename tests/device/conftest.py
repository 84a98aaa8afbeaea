"""Lines without hardware."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from cmm_align.device.clock import Clock

if TYPE_CHECKING:
    from controller import Controller


@pytest.fixture
def clock() -> Clock:
    """A clock that goes on only when somebody sleeps."""
    time_s = [0.0]

    def sleep(seconds: float) -> None:
        time_s[0] += seconds

    return Clock(lambda: time_s[0], sleep)


@pytest.fixture
def controller() -> Iterator[Controller]:
    """A pseudo terminal whose far end is the test."""
    if sys.platform == "win32":
        pytest.skip("Windows has no pseudo terminals")
    from controller import plugged_in

    with plugged_in() as machine:
        yield machine


@pytest.fixture
def dump() -> bytes:
    """Points of a generic controller, one a line, none like another."""
    return b"".join(b"%.4f,%.4f,%.4f\r\n" % (i / 7.0, -i / 3.0, 10.0 + i / 11.0) for i in range(500))


@pytest.fixture
def dump_file(tmp_path: Path, dump: bytes) -> Path:
    """The same in a file."""
    path = tmp_path / "part.txt"
    path.write_bytes(dump)
    return path
