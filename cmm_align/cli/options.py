"""What the commands' options have in common, defined once."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import click

from cmm_align.cli.chain import CHAIN
from cmm_align.cli.job import Job
from cmm_align.config import read_config
from cmm_align.errors import UnitsError, UsageError
from cmm_align.units import parse_length_mm


class Length(click.ParamType[float]):
    """A length with a unit, handed on in mm; `positive` also refuses zero and less."""

    name = "length"

    def __init__(self, *, positive: bool = True) -> None:
        self.positive = positive

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return the length in mm."""
        if isinstance(value, float):
            return value
        try:
            length_mm = parse_length_mm(str(value))
        except UnitsError as error:
            self.fail(error.one_line(), param, ctx)
        if self.positive and length_mm <= 0.0:
            self.fail(f"{value!r} is not a length above zero", param, ctx)
        return length_mm


FILE = click.Path(path_type=Path)
"""A path; whether it is there and what it holds is found out by the reader, which says it better."""


def output_option(default: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Return the option that names the output, with its default in the help."""
    return click.option(
        "-o",
        "--output",
        type=FILE,
        metavar="FILE",
        help=f"Output file.  [default: {default}, beside the input]",
    )


TIP_RADIUS_HELP = "Effective radius of the tip, not its diameter."


class Grouped(click.Command):
    """A command whose options stand under headings: what is used every day first."""

    def __init__(self, *args: Any, headings: Mapping[str, Sequence[str]], **settings: Any) -> None:
        super().__init__(*args, **settings)
        self.headings = headings

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options under their headings; what none names comes last."""
        records = {
            param.opts[-1]: record
            for param in self.get_params(ctx)
            if isinstance(param, click.Option) and (record := param.get_help_record(ctx)) is not None
        }
        named = {name for names in self.headings.values() for name in names}
        rest = [name for name in records if name not in named]
        for heading, names in (*self.headings.items(), ("Options", rest)):
            with formatter.section(heading):
                formatter.write_dl([records[name] for name in names])


def command(
    name: str, text: str, *, writes: bool = True, headings: Mapping[str, Sequence[str]] | None = None
) -> Callable[[Callable[..., Any]], click.Command]:
    """Return a decorator that makes a command: common options, help text, the chain at its end.

    Parameters
    ----------
    name : str
        As typed.
    text : str
        Help text.
    writes : bool
        Whether it writes files, and so has ``--overwrite``.
    headings : mapping, optional
        Headings of the help, each with its options; the others come last.
    """

    def decorate(callback: Callable[..., Any]) -> click.Command:
        """Wrap the callback so that it gets a `Job` in place of the common options."""

        @functools.wraps(callback)
        def with_job(**values: Any) -> Any:
            """Gather the common options."""
            if values["quiet"] and values["json"]:
                raise UsageError("-q and --json exclude each other", remedy="--json is quiet already")
            job = Job(
                command=name,
                config=read_config(values.pop("config_files")),
                json=values.pop("json"),
                quiet=values.pop("quiet"),
                verbosity=values.pop("verbosity"),
                overwrite=values.pop("overwrite", False),
                units=values.pop("units"),
            )
            return callback(job, **values)

        made: click.Command
        if headings is None:
            made = click.command(name, help=text, epilog=CHAIN)(with_job)
        else:
            made = click.command(name, cls=Grouped, headings=headings, help=text, epilog=CHAIN)(with_job)
        made.params += [  # after the command's own, in the help too
            option for option in _common_options() if writes or option.name != "overwrite"
        ]
        return made

    return decorate


def _common_options() -> list[click.Parameter]:
    """Return the options that every command has."""
    return [
        click.Option(
            ["--units"], type=click.Choice(["mm", "um", "inch"]), help="Unit of an input that states none."
        ),
        click.Option(
            ["--config", "config_files"],
            type=FILE,
            metavar="FILE.toml",
            multiple=True,
            help="Settings; repeatable, later files win, options win over files.",
        ),
        click.Option(["--overwrite"], is_flag=True, help="Replace outputs that exist and are ours."),
        click.Option(["--json"], is_flag=True, help="One JSON object on stdout instead of the report."),
        click.Option(
            ["-q", "--quiet"], is_flag=True, help="No report; warnings, errors and the verdict only."
        ),
        click.Option(["-v", "--verbose", "verbosity"], count=True, help="Say more."),
    ]
