"""Other people's files: one reader per format, chosen by content.

A new format is one module with `recognises(head)` and `read(source, units)`, and one line in `FORMATS`.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final, NamedTuple, TypeAlias

from cmm_align.errors import MalformedInputError, WrongStageError
from cmm_align.formats import delimited, npy, prescription_toml
from cmm_align.formats.points_text import text_blocks
from cmm_align.formats.source import Source, load
from cmm_align.model import PointSet
from cmm_align.surfaces.prescription import PrescriptionSurface

NominalSource: TypeAlias = PointSet | PrescriptionSurface

__all__ = ["FORMATS", "Format", "NominalSource", "read_nominal_source", "read_points", "sniff", "text_blocks"]


class Format(NamedTuple):
    """A kind of file that can be read."""

    name: str
    recognises: Callable[[bytes], bool]
    """Whether the first bytes of a file look like this format."""
    read: Callable[[Source, str | None], NominalSource]
    """Reader of a loaded file, with the unit the user gave."""


FORMATS: Final[tuple[Format, ...]] = (
    Format("npy", npy.recognises, npy.read),
    Format("prescription", prescription_toml.recognises, prescription_toml.read),
    Format("delimited text", delimited.recognises, delimited.read),
)
"""Tried in this order; the last one takes whatever is left and says what is wrong with it."""


def sniff(source: Source) -> Format:
    """Return the first format that recognises a file by its content.

    Raises
    ------
    MalformedInputError
        If none does.
    """
    for known in FORMATS:
        if known.recognises(source.head):
            return known
    names = ", ".join(known.name for known in FORMATS)
    raise MalformedInputError("its format is not known", where=source.where, expected=f"one of {names}")


def read_points(path: Path | str, units: str | None = None) -> PointSet:
    """Return the points of a file of any format.

    Parameters
    ----------
    path : path
    units : str, optional
        Unit of length where the file states none; mm by default.

    Raises
    ------
    MissingFileError, MalformedInputError, UnitsError
        If the file cannot be read as points.
    WrongStageError
        If it is a prescription.
    """
    read = read_nominal_source(path, units)
    if not isinstance(read, PointSet):
        raise WrongStageError(
            "this is a prescription, a nominal, not points",
            where=str(path),
            expected="points of the measuring machine",
            remedy="give it as the last argument of `cmm-align align`, or to `cmm-align offset`",
        )
    return read


def read_nominal_source(path: Path | str, units: str | None = None) -> NominalSource:
    """Return the points or the prescription of a file of any format.

    Raises
    ------
    MissingFileError, MalformedInputError, UnitsError
        If the file cannot be read.
    """
    source = load(path)
    return sniff(source).read(source, units)
