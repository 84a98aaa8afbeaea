"""How an error reaches the user: one line on stderr and, for scripts that asked for it, one JSON object."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import fields
from typing import NamedTuple

import click

from cmm_align import __version__
from cmm_align.config import Config
from cmm_align.errors import CmmAlignError


class Complaint(NamedTuple):
    """What went wrong, in the four parts of a message."""

    what: str
    where: str = ""
    expected: str = ""
    remedy: str = ""

    def one_line(self) -> str:
        """Return the parts as one line."""
        return CmmAlignError(
            self.what, where=self.where, expected=self.expected, remedy=self.remedy
        ).one_line()


def complaint_of(error: CmmAlignError) -> Complaint:
    """Return an error as a complaint; a setting that its remedy names comes with its section."""
    return Complaint(error.what, error.where, error.expected, _with_section(error.remedy))


def complain(arguments: Sequence[str], complaint: Complaint, code: int) -> int:
    """Write a complaint and return the exit code.

    Parameters
    ----------
    arguments : sequence of str
        The command line, which says whether JSON is wanted and for which command.
    complaint : Complaint
    code : int
        Exit code.
    """
    click.echo(f"cmm-align: {complaint.one_line()}", err=True)
    options = arguments[: arguments.index("--")] if "--" in arguments else arguments
    if "--json" in options:
        document = {
            "command": next((word for word in arguments if not word.startswith("-")), None),
            "version": __version__,
            "error": complaint._asdict(),
            "exit_code": code,
        }
        click.echo(json.dumps(document, indent=2))
    return code


def _with_section(remedy: str) -> str:
    """Return a remedy that names, after a setting, the section of the file it belongs to."""
    for section in fields(Config):
        for setting in fields(section.default):  # type: ignore[arg-type]
            name = setting.name
            if "_" in name and re.search(rf"\b{name}\b", remedy) and "--config" not in remedy:
                table = section.name.replace("_", "-")
                return f"{remedy} (the key {name} of the section [{table}], in a file given with --config)"
    return remedy
