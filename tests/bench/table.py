"""A plain table of what was asked for beside what was measured, and how to run a whole process."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import time
from dataclasses import dataclass


@dataclass(frozen=True)
class Row:
    """One number beside its bar."""

    what: str
    bar: str
    measured: str


def show(title: str, rows: list[Row]) -> None:
    """Print a table that can go into a note as it stands."""
    print(f"\n{title}  ({platform.processor() or platform.machine()}, {os.cpu_count()} cores)\n")
    widths = [
        max(len(getattr(r, k)) for r in [*rows, Row("what", "bar", "measured")]) for k in ("what", "bar")
    ]
    for row in [Row("what", "bar", "measured"), *rows]:
        print(f"  {row.what:<{widths[0]}}  {row.bar:>{widths[1]}}  {row.measured}")


@dataclass(frozen=True)
class ProcessCost:
    """What a whole process took."""

    seconds: float
    peak_mb: float
    processor_s: float = 0.0


def run_process(*arguments: str, repeats: int = 3) -> ProcessCost:
    """Run ``cmm-align ARGUMENTS`` and return the best of some times, and its peak memory."""
    code = (
        "import sys, time, resource, subprocess\n"
        "start = time.perf_counter()\n"
        "subprocess.run([sys.executable, '-m', 'cmm_align', *sys.argv[1:]], check=True)\n"
        "wall = time.perf_counter() - start\n"
        "used = resource.getrusage(resource.RUSAGE_CHILDREN)\n"
        "print('cost', wall, used.ru_maxrss / 1024, used.ru_utime + used.ru_stime)\n"
    )
    costs = []
    for _ in range(repeats):
        done = subprocess.run(
            [sys.executable, "-c", code, *arguments], check=True, capture_output=True, text=True
        )
        costs.append(ProcessCost(*(float(word) for word in done.stdout.strip().splitlines()[-1].split()[1:])))
    return min(costs, key=lambda cost: cost.seconds)


class Stopwatch:
    """Wall and processor time of a block."""

    def __enter__(self) -> Stopwatch:
        self.wall, self.cpu = -time.perf_counter(), -time.process_time()
        return self

    def so_far(self) -> float:
        """Wall time since the block began."""
        return self.wall + time.perf_counter()

    def __exit__(self, *_: object) -> None:
        self.wall += time.perf_counter()
        self.cpu += time.process_time()
