"""The entry point: finds the commands, and turns everything that can go wrong into an exit code.

Command modules are imported when they are called, so that the list of commands costs next to nothing.
"""

from __future__ import annotations

import difflib
import importlib
import io
import os
import signal
import sys
from pathlib import Path
from types import FrameType
from typing import Final, NoReturn

import click

from cmm_align import __version__
from cmm_align.cli.chain import CHAIN
from cmm_align.cli.complaint import Complaint, complain, complaint_of
from cmm_align.errors import CmmAlignError

EXIT_BUG: Final = 1
EXIT_USAGE: Final = 2
EXIT_NUMERICS: Final = 4
EXIT_INTERRUPTED: Final = 130
EXIT_PIPE: Final = 141
EXIT_TERMINATED: Final = 143

COMMANDS: Final = {
    "offset": "Equidistant surface of a nominal, one tip radius out.",
    "align": "Best-fit pose, deviations and contact points.",
    "error-map": "Gridded deviations, statistics, picture and verdict.",
    "compensate": "The surface to grind next, with its exports.",
    "history": "What a ledger of passes tells: predicted and come, learned transfer, wear.",
    "capture": "Points from the controller's port, or from a recording of one.",
    "info": "What is in a file, and where it came from.",
    "selftest": "Proof on this machine: known answers, and how near the software comes to them.",
    "demo": "The whole loop on built-in data, no machine needed.",
}
"""Short help of each command; kept here so that the list needs none of their modules."""

EXIT_CODES: Final = """\b
Exit codes, for scripts:
  0 good            3 input                           6 undecided: too near a limit
  1 a bug of ours   4 no fit, or not converged        7 port or device
  2 usage           5 out of tolerance, or held back  8 an output cannot be written
"""


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

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command; refuse an unknown one and name the nearest."""
        if args and args[0] not in COMMANDS and not args[0].startswith("-"):
            near = difflib.get_close_matches(args[0], COMMANDS, n=1, cutoff=0.5)
            hint = f"did you mean {near[0]}?" if near else f"known are {', '.join(COMMANDS)}"
            ctx.fail(f"no such command {args[0]!r}; {hint}")
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the list of commands without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


@click.group(
    cls=LazyGroup,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    epilog=f"{EXIT_CODES}\n{CHAIN}",
)
@click.version_option(__version__, "--version", message="cmm-align %(version)s")
def cmm_align() -> None:
    """From CMM points to the surface to grind next.

    Four steps, each reading the file of the one before. Lengths take a unit (1.5, 1.5mm, 1500um,
    0.059in; bare means mm). A deviation is positive where there is too much material.
    """


def run() -> NoReturn:
    """Run the command line and leave the process with the exit code of the contract."""
    # Our own threads share the cores already; threads of the matrix library would only wait for them.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    signal.signal(signal.SIGTERM, _terminate)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a sign that cannot be shown is no reason to stop
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
        text = Complaint(error.format_message().rstrip("."), remedy=f"see {place} --help")
        return complain(arguments, text, EXIT_USAGE)
    except CmmAlignError as error:
        return complain(arguments, complaint_of(error), error.exit_code)
    except (KeyboardInterrupt, click.Abort):
        return complain(arguments, Complaint("interrupted"), EXIT_INTERRUPTED)
    except Terminated:
        return complain(arguments, Complaint("terminated"), EXIT_TERMINATED)
    except BrokenPipeError:
        # The reader of stdout went away (as `| head` does): say nothing, now or at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_PIPE
    except MemoryError as error:
        text = Complaint(f"not enough memory ({error or 'no size given'})", remedy="use fewer points")
        return complain(arguments, text, EXIT_NUMERICS)
    except Exception:
        text = Complaint(f"this is a bug of ours, sorry; a report is in {_bug_report(arguments)}")
        return complain(arguments, text, EXIT_BUG)
    return code if isinstance(code, int) else 0


def _terminate(_number: int, _frame: FrameType | None) -> NoReturn:
    """Unwind on SIGTERM."""
    raise Terminated


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
    with os.fdopen(handle, "w", encoding="utf-8", errors="backslashreplace") as file:
        file.write("\n".join(lines) + "\n")
    return Path(name)


def _frames(error: BaseException | None) -> str:
    """Return the traceback and the kind of an exception, without its message."""
    import traceback

    if error is None:
        return ""
    return "".join(traceback.format_tb(error.__traceback__)) + type(error).__name__
