"""The entry point: finds the commands, and turns everything that can go wrong into an exit code.

Command modules are imported when they are called, so that the list of commands costs next to nothing.
"""

from __future__ import annotations

import importlib
import os
import signal
import sys
from pathlib import Path
from types import FrameType
from typing import Final, NoReturn

import click

from cmm_align import __version__
from cmm_align.cli.chain import CHAIN
from cmm_align.errors import CmmAlignError

EXIT_BUG: Final = 1
EXIT_USAGE: Final = 2
EXIT_NUMERICS: Final = 4
EXIT_OUTPUT: Final = 8
EXIT_INTERRUPTED: Final = 130
EXIT_PIPE: Final = 141
EXIT_TERMINATED: Final = 143

COMMANDS: Final = {
    "offset": "Equidistant surface of a nominal, one tip radius out.",
    "align": "Best-fit pose, deviations and contact points.",
    "error-map": "Gridded deviations, statistics, picture and verdict.",
    "compensate": "The surface to grind next, with its exports.",
    "info": "What is in a file, and where it came from.",
    "demo": "The whole loop on built-in data, no machine needed.",
}
"""Short help of each command; kept here so that the list needs none of their modules."""


class Terminated(BaseException):
    """SIGTERM arrived: unwind as for Ctrl-C, so that no half-written file stays."""


class LazyGroup(click.Group):
    """A group whose commands are imported when they are called."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the commands in the order of the chain."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import and return one command, or None if there is no such command."""
        if cmd_name not in COMMANDS:
            return None
        module = importlib.import_module(f"cmm_align.cli.{cmd_name.replace('-', '_')}")
        command: click.Command = module.command
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the list of commands without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


@click.group(
    cls=LazyGroup,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    epilog=CHAIN,
)
@click.version_option(__version__, "--version", message="cmm-align %(version)s")
def cmm_align() -> None:
    """From CMM points to the surface to grind next.

    Four steps, each reading the file of the one before. Lengths take a unit (1.5, 1.5mm, 1500um,
    0.059in; bare means mm). A deviation is positive where there is too much material.
    """


def run() -> NoReturn:
    """Run the command line and leave the process with the exit code of the contract."""
    signal.signal(signal.SIGTERM, _terminate)
    sys.exit(outcome_of(sys.argv[1:]))


def outcome_of(arguments: list[str]) -> int:  # noqa: PLR0911 - one way out for each kind of trouble
    """Run the command line; return its exit code, after at most one line on stderr."""
    try:
        # Not `main()`: that one has its own ideas about Ctrl-C and broken pipes.
        with cmm_align.make_context("cmm-align", list(arguments)) as context:
            code = cmm_align.invoke(context)
        sys.stdout.flush()
    except click.exceptions.Exit as end:
        return end.exit_code
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.format_message(), err=True)
        return EXIT_USAGE
    except click.ClickException as error:
        place = error.ctx.command_path if isinstance(error, click.UsageError) and error.ctx else "cmm-align"
        return _complain(f"{error.format_message().rstrip('.')}; see {place} --help", EXIT_USAGE)
    except CmmAlignError as error:
        return _complain(error.one_line(), error.exit_code)
    except (KeyboardInterrupt, click.Abort):
        return _complain("interrupted", EXIT_INTERRUPTED)
    except Terminated:
        return _complain("terminated", EXIT_TERMINATED)
    except BrokenPipeError:
        # The reader of stdout went away (as `| head` does): say nothing, now or at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_PIPE
    except MemoryError as error:
        return _complain(f"not enough memory ({error or 'no size given'}); use fewer points", EXIT_NUMERICS)
    except Exception:
        return _complain(f"this is a bug of ours, sorry; a report is in {_bug_report(arguments)}", EXIT_BUG)
    return code if isinstance(code, int) else 0


def _terminate(_number: int, _frame: FrameType | None) -> NoReturn:
    """Unwind on SIGTERM."""
    raise Terminated


def _complain(text: str, code: int) -> int:
    """Write one line to stderr and return the exit code."""
    click.echo(f"cmm-align: {' '.join(text.split())}", err=True)
    return code


def _bug_report(arguments: list[str]) -> Path:
    """Write versions, arguments and traceback, and none of the user's data, to the temp folder."""
    import platform
    import tempfile
    from importlib.metadata import PackageNotFoundError, version

    lines = [f"cmm-align {__version__}", f"Python {platform.python_version()} on {platform.platform()}"]
    for package in ("numpy", "scipy", "h5py", "click", "rich", "matplotlib"):
        try:
            lines.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            lines.append(f"{package} is missing")
    # Frames and lines of code only: the text of an exception may quote the user's numbers.
    lines += ["arguments: " + " ".join(arguments), "", _frames(sys.exc_info()[1])]
    handle, name = tempfile.mkstemp(prefix="cmm-align-bug-", suffix=".txt")
    with os.fdopen(handle, "w", encoding="utf-8") as file:
        file.write("\n".join(lines) + "\n")
    return Path(name)


def _frames(error: BaseException | None) -> str:
    """Return the traceback and the kind of an exception, without its message."""
    import traceback

    if error is None:
        return ""
    return "".join(traceback.format_tb(error.__traceback__)) + type(error).__name__
