"""The capture's numbers beside their bars: ``python tests/bench/capture.py [--kills N]``.

The line is a pseudo terminal, so there is no UART that could overrun: what counts is the number of bytes
that wait to be read at any moment, against the 4096 that the buffer of a serial driver holds. Processor
time is that of the reading thread (RUSAGE_THREAD: user and system) against the wall time in which it read,
and for comparison that of the whole process with the parser in it.
"""

from __future__ import annotations

import os
import random
import resource
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from table import Row, Stopwatch, show

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from controller import Controller, plugged_in

from cmm_align.device import reader as readers
from cmm_align.device.address import replay_url
from cmm_align.device.capture import capture_points
from cmm_align.device.clock import Clock
from cmm_align.device.intake import Progress
from cmm_align.device.journal import read_journal
from cmm_align.dialects import MachineProfile

LINE = b"%011.4f,%011.4f,%06d\r\n"
MACHINE = MachineProfile(baud=115200, end_marker="END", first_data_timeout_s=30.0)
BYTES_PER_S = 11_520
COMMAND = (sys.executable, "-m", "cmm_align", "capture")


def lines() -> Iterator[bytes]:
    """Give points without end, none like another."""
    number = 0
    while True:
        number += 1
        yield LINE % (number / 7.0, -number / 3.0, number)


def dump(size: int) -> bytes:
    """Return whole lines of about so many bytes, and the end marker."""
    source, pieces, length = lines(), [], 0
    while length < size:
        pieces.append(next(source))
        length += len(pieces[-1])
    return b"".join(pieces) + b"END\r\n"


def thread_cost(work: Callable[..., object], spent: list[tuple[float, float]]) -> Callable[..., object]:
    """Return what also notes the wall and processor time of the thread that calls it."""

    def measured(*arguments: object) -> object:
        began = time.perf_counter()
        before = resource.getrusage(resource.RUSAGE_THREAD)
        found = work(*arguments)
        after = resource.getrusage(resource.RUSAGE_THREAD)
        processor = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
        spent.append((time.perf_counter() - began, processor))
        return found

    return measured


def full_speed(folder: Path) -> list[Row]:
    """Say five million bytes as fast as they are taken, and replay them."""
    said = dump(5_000_000)
    spent: list[tuple[float, float]] = []
    real, readers.read_out = readers.read_out, thread_cost(readers.read_out, spent)
    with plugged_in() as controller, Stopwatch() as watch:
        found = capture_points(
            controller.port, MACHINE, journal=folder / "full.journal", ready=lambda _: controller.say(said)
        )
    readers.read_out = real
    kept = b"".join(record.data for record in read_journal(folder / "full.journal").records)
    exact = "exact" if kept == said else "NOT EXACT"
    with Stopwatch() as again:
        replayed = capture_points(replay_url(folder / "full.journal"))
    same = replayed.points.points_mm.tobytes() == found.points.points_mm.tobytes()
    wall, processor = spent[0]
    return [
        Row("full speed: bytes", "5 million, exact", f"{len(kept)}, {exact}"),
        Row("  points, rejected", "-", f"{len(found.points)}, {len(found.rejected)}"),
        Row("  reading thread", "< 20 % of a core", f"{100 * processor / wall:.1f} % of {wall:.2f} s"),
        Row(
            "  whole process, parsing too", "-", f"{100 * watch.cpu / watch.wall:.0f} % of {watch.wall:.2f} s"
        ),
        Row("  the journal replayed", "same bits", f"{'same' if same else 'NOT SAME'}, {again.wall:.2f} s"),
    ]


