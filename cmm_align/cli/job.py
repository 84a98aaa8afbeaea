"""A run from its parsed options to its outcome: what every command takes and gives back."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from cmm_align.config import Config
from cmm_align.provenance import InputFile

STAGE_SUFFIXES: Final = (".align", ".map", ".comp", ".offset")
"""What a stage puts between stem and `.h5`; dropped again by the next one."""

EXIT_OF_VERDICT: Final = {"pass": 0, "none": 0, "fail": 5, "undecided": 6}
"""What a verdict is to a script."""


@dataclass(frozen=True, slots=True)
class Job:
    """What the common options say.

    Attributes
    ----------
    command : str
    config : Config
        Defaults, overlaid by the files of ``--config`` in their order.
    json, quiet, overwrite : bool
    verbosity : int
        Number of ``-v``.
    units : str or None
        Unit of inputs that state none.
    """

    command: str
    config: Config = field(default_factory=Config)
    json: bool = False
    quiet: bool = False
    verbosity: int = 0
    overwrite: bool = False
    units: str | None = None


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a command found and made.

    Attributes
    ----------
    command : str
    noun : object
        What the stage returned, for Python callers and for the next step of `demo`.
    inputs : sequence of InputFile
    outputs : sequence of Path
        In the order in which they were written; the first is the one for the next stage.
    result : mapping
        For ``--json``: every number carries its unit in its key.
    rows : sequence of (label, value)
        For the screen.
    details : sequence of (label, value)
        For the screen too, with ``-v``.
    verdict : str
        PASS, FAIL or UNDECIDED where a tolerance was given, else empty.
    reasons : sequence of str
        What was judged, a sentence for each tolerance.
    warnings : sequence of str
    advice : str
        What to do before the next command, or in place of one, in prose.
    next_command : str
        What to type next, ready to be copied; empty at the end of the chain.
    exit_code : int
        0, or 5 and 6 where a tolerance was given.
    """

    command: str
    noun: object
    inputs: Sequence[InputFile]
    outputs: Sequence[Path]
    result: Mapping[str, Any]
    rows: Sequence[tuple[str, str]]
    details: Sequence[tuple[str, str]] = ()
    verdict: str = ""
    reasons: Sequence[str] = ()
    warnings: Sequence[str] = ()
    advice: str = ""
    next_command: str = ""
    exit_code: int = 0


def typed(*words: str | Path) -> str:
    """Return a command as it is typed in a shell, names with blanks in quotes.

    Examples
    --------
    >>> typed("cmm-align", "error-map", Path("my part.align.h5"))
    "cmm-align error-map 'my part.align.h5'"
    """
    return shlex.join(str(word) for word in words)


def beside(source: Path, suffix: str) -> Path:
    """Return the default output beside an input: its stem plus a suffix.

    Parameters
    ----------
    source : Path
        The input; what an earlier stage added to its stem is dropped.
    suffix : str
        As ``.map.h5``.

    Examples
    --------
    >>> beside(Path("part.align.h5"), ".map.h5").name
    'part.map.h5'
    """
    stem = source.stem
    for stage in STAGE_SUFFIXES:
        stem = stem.removesuffix(stage)
    return source.with_name(stem + suffix)
