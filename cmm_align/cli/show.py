"""The one place that writes to the terminal: a report for people, or one JSON object for scripts."""

from __future__ import annotations

import json
import shutil
import sys
import textwrap
from collections.abc import Sequence
from typing import Final

import click

from cmm_align.cli.job import Job, Outcome

_WIDTH_ELSEWHERE: Final = 100
"""Columns of the report where there is no terminal to ask."""
_WIDEST: Final = 110
"""A line longer than this is hard to read, however wide the terminal."""
_NARROWEST: Final = 60
_INDENT: Final = "  "
_GAP: Final = "   "
_MOST_OUTPUTS: Final = 4

_STYLES: Final = {"PASS": "bold green", "FAIL": "bold red", "UNDECIDED": "bold yellow"}
"""Of a value that begins with the word."""


def finish(job: Job, outcome: Outcome) -> int:
    """Show an outcome the way the job wants it and return the exit code."""
    if job.json:
        from cmm_align.cli.results import document

        click.echo(json.dumps(document(outcome), indent=2, allow_nan=False))
        return outcome.exit_code
    for text in outcome.warnings:
        click.echo(click.style("warning: ", fg="yellow") + " ".join(text.split()), err=True)
    if not job.quiet:
        report(outcome)
    return outcome.exit_code


def report(outcome: Outcome) -> None:
    """Write the report of one screen to stdout; coloured on a terminal only."""
    from rich.console import Console
    from rich.text import Text

    tail = [*_outputs(outcome), *([("next", outcome.next_command)] if outcome.next_command else [])]
    width = max(len(label) for label, _ in [*outcome.rows, *tail])
    room = _columns() - len(_INDENT) - width - len(_GAP)
    console = Console(highlight=False, soft_wrap=True)
    heading = Text(_INDENT).append(outcome.command, style="bold cyan")
    console.print(
        Text(), heading.append(_GAP + "  ".join(item.path for item in outcome.inputs)), Text(), sep="\n"
    )
    for label, value in outcome.rows:
        style = next((style for word, style in _STYLES.items() if value.startswith(word)), "")
        console.print(_row(label, value, width, room, style))
    console.print()
    for label, value in tail:
        # Not wrapped: these are there to be copied.
        console.print(_row(label, value, width, len(value) + 1, "bold" if label == "next" else "green"))
    if tail:
        console.print()


def _row(label: str, value: str, width: int, room: int, style: str) -> object:
    """Return a label and its value, wrapped under itself."""
    from rich.text import Text

    lines = textwrap.wrap(value, room, break_long_words=False, break_on_hyphens=False) or [""]
    row = Text(_INDENT).append(label.ljust(width), style="dim").append(_GAP)
    return row.append(f"\n{' ' * (len(_INDENT) + width + len(_GAP))}".join(lines), style=style)


def _outputs(outcome: Outcome) -> Sequence[tuple[str, str]]:
    """Return the rows that name what was written."""
    paths = [str(path) for path in outcome.outputs]
    if len(paths) > _MOST_OUTPUTS:
        paths = [*paths[: _MOST_OUTPUTS - 1], f"and {len(paths) - _MOST_OUTPUTS + 1} more beside it"]
    return [("" if number else "wrote", path) for number, path in enumerate(paths)]


def _columns() -> int:
    """Return how many columns a line may take."""
    wide = shutil.get_terminal_size().columns if sys.stdout.isatty() else _WIDTH_ELSEWHERE
    return max(min(wide, _WIDEST), _NARROWEST)
