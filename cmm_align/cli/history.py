"""`cmm-align history`: what the passes of a ledger tell, pass by pass."""

from __future__ import annotations

import difflib
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from cmm_align.cli import options
from cmm_align.cli.job import Job, Outcome
from cmm_align.cli.options import FILE
from cmm_align.errors import InputError, OutputError, UsageError

if TYPE_CHECKING:
    from cmm_align.model import LearnedTransfer, Ledger, LedgerPass, WheelWear

MOST_ROWS: Final = 16
"""Passes that are shown, the latest; all of them with -v."""

TEXT = """The passes in LEDGER: what they were told, what was predicted, what came, what was learned.

`compensate --ledger FILE` adds passes, learns the transfer of the machine for each spatial band from them,
and divides the next gain by it. Deviations are those of single points, in um. After the wheel was dressed
say so once with --dressed (or --wheel NAME for a new one), when the last part ground before is in the
ledger.
"""


@options.command("history", TEXT)
@click.argument("ledger_file", type=FILE, metavar="LEDGER")
@click.option("--part", metavar="ID", help="Only passes of this part; what was learned is of all.")
@click.option("--dressed", is_flag=True, help="Note that the wheel was dressed now.")
@click.option("--wheel", metavar="NAME", help="Note that a new wheel was mounted now.")
@click.option("--plot", type=FILE, metavar="FILE.png", help="Picture of the convergence; .svg too.")
@click.option("--csv", "table", type=FILE, metavar="FILE.csv", help="All passes as a table.")
def command(
    job: Job,
    *,
    ledger_file: Path,
    part: str | None,
    dressed: bool,
    wheel: str | None,
    plot: Path | None,
    table: Path | None,
) -> int:
    """Parse, call, show."""
    from cmm_align.cli.show import finish

    return finish(
        job, look_back(job, ledger_file, part=part, dressed=dressed, wheel=wheel, plot=plot, table=table)
    )


def look_back(
    job: Job,
    ledger_file: Path,
    *,
    part: str | None = None,
    dressed: bool = False,
    wheel: str | None = None,
    plot: Path | None = None,
    table: Path | None = None,
) -> Outcome:
    """Read a ledger and tell what is in it.

    Parameters
    ----------
    job : Job
    ledger_file : Path
        What `compensate --ledger` wrote.
    part : str, optional
        Show passes of this part only.
    dressed : bool
        Note a dressing first.
    wheel : str, optional
        Note a new wheel of this name first.
    plot, table : Path, optional
        Picture and table to write.

    Raises
    ------
    InputError
        If it is no ledger, or there is nothing to draw.
    UsageError
        If the ledger knows no such part.
    """
    from cmm_align.cli.drawing import try_one
    from cmm_align.cli.record import check_outputs
    from cmm_align.io.atomic import atomic_path
    from cmm_align.io.ledger_file import add_dressing, read_ledger
    from cmm_align.provenance import InputFile, sha256_of_file, this_step
    from cmm_align.report.ledger_summary import details_of_ledger, of_ledger, table_of_ledger
    from cmm_align.stages.learned_transfer import learned_transfer
    from cmm_align.stages.wheel_wear import wheel_wear

    ledger = read_ledger(ledger_file)
    shown = _of_part(ledger, part)
    if plot is not None and not shown:
        raise InputError("no pass to draw", where=str(ledger_file), remedy="add one with compensate --ledger")
    wanted = [path for path in (plot, table) if path is not None]
    if wanted:
        check_outputs(job, wanted, [ledger_file], stage_file=False)
    if dressed or wheel:
        add_dressing(ledger_file, this_step(job.command, {}).time_utc, wheel or "")
        ledger = read_ledger(ledger_file)
    learned = learned_transfer(ledger)
    wear = wheel_wear(ledger, learned)
    if table is not None:
        with atomic_path(table, job.overwrite) as path:
            path.write_text(table_of_ledger(replace(ledger, passes=shown)), encoding="utf-8", newline="\n")

    def draw(path: Path) -> None:
        from cmm_align.report.history_picture import draw_history

        draw_history(shown, path, title=ledger_file.name, source=_names(ledger))

    faults = [] if plot is None else try_one(draw, plot, overwrite=job.overwrite)
    return Outcome(
        command=job.command,
        noun=ledger,
        inputs=[InputFile(str(ledger_file), sha256_of_file(ledger_file))],
        outputs=[path for path in wanted if path.exists()],
        result=_result(ledger, shown, learned, wear),
        rows=of_ledger(ledger, shown[-MOST_ROWS:], learned, wear, left_out=max(len(shown) - MOST_ROWS, 0)),
        details=details_of_ledger(shown),
        warnings=faults,
        exit_code=OutputError.exit_code if faults else 0,
    )


def _of_part(ledger: Ledger, part: str | None) -> tuple[LedgerPass, ...]:
    """Return the passes of a part, or all."""
    if part is None:
        return ledger.passes
    shown = tuple(one for one in ledger.passes if one.part == part)
    if not shown:
        names = list(dict.fromkeys(one.part for one in ledger.passes))
        near = difflib.get_close_matches(part, names, n=1) or names[:5]
        raise UsageError(
            f"the ledger has no part {part}", expected=", ".join(near) if near else "it has no passes yet"
        )
    return shown


def _names(ledger: Ledger) -> str:
    """Return machine and wheel in words."""
    wheel = next((one.wheel for one in reversed(ledger.dressings) if one.wheel), ledger.wheel)
    return ", ".join([*([ledger.machine] if ledger.machine else []), *([f"wheel {wheel}"] if wheel else [])])


def _result(
    ledger: Ledger, shown: tuple[LedgerPass, ...], learned: LearnedTransfer | None, wear: WheelWear | None
) -> dict[str, Any]:
    """Return the result of `history`."""
    from dataclasses import asdict

    from cmm_align.cli.noting import learned_result

    judged = [one.interval_held for one in shown if one.interval_held is not None]
    return {
        "nominal_digest": ledger.nominal_digest,
        "machine": ledger.machine or None,
        "wheel": ledger.wheel or None,
        "created_utc": ledger.created_utc,
        "n_passes": len(ledger.passes),
        "parts": list(dict.fromkeys(one.part for one in ledger.passes)),
        "bands": [asdict(band) for band in ledger.bands],
        "passes": [asdict(one) | {"interval_held": one.interval_held} for one in shown],
        "dressings": [asdict(one) for one in ledger.dressings],
        "learned": learned_result(learned),
        "wheel_wear": None if wear is None else asdict(wear),
        "n_predictions": len(judged),
        "n_predictions_held": sum(judged),
    }
