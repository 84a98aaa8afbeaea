"""A progress bar on stderr: on a terminal only, and only for what takes more than a second."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Final

from cmm_align.cli.job import Job

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

PATIENCE_S: Final = 1.0


@contextmanager
def progress_bar(job: Job) -> Iterator[Callable[[str, float], None] | None]:
    """Yield what a stage calls with a word and the share done, or None where nobody looks."""
    if job.quiet or job.json or not sys.stderr.isatty():
        yield None
        return
    started = time.monotonic()
    with ExitStack() as stack:
        shown: list[tuple[Progress, TaskID]] = []

        def tell(word: str, share: float) -> None:
            """Move the bar, which appears when the second is over."""
            if not shown:
                if time.monotonic() - started < PATIENCE_S:
                    return
                bar = stack.enter_context(_bar())
                shown.append((bar, bar.add_task(word, total=1.0)))
            bar, task = shown[0]
            bar.update(task, description=word, completed=share)

        yield tell


def _bar() -> Progress:
    """Return a bar that vanishes when it is done."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    return Progress(
        TextColumn("  {task.description}"),
        BarColumn(bar_width=40),
        TimeElapsedColumn(),
        console=Console(stderr=True),
        transient=True,
    )
