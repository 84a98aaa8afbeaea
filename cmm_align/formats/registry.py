"""All formats that can be read, and the choice between them by content."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final, NamedTuple, TypeAlias

from cmm_align.errors import MalformedInputError, UsageError, WrongStageError
from cmm_align.formats import (
    cad,
    calypso_table,
    codev_int,
    delimited,
    dmis_fa,
    generic_dump,
    geopak_gws,
    gmserver_log,
    iges_points,
    ipp_log,
    laser_tracker,
    mesh,
    npy,
    pc_dmis_text,
    prescription_toml,
    vda_fs,
    zemax_grid_sag,
)
from cmm_align.formats.source import NO_HINTS, Hints, Source, load
from cmm_align.model import PointSet
from cmm_align.surfaces.mesh import TriangleMesh
from cmm_align.surfaces.nurbs import NurbsSurface
from cmm_align.surfaces.prescription import PrescriptionSurface

NominalSource: TypeAlias = PointSet | PrescriptionSurface | TriangleMesh | NurbsSurface


class Format(NamedTuple):
    """A kind of file that can be read."""

    name: str
    recognises: Callable[[bytes], bool]
    """Whether the first bytes of a file look like this format."""
    read: Callable[[Source, str | None], NominalSource]
    """Reader of a loaded file, with the unit the user gave."""
    takes: frozenset[str] = frozenset()
    """Hints on which the reader acts: ``decimal``, ``columns``."""
    looks_at_all: bool = False
    """Whether `recognises` wants the whole file: its first bytes do not tell."""


_DECIMAL: Final = frozenset({"decimal"})
_COLUMNS: Final = frozenset({"columns"})

FORMATS: Final[tuple[Format, ...]] = (
    Format("npy", npy.recognises, npy.read),
    Format("prescription", prescription_toml.recognises, prescription_toml.read),
    Format("IGES points", iges_points.recognises, iges_points.read, looks_at_all=True),
    Format("CAD", cad.recognises, cad.read),
    Format("mesh", mesh.recognises, mesh.read),
    Format("Zemax grid sag", zemax_grid_sag.recognises, zemax_grid_sag.read),
    Format("CODE V interferogram", codev_int.recognises, codev_int.read),
    Format("GEOPAK scan", geopak_gws.recognises, geopak_gws.read),
    Format("VDA-FS", vda_fs.recognises, vda_fs.read),
    Format("DMIS", dmis_fa.recognises, dmis_fa.read),
    Format("PC-DMIS text", pc_dmis_text.recognises, pc_dmis_text.read),
    Format("CALYPSO table", calypso_table.recognises, calypso_table.read, _DECIMAL),
    Format("laser-tracker table", laser_tracker.recognises, laser_tracker.read, _DECIMAL),
    Format("generic dump", generic_dump.recognises, generic_dump.read),
    Format("GMServer log", gmserver_log.recognises, gmserver_log.read),
    Format("I++ log", ipp_log.recognises, ipp_log.read, _COLUMNS),
    Format("delimited text", delimited.recognises, delimited.read, _DECIMAL | _COLUMNS),
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
        if known.recognises(source.raw if known.looks_at_all else source.head):
            return known
    names = ", ".join(known.name for known in FORMATS)
    raise MalformedInputError("its format is not known", where=source.where, expected=f"one of {names}")


def read_points(path: Path | str, units: str | None = None, hints: Hints = NO_HINTS) -> PointSet:
    """Return the points of a file of any format.

    Parameters
    ----------
    path : path
    units : str, optional
        Unit of length where the file states none; mm by default.
    hints : Hints
        What the user says of a file that can be read in two ways, and whether measured rows may be left out.

    Raises
    ------
    MissingFileError, MalformedInputError, UnitsError
        If the file cannot be read as points, contradicts the hints, or has rows that a strict reading must
        not leave out.
    UsageError
        If a hint is of no use for the format of the file.
    WrongStageError
        If it is a prescription, a mesh or a CAD file.
    """
    source = load(path, hints)
    known = sniff(source)
    _refuse_useless(hints, known, source.where)
    read = None if known.read is cad.read else known.read(source, units)
    if not isinstance(read, PointSet):
        raise WrongStageError(
            f"this is a {known.name}{' file' if known.name == 'CAD' else ''}, a nominal, not points",
            where=str(path),
            expected="points of the measuring machine",
            remedy="give it as the last argument of `cmm-align align`, or to `cmm-align offset`",
        )
    return _nothing_left_out(read, hints)


def _refuse_useless(hints: Hints, known: Format, where: str) -> None:
    """Refuse hints on which the reader of a format does not act; a decimal point is what all others have."""
    given = {"columns": hints.columns, "decimal": None if hints.decimal == "." else hints.decimal}
    for name, value in given.items():
        if value is not None and name not in known.takes:
            raise UsageError(
                f"--{name} {value} for {where}: a {known.name} file says itself what its {name} are",
                expected="the option for a table that leaves it open",
            )


def _nothing_left_out(points: PointSet, hints: Hints) -> PointSet:
    """Return points as they are; refuse them if measured rows were left out, and must not be."""
    if hints.strict and points.passed_over:
        first, *others = points.passed_over
        more = f" (and {len(others)} more)" if others else ""
        raise MalformedInputError(
            f"{first}{more}",
            expected="no measured row to be left out, since --strict is given",
            remedy="take the rows out at their source, or leave --strict out",
        )
    return points


def read_nominal_source(
    path: Path | str, units: str | None = None, face: int | None = None, hints: Hints = NO_HINTS
) -> NominalSource:
    """Return the points, prescription, mesh or patch of a file of any format.

    Parameters
    ----------
    path : path
    units : str, optional
        Unit of length where the file states none; mm by default.
    face : int, optional
        Number of the face of a CAD file, from 1; needed where it holds several.
    hints : Hints
        What the user says of a file that can be read in two ways, and whether rows may be left out.

    Raises
    ------
    MissingFileError, MalformedInputError, UnitsError
        If the file cannot be read, or contradicts the hints.
    UsageError
        If a face is asked for and there is none, or a hint is of no use for the format of the file.
    """
    source = load(path, hints)
    known = sniff(source)
    _refuse_useless(hints, known, source.where)
    if known.read is cad.read:
        return cad.read(source, units, face)
    if face is not None:
        raise UsageError(
            f"--face {face} for {source.where}", expected="a STEP or IGES file: others have no faces"
        )
    read = known.read(source, units)
    return _nothing_left_out(read, hints) if isinstance(read, PointSet) else read
