"""The ledger of `compensate`: opened, learned from, and added to when all outputs are written."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from cmm_align.cli.job import beside
from cmm_align.cli.options import FILE
from cmm_align.config import CompensateConfig
from cmm_align.errors import UsageError, WrongStageError

if TYPE_CHECKING:
    from cmm_align.model import Correction, DeviationMap, LearnedTransfer, Ledger, PassOutcome

HEADINGS: Final = {"Ledger": ("--ledger", "--part", "--machine", "--wheel")}

_OPTIONS: Final = (
    click.option("--ledger", type=FILE, metavar="FILE", help="Learn from its passes, and add this one."),
    click.option("--part", metavar="ID", help="Name of this part.  [default: as before, or the map's]"),
    click.option("--machine", metavar="NAME", help="Grinder of the ledger."),
    click.option("--wheel", metavar="NAME", help="Wheel that the ledger begins with."),
)


def ledger_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options of the ledger to a command."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def with_ledger(config: CompensateConfig, values: dict[str, Any]) -> tuple[CompensateConfig, str | None]:
    """Take the options of the ledger out of the values of a command; return the settings and the part.

    Raises
    ------
    UsageError
        If a part is named and there is no ledger.
    """
    ledger, part = values.pop("ledger"), values.pop("part")
    given: dict[str, Any] = {"ledger": None if ledger is None else str(ledger)}
    given |= {name: values.pop(name) for name in ("machine", "wheel")}
    config = replace(config, **{name: value for name, value in given.items() if value is not None})
    if part is not None and not config.ledger:
        raise UsageError("--part needs --ledger", remedy="give the file of the ledger")
    return config, part


@dataclass(frozen=True, slots=True)
class Noted:
    """A ledger in use: what it knows with the pass before filled in, and what is to be added."""

    path: Path
    ledger: Ledger
    part: str
    came: PassOutcome | None
    learned: LearnedTransfer | None
    config: CompensateConfig
    knows_previous: bool

    def warnings(self, previous: Correction | None) -> list[str]:
        """Return what to know about the ledger although nothing failed."""
        texts = []
        if previous is not None and not self.knows_previous:
            texts.append(
                f"{self.path.name} does not know pass {previous.pass_number} of this part: what came of it "
                "is not noted"
            )
        if self.config.transfer and self.learned is not None:
            texts.append(f"the transfer that was given goes before the one that {self.path.name} has learned")
        return texts

    @property
    def used(self) -> LearnedTransfer | None:
        """Return the learned transfer, if it is the one that counts."""
        return None if self.config.transfer else self.learned

    def rows(self) -> list[tuple[str, str]]:
        """Return the rows of the report."""
        from cmm_align.report.ledger_summary import of_learned
        from cmm_align.stages.learned_transfer import gain_of

        n = len(self.ledger.passes)
        passes = "pass" if n == 1 else "passes"
        rows = [("ledger", f"{self.path}: {self.part}, {n} {passes} before this one in the ledger")]
        rows += of_learned(self.learned)
        if self.used is not None:
            gains = [gain_of(one) for one in self.used.bands]
            rows.append(("", f"the gain is divided by it: x {min(gains):.2f} to {max(gains):.2f}"))
        return rows

    def result(self) -> dict[str, Any]:
        """Return the part of the result of `compensate` that tells of the ledger."""
        return {
            "path": str(self.path),
            "part": self.part,
            "n_passes": len(self.ledger.passes),
            "learned": learned_result(self.learned),
        }


def opened(
    config: CompensateConfig,
    part: str | None,
    map_file: Path,
    deviation_map: DeviationMap,
    previous: Correction | None,
    time_utc: str,
) -> Noted | None:
    """Return the ledger of the settings, with what came of the pass before; None if there is none.

    Parameters
    ----------
    config : CompensateConfig
    part : str or None
        As typed.
    map_file : Path
        Gives a part its name where nothing else does.
    deviation_map : DeviationMap
    previous : Correction or None
    time_utc : str

    Raises
    ------
    WrongStageError
        If the ledger is of another nominal, machine or wheel.
    InputError
        If it is no ledger, or too new.
    """
    if not config.ledger:
        return None
    from cmm_align.io.ledger_file import read_ledger
    from cmm_align.model import Ledger
    from cmm_align.stages.learned_transfer import learned_transfer
    from cmm_align.stages.ledger_entry import pass_outcome, with_outcome
    from cmm_align.stages.spatial_bands import wave_bands

    path, nominal = Path(config.ledger), deviation_map.alignment.nominal
    if path.exists():
        ledger = read_ledger(path)
        _check_names(path, ledger, config, nominal.digest)
    else:
        bands = wave_bands(nominal.surface.bounds)
        ledger = Ledger(nominal.digest, config.machine, config.wheel, time_utc, bands)
    before = None
    if previous is not None:
        before = next((p for p in ledger.passes if p.map_digest == previous.map_digest), None)
    came = None
    if previous is not None:
        came = pass_outcome(deviation_map, previous, ledger.bands, config, time_utc)
        ledger = with_outcome(ledger, previous.map_digest, came)
    name = part or (before.part if before is not None else beside(map_file, "").name)
    if before is not None and name != before.part:
        raise WrongStageError(
            f"the ledger knows the pass before as one of {before.part}",
            where=str(path),
            remedy=f"leave --part out, or give --part {before.part}",
        )
    return Noted(path, ledger, name, came, learned_transfer(ledger), config, before is not None)


@contextmanager
def adding(
    noted: Noted | None,
    deviation_map: DeviationMap,
    correction: Correction,
    previous: Correction | None,
    time_utc: str,
    *,
    replace_row: bool,
) -> Iterator[None]:
    """Add the pass when the block, which writes the outputs, ends well; without a ledger do nothing.

    A ledger that is new is left behind only then.

    Raises
    ------
    WrongStageError
        If the ledger has another map or correction in this place.
    OutputLockedError
        If another run holds it for too long.
    """
    if noted is None:
        yield
        return
    from cmm_align.io.ledger_file import adding_pass
    from cmm_align.stages.ledger_entry import ledger_entry

    row = ledger_entry(
        noted.part, deviation_map, correction, previous, noted.ledger.bands, noted.config, time_utc
    )
    with adding_pass(noted.path, row, noted.came, replace=replace_row, new=noted.ledger):
        yield


def learned_result(learned: LearnedTransfer | None) -> list[dict[str, Any]]:
    """Return what is known of the transfer as JSON knows it, from long to short waves."""
    from cmm_align.stages.learned_transfer import gain_of

    return [
        {
            "short_mm": one.band.short_mm,
            "long_mm": one.band.long_mm if isfinite(one.band.long_mm) else None,
            "transfer": one.transfer,
            "u_transfer": one.u,
            "scatter": one.scatter,
            "gain": gain_of(one),
            "n_passes": one.n_passes,
            "n_parts": one.n_parts,
        }
        for one in (learned.bands if learned is not None else ())
    ]


def _check_names(path: Path, ledger: Ledger, config: CompensateConfig, digest: str) -> None:
    """Refuse a ledger of another part family, machine or wheel."""
    if ledger.nominal_digest != digest:
        raise WrongStageError(
            "the ledger is of another nominal",
            where=str(path),
            expected=f"nominal {digest[:12]}, found {ledger.nominal_digest[:12]}",
            remedy="one ledger for each family of parts: give another file",
        )
    wheel = next((one.wheel for one in reversed(ledger.dressings) if one.wheel), ledger.wheel)
    for what, wanted, found in (("machine", config.machine, ledger.machine), ("wheel", config.wheel, wheel)):
        if wanted and wanted != found:
            raise WrongStageError(
                f"the ledger is of {what} {found or '(no name)'}",
                where=str(path),
                expected=f"{what} {wanted}",
                remedy="give its own ledger"
                if what == "machine"
                else "give its own ledger, or note the new one with `cmm-align history LEDGER --wheel NAME`",
            )
