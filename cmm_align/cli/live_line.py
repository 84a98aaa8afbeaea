"""One line on stderr that moves while points come in: on a terminal only."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from cmm_align.cli.job import Job

if TYPE_CHECKING:
    from cmm_align.device.intake import Progress


@contextmanager
def live_line(job: Job, expect: int | None) -> Iterator[Callable[[Progress], None] | None]:
    """Yield what shows the progress in one line on a terminal, or None where nobody looks."""
    if job.quiet or job.json or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.live import Live
    from rich.text import Text

    with Live(console=Console(stderr=True), transient=True, refresh_per_second=8) as live:
        yield lambda progress: live.update(Text(line_of(progress, expect), no_wrap=True, overflow="ellipsis"))


def line_of(progress: Progress, expect: int | None) -> str:
    """Return a progress as one line: points, rate, last point, time left."""
    of = "" if expect is None else f" of {expect}"
    parts = [f"  {progress.n_points}{of} points", f"{progress.points_per_s:.0f}/s"]
    if progress.n_rejected:
        parts.append(f"{progress.n_rejected} rejected")
    if progress.last is not None:
        x, y, z = progress.last[:3]
        parts.append(f"last {x:.4f} {y:.4f} {z:.4f} mm")
    if progress.idle_left_s is None:
        parts.append("waiting for the first byte")
    else:
        parts.append(f"ends after {progress.idle_left_s:.1f} s of silence")
    return "   ".join(parts)
