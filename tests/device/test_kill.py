"""Killed at any moment: the journal can be read, and what it holds is what was sent."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from cmm_align.device.address import replay_url
from cmm_align.device.capture import capture_points
from cmm_align.device.journal import read_journal

if TYPE_CHECKING:
    from controller import Controller

LINE_S = 0.0026
"""A line of 30 bytes at 115200 baud."""


def lines() -> Iterator[bytes]:
    number = 0
    while True:
        number += 1
        yield b"%010.4f,%010.4f,%08d\r\n" % (number / 7.0, number / 3.0, number)


class Talker:
    """A controller that never stops, and remembers what it had said at every moment."""

    def __init__(self, controller: Controller) -> None:
        self._descriptor = controller.descriptor
        self._over = threading.Event()
        self.said: list[tuple[float, bytes]] = []
        self._thread = threading.Thread(target=self._talk, daemon=True)

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        self._over.set()
        self._thread.join()

    def _talk(self) -> None:
        os.set_blocking(self._descriptor, False)
        for line in lines():
            if self._over.wait(LINE_S):
                return
            try:
                os.write(self._descriptor, line)
            except BlockingIOError:
                continue  # nobody reads any more
            self.said.append((time.monotonic(), line))

    def until(self, moment_s: float) -> bytes:
        return b"".join(line for said_s, line in self.said if said_s <= moment_s)


def killed(controller: Controller, folder: Path, seconds: float) -> None:
    """Capture, and kill it in the middle; what is older than a second must be there, whole."""
    talker = Talker(controller)
    capture = subprocess.Popen(
        [sys.executable, "-m", "cmm_align", "capture", controller.port, "-o", str(folder / "part.csv")],
        stderr=subprocess.PIPE,
    )
    assert capture.stderr is not None
    assert b"start the dump now" in capture.stderr.readline()
    talker.start()
    time.sleep(seconds)
    dead_s = time.monotonic()
    capture.send_signal(signal.SIGKILL)
    capture.communicate()
    talker.stop()
    journal = read_journal(folder / "part.journal")
    kept = b"".join(record.data for record in journal.records)
    said = b"".join(line for _, line in talker.said)

    assert said.startswith(kept)
    assert kept.startswith(talker.until(dead_s - 1.0))
    assert journal.end is None
    assert not (folder / "part.csv").exists()
    if b"\r" in kept:
        found = capture_points(replay_url(folder / "part.journal"))
        assert len(found.points) == kept.count(b"\r")
        assert not found.complete


@pytest.mark.parametrize("seconds", [0.02, 0.1, 0.3])
def test_a_kill_loses_nothing_that_was_read(controller: Controller, tmp_path: Path, seconds: float) -> None:
    killed(controller, tmp_path, seconds)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(50))
def test_a_kill_at_a_random_moment_loses_less_than_a_second(
    controller: Controller, tmp_path: Path, seed: int
) -> None:
    killed(controller, tmp_path, random.Random(seed).uniform(0.0, 3.0))
