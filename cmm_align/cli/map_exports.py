"""A deviation map in other programs' formats; an export that fails does not take the numbers with it."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Final

from cmm_align.errors import CmmAlignError

if TYPE_CHECKING:
    from cmm_align.model import DeviationMap
    from cmm_align.provenance import Step

EXPORTS: Final = {"csv": ".csv", "x3p": ".x3p", "zygo": ".dat"}
"""Names of the exports, and what each puts in place of the suffix of the map."""


def files(names: Sequence[str], output: Path) -> dict[str, Path]:
    """Return the file of each export that was asked for, beside the map."""
    return {name: output.with_suffix(suffix) for name, suffix in EXPORTS.items() if name in names}


def write_all(
    deviation_map: DeviationMap, places: dict[str, Path], step: Step, *, overwrite: bool
) -> tuple[list[Path], list[CmmAlignError]]:
    """Write the exports; return those that were written, and the errors of those that were not.

    Parameters
    ----------
    deviation_map : DeviationMap
    places : dict
        From `files`.
    step : Step
        This run; its time is that of the exports.
    overwrite : bool
        Whether files that are there may be replaced.
    """
    from cmm_align.formats import map_csv, x3p, zygo_dat
    from cmm_align.io.atomic import atomic_path

    written: list[Path] = []
    errors: list[CmmAlignError] = []
    for name, path in places.items():
        try:
            with atomic_path(path, overwrite) as place:
                if name == "csv":
                    map_csv.write(deviation_map, place)
                elif name == "x3p":
                    x3p.write(deviation_map, place, time_utc=step.time_utc)
                else:
                    made = datetime.fromisoformat(step.time_utc)
                    zygo_dat.write(deviation_map, place, time_s=int(made.timestamp()))
        except CmmAlignError as error:
            errors.append(
                type(error)(error.what, where=path.name, expected=error.expected, remedy=error.remedy)
            )
        else:
            written.append(path)
    return written, errors


def not_written(error: CmmAlignError) -> str:
    """Return the warning for an export that could not be written."""
    return f"not written: {error.one_line()} (the numbers are complete; exit code {error.exit_code})"