def paced(folder: Path) -> list[Row]:
    """A line at 115200 baud that waits for nobody, and a consumer that stops for 0.3 s now and then."""
    source, sent = lines(), []
    asked: list[float] = []

    def now() -> float:
        asked.append(time.monotonic())  # the first time is that from which the journal counts
        return asked[-1]

    def talk(controller: Controller) -> None:
        began, total = time.monotonic(), 0
        while total < 8 * BYTES_PER_S:
            time.sleep(0.002)
            while total < BYTES_PER_S * (time.monotonic() - began):
                sent.append((time.monotonic(), next(source)))
                total += os.write(controller.descriptor, sent[-1][1])
        sent.append((time.monotonic(), b"END\r\n"))
        os.write(controller.descriptor, sent[-1][1])

    pauses = iter(range(1, 7))
    following = [next(pauses)]

    def pause(progress: Progress) -> None:
        if progress.time_s > following[0]:
            following[0] = next(pauses, 1_000_000)
            time.sleep(0.3)

    with plugged_in() as controller, Stopwatch() as watch:
        found = capture_points(
            controller.port,
            MACHINE,
            journal=folder / "paced.journal",
            ready=lambda _: threading.Thread(target=talk, args=(controller,), daemon=True).start(),
            watch=pause,
            clock=Clock(now, time.sleep),
        )
    records = read_journal(folder / "paced.journal").records
    kept = b"".join(record.data for record in records)
    exact = "exact" if kept == b"".join(line for _, line in sent) else "NOT EXACT"
    waiting = most_waiting(sent, [(asked[0] + record.time_s, record.data) for record in records])
    return [
        Row("115200 baud, six pauses of 0.3 s: bytes", "exact", f"{len(kept)}, {exact}"),
        Row("  most bytes waiting to be read", "< 4096", str(waiting)),
        Row("  points", str(len(sent) - 1), str(len(found.points))),
        Row("  whole process, the writer too", "-", f"{100 * watch.cpu / watch.wall:.0f} % of a core"),
    ]


def most_waiting(sent: list[tuple[float, bytes]], kept: list[tuple[float, bytes]]) -> int:
    """Return the most bytes that were sent and not yet read, at any moment."""
    changes = [(moment, len(data)) for moment, data in sent] + [(moment, -len(data)) for moment, data in kept]
    most = waiting = 0
    for _, change in sorted(changes):
        waiting += change
        most = max(most, waiting)
    return most


def kills(folder: Path, count: int) -> list[Row]:
    """Kill a capture at random moments of its first three seconds."""
    chance = random.Random(5)
    late, unreadable, wrong = [], 0, 0
    for number in range(count):
        with plugged_in() as controller:
            os.set_blocking(controller.descriptor, False)
            capture = subprocess.Popen(
                [*COMMAND, controller.port, "-o", str(folder / f"{number}.csv")],
                stderr=subprocess.PIPE,
            )
            assert capture.stderr is not None
            capture.stderr.readline()
            said: list[tuple[float, bytes]] = []
            source, until = lines(), time.monotonic() + chance.uniform(0.0, 3.0)
            while time.monotonic() < until:
                line = next(source)
                os.write(controller.descriptor, line)
                said.append((time.monotonic(), line))
                time.sleep(len(line) / BYTES_PER_S)
            dead = time.monotonic()
            capture.send_signal(signal.SIGKILL)
            capture.communicate()
        try:
            kept = b"".join(record.data for record in read_journal(folder / f"{number}.journal").records)
        except Exception as error:
            unreadable += 1
            print(error)
            continue
        wrong += not b"".join(line for _, line in said).startswith(kept)
        length = 0
        for moment, line in said:
            length += len(line)
            if length > len(kept):
                late.append(dead - moment)
                break
    return [
        Row(f"{count} kills: unreadable, or not what was said", "0, 0", f"{unreadable}, {wrong}"),
        Row("  oldest byte lost", "<= 1 s", f"{max(late, default=0.0):.3f} s before the kill"),
    ]


def main() -> None:
    """Print the table."""
    count = int(sys.argv[sys.argv.index("--kills") + 1]) if "--kills" in sys.argv else 50
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        rows = full_speed(folder) + paced(folder) + kills(folder, count)
    show("Capture", rows)


if __name__ == "__main__":
    main()
