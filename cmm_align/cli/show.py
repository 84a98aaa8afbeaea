"""The one place that writes to the terminal: a report for people, or one JSON object for scripts."""

from __future__ import annotations

import json
import re
import shutil
import sys
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final, TextIO

import click

from cmm_align.cli.job import Job, Outcome

if TYPE_CHECKING:
    from rich.console import Console

_WIDTH_ELSEWHERE: Final = 100
"""Columns of the report where there is no terminal to ask."""
_WIDEST: Final = 110
"""A line longer than this is hard to read, however wide the terminal."""
_NARROWEST: Final = 60
_INDENT: Final = "  "
_GAP: Final = "   "
_MOST_OUTPUTS: Final = 4

_STYLES: Final = {
    "PASS": "bold white on green",
    "FAIL": "bold white on red",
    "UNDECIDED": "bold black on yellow",
}
"""Of the verdict."""

_UM = re.compile(r"(?<=\d )u(?=m\b|rad\b)")
"""The u of um and urad after a number."""


def finish(job: Job, outcome: Outcome) -> int:
    """Show an outcome the way the job wants it and return the exit code."""
    if job.json:
        from cmm_align.cli.results import document

        click.echo(json.dumps(document(outcome), indent=2, allow_nan=False))
        return outcome.exit_code
    for text in outcome.warnings:
        line = for_terminal(" ".join(text.split()), sys.stderr)
        click.echo(click.style("warning: ", fg="yellow") + line, err=True)
    if not job.quiet:
        report(outcome, verbose=job.verbosity > 0)
    elif outcome.verdict:
        click.echo(f"{outcome.verdict}: {'; '.join(outcome.reasons)}")
    return outcome.exit_code


def for_terminal(text: str, stream: TextIO) -> str:
    """Return a text with the micro sign in place of u, where a terminal reads it and can show it."""
    if not stream.isatty():
        return text
    try:
        "\N{MICRO SIGN}".encode(stream.encoding or "ascii")
    except (UnicodeEncodeError, LookupError):
        return text
    return _UM.sub("\N{MICRO SIGN}", text)


def report(outcome: Outcome, *, verbose: bool = False) -> None:
    """Write the report of one screen to stdout; coloured on a terminal only.

    Parameters
    ----------
    outcome : Outcome
    verbose : bool
        Whether to write its details too.
    """
    from rich.console import Console
    from rich.text import Text

    rows = [*outcome.rows, *(outcome.details if verbose else ())]
    tail = [
        *_outputs(outcome),
        *([("then" if outcome.next_command else "next", outcome.advice)] if outcome.advice else []),
        *([("next", outcome.next_command)] if outcome.next_command else []),
    ]
    width = max(len(label) for label, _ in [*rows, *tail, ("", "")])
    room = _columns() - len(_INDENT) - width - len(_GAP)
    console = Console(highlight=False, soft_wrap=True)
    if sys.stdout.isatty():
        console.print()
    if outcome.verdict:
        _print_verdict(console, outcome)
    heading = Text(_INDENT).append(outcome.command, style="bold cyan")
    if outcome.inputs:
        heading.append(_GAP + "  ".join(item.path for item in outcome.inputs))
    console.print(heading, Text(), sep="\n")
    for label, value in rows:
        console.print(_row(label, for_terminal(value, sys.stdout), width, room, ""))
    if tail:
        console.print()
    for label, value in tail:
        # Only prose is wrapped: the rest is there to be copied.
        fold = room if value == outcome.advice else len(value) + 1
        style = {"next": "bold", "then": ""}.get(label, "green")
        console.print(_row(label, value, width, fold, style))


def _print_verdict(console: Console, outcome: Outcome) -> None:
    """Write the verdict large, with what was judged beside it."""
    from rich.text import Text

    style = _STYLES[outcome.verdict]
    reasons = [for_terminal(text, sys.stdout) for text in outcome.reasons]
    if not sys.stdout.isatty():
        lead = f"{_INDENT}{outcome.verdict}{_GAP}"
        console.print(lead + f"\n{' ' * len(lead)}".join(reasons or [""]).rstrip(), "", sep="\n")
        return
    word = f"    {outcome.verdict}    "
    blank = " " * len(word)
    for number in range(max(3, len(reasons) + 2)):
        block = word if number == 1 else blank
        beside = reasons[number - 1] if 0 < number <= len(reasons) else ""
        line = Text(_INDENT).append(block, style=style)
        console.print(line.append(_GAP + beside, style="bold") if beside else line)
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
