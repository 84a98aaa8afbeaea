"""What a run leaves in its outputs: which inputs, which settings, and the steps before it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

from cmm_align.cli.job import Job
from cmm_align.errors import UsageError
from cmm_align.io import read_steps
from cmm_align.io.atomic import check_writable
from cmm_align.io.kinds import HDF5_SUFFIXES
from cmm_align.provenance import InputFile, Step, this_step


def check_outputs(
    job: Job, outputs: Sequence[Path], inputs: Sequence[Path], *, stage_file: bool = True
) -> None:
    """Refuse, before anything is computed, outputs that exist, cannot be written or are inputs.

    Parameters
    ----------
    job : Job
    outputs, inputs : sequence of Path
    stage_file : bool
        Whether the first output is one of our HDF5 files, which must be named as such.

    Raises
    ------
    UsageError
        If the name of a stage file says that it is something else.
    OutputError
        For the first output that cannot be written.
    """
    if stage_file and outputs[0].suffix.lower() not in HDF5_SUFFIXES:
        raise UsageError(
            f"{outputs[0].name!r} is no name for the file of a stage",
            where=str(outputs[0]),
            expected=f"a name that ends in {' or '.join(HDF5_SUFFIXES)}",
            remedy=f"give -o {outputs[0].with_suffix('.h5').name}",
        )
    places = [path.resolve() for path in outputs]
    if len(set(places)) < len(places):
        raise UsageError("two outputs with one name", where=str(outputs[0]), expected="a name for each")
    for path in outputs:
        check_writable(path, job.overwrite, inputs)


def steps(
    job: Job,
    inputs: Sequence[Path] | Callable[[], tuple[InputFile, ...]],
    *,
    after: Sequence[Path] = (),
    **settings: Any,
) -> tuple[Step, ...]:
    """Return the steps of earlier files, oldest first, and this run as the last one.

    Parameters
    ----------
    job : Job
    inputs : sequence of Path, or callable
        Files that were read, or what `hashed` returned for them; their checksums are recorded.
    after : sequence of Path
        Files of ours among them, whose own steps are carried on.
    settings
        All effective settings by name; a settings class becomes a table.
    """
    earlier: list[Step] = []
    for path in after:
        earlier += [step for step in read_steps(path) if step not in earlier]
    parameters = {name: _plain(value) for name, value in settings.items()}
    return (*earlier, this_step(job.command, parameters, inputs))


def _plain(value: Any) -> Any:
    """Return a setting as JSON knows it."""
    if is_dataclass(value) and not isinstance(value, type):
        return {item.name: _plain(getattr(value, item.name)) for item in fields(value)}
    if isinstance(value, Path):
        return str(value)
    return value
