"""Other people's files: one reader per format, chosen by content.

A new format is one module with `recognises(head)` and `read(source, units)`, and one line in `FORMATS`.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final, NamedTuple, TypeAlias

from cmm_align.errors import MalformedInputError, UsageError, WrongStageError
from cmm_align.formats import cad, codev_int, delimited, mesh, npy, prescription_toml, zemax_grid_sag
from cmm_align.formats.codev_int import codev_int_text
from cmm_align.formats.points_text import text_blocks
from cmm_align.formats.source import Source, load
from cmm_align.formats.zemax_grid_sag import zemax_grid_sag_text
from cmm_align.model import PointSet
from cmm_align.surfaces.mesh import TriangleMesh
from cmm_align.surfaces.nurbs import NurbsSurface
from cmm_align.surfaces.prescription import PrescriptionSurface

NominalSource: TypeAlias = PointSet | PrescriptionSurface | TriangleMesh | NurbsSurface

__all__ = [
    "FORMATS",
    "Format",
    "NominalSource",
    "codev_int_text",
    "read_nominal_source",
    "read_points",
    "sniff",
    "text_blocks",
    "zemax_grid_sag_text",
]


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
    Format("CAD", cad.recognises, cad.read),
    Format("mesh", mesh.recognises, mesh.read),
    Format("Zemax grid sag", zemax_grid_sag.recognises, zemax_grid_sag.read),
    Format("CODE V interferogram", codev_int.recognises, codev_int.read),
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
        If it is a prescription, a mesh or a CAD file.
    """
    source = load(path)
    known = sniff(source)
    read = None if known.read is cad.read else known.read(source, units)
    if not isinstance(read, PointSet):
        raise WrongStageError(
            f"this is a {known.name}{' file' if known.name == 'CAD' else ''}, a nominal, not points",
            where=str(path),
            expected="points of the measuring machine",
            remedy="give it as the last argument of `cmm-align align`, or to `cmm-align offset`",
        )
    return read


def read_nominal_source(path: Path | str, units: str | None = None, face: int | None = None) -> NominalSource:
    """Return the points, prescription, mesh or patch of a file of any format.

    Parameters
    ----------
    path : path
    units : str, optional
        Unit of length where the file states none; mm by default.
    face : int, optional
        Number of the face of a CAD file, from 1; needed where it holds several.

    Raises
    ------
    MissingFileError, MalformedInputError, UnitsError
        If the file cannot be read.
    UsageError
        If a face is asked for and there is none.
    """
    source = load(path)
    known = sniff(source)
    if known.read is cad.read:
        return cad.read(source, units, face)
    if face is not None:
        raise UsageError(
            f"--face {face} for {source.where}", expected="a STEP or IGES file: others have no faces"
        )
    return known.read(source, units)
