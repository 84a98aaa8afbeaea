"""The one door for any file: ours or somebody else's, chosen by content."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final, TypeAlias

from cmm_align import formats, io
from cmm_align.errors import MalformedInputError, MissingFileError, UsageError, WrongStageError
from cmm_align.io.schema import NOMINAL, STAGES
from cmm_align.model import FitStep, Nominal, PointKind, PointSet
from cmm_align.provenance import Step
from cmm_align.surfaces.mesh import TriangleMesh
from cmm_align.surfaces.nurbs import NurbsSurface
from cmm_align.surfaces.prescription import PrescriptionSurface
from cmm_align.surfaces.protocol import Array
from cmm_align.units import UM_PER_MM

AnyNoun: TypeAlias = io.Noun | PointSet | PrescriptionSurface | TriangleMesh | NurbsSurface

_HDF5_SUFFIXES: Final = (".h5", ".hdf5", ".hdf")


def read(path: Path | str, units: str | None = None, face: int | None = None) -> AnyNoun:
    """Return what any file holds: a noun of ours, points, a prescription, a mesh or a CAD face.

    Parameters
    ----------
    path : path
    units : str, optional
        Unit of length where the file states none; mm by default.
    face : int, optional
        Number of the face of a STEP or IGES file, from 1; needed where it holds several.

    Raises
    ------
    InputError
        If the file is missing, malformed, or in another unit.
    UsageError
        If a face is asked for and there is none.
    """
    if not _is_hdf5(path):
        journal = _recorded(path)
        return formats.read_nominal_source(path, units, face) if journal is None else journal
    _refuse_face(path, face)
    if io.schema_of(path) is None:
        return io.read_points_hdf5(path, units)
    return io.read(path)


def read_measured(
    path: Path | str, units: str | None = None, hints: formats.Hints = formats.NO_HINTS
) -> PointSet:
    """Return the points of a measurement.

    Parameters
    ----------
    path : path
    units : str, optional
        Unit of length where the file states none; mm by default.
    hints : Hints
        Decimal sign and columns of a file that can be read in two ways; whether rows may be left out.

    Raises
    ------
    WrongStageError
        If the file is a nominal, or a result of one of our stages.
    InputError
        If the file is missing, malformed, or in another unit.
    """
    if _is_hdf5(path):
        _refuse_hints(path, hints)
        points = io.read_points_hdf5(path, units)
    else:
        journal = _recorded(path)
        points = formats.read_points(path, units, hints) if journal is None else journal
    if points.kind in {PointKind.NOMINAL, PointKind.COMMANDED}:
        raise WrongStageError(
            f"these are {points.kind.value} points, not measured ones",
            where=str(path),
            expected="points of the measuring machine",
            remedy="the order is: cmm-align align MEASURED NOMINAL",
        )
    return points


def read_nominal_any(
    path: Path | str,
    units: str | None = None,
    with_equidistant: bool = False,
    face: int | None = None,
    hints: formats.Hints = formats.NO_HINTS,
) -> Nominal | formats.NominalSource:
    """Return a nominal in whatever form the file holds it.

    Parameters
    ----------
    path : path
    units : str, optional
        Unit of length where the file states none; mm by default.
    with_equidistant : bool
        Whether a file of `offset` is read with its net of nodes and triangles.
    face : int, optional
        Number of the face of a STEP or IGES file, from 1; needed where it holds several.
    hints : Hints
        As for `read_measured`.

    Raises
    ------
    WrongStageError
        If the file is a result of a later stage, or commanded points.
    InputError
        If the file is missing, malformed, or in another unit.
    UsageError
        If a face is asked for and there is none.
    """
    source: formats.NominalSource
    if not _is_hdf5(path):
        source = formats.read_nominal_source(path, units, face, hints)
    else:
        _refuse_face(path, face)
        _refuse_hints(path, hints)
        found = io.schema_of(path)
        if found is not None:
            return io.read_nominal(path, with_equidistant)
        source = io.read_points_hdf5(path, units)
    if isinstance(source, PointSet) and source.kind in {PointKind.TIP_CENTRE, PointKind.COMMANDED}:
        raise WrongStageError(
            f"these are {source.kind.value} points, not a nominal",
            where=str(path),
            expected=f"points of the design, a prescription, or {STAGES[NOMINAL].noun} made by `offset`",
            remedy="the order is: cmm-align align MEASURED NOMINAL",
        )
    return source


def write(noun: io.Noun, path: Path | str, steps: Sequence[Step] = (), overwrite: bool = False) -> None:
    """Write a noun of ours, whole or not at all.

    Raises
    ------
    OutputError
        If it cannot be written; an old file is then as it was.
    """
    io.write(noun, path, steps, overwrite)


def write_points(
    path: Path | str,
    points: PointSet,
    *,
    units: str = "mm",
    decimals: int = 6,
    normals: Array | None = None,
    with_ids: bool = False,
    notes: Sequence[str] = (),
    overwrite: bool = False,
) -> None:
    """Write points as text of ours, whole or not at all.

    Parameters
    ----------
    path : path
    points : PointSet
    units : str
        Unit of length in the file.
    decimals : int
        Digits after the decimal point of lengths, in `units`.
    normals : ndarray, shape (N, 3), optional
        Unit vectors for the columns i, j, k, in the frame of the points.
    with_ids : bool
        Whether to write the column `id`.
    notes : sequence of str
        Lines for people (ASCII), written as comments under the header.
    overwrite : bool
        Whether an existing file may be replaced.

    Raises
    ------
    OutputError
        If it cannot be written; an old file is then as it was.
    """
    blocks = formats.text_blocks(
        points, units=units, decimals=decimals, normals=normals, with_ids=with_ids, notes=notes
    )
    with io.atomic_path(path, overwrite) as temporary, temporary.open("wb") as stream:
        stream.writelines(blocks)


def write_iterations(path: Path | str, steps: Sequence[FitStep], *, overwrite: bool = False) -> None:
    """Write every step of a fit as CSV, whole or not at all.

    Parameters
    ----------
    path : path
    steps : sequence of FitStep
    overwrite : bool
        Whether an existing file may be replaced.

    Raises
    ------
    OutputError
        If it cannot be written; an old file is then as it was.
    """
    lines = ["step,phase,movement_mm,rms_um,cost_mm2,n_used"]
    for number, step in enumerate(steps):
        rms_um = max(step.cost_mm2, 0.0) ** 0.5 * UM_PER_MM
        lines.append(
            f"{number},{step.phase},{step.movement_mm:.17g},{rms_um:.17g},{step.cost_mm2:.17g},{step.n_used}"
        )
    with io.atomic_path(path, overwrite) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="ascii", newline="\n")


def write_grid(
    path: Path | str,
    x_mm: Array,
    y_mm: Array,
    z_mm: Array,
    form: str = "zemax",
    *,
    derivatives: tuple[Array, Array, Array] | None = None,
    title: str = "surface height",
    overwrite: bool = False,
) -> None:
    """Write heights on a grid for optical design, whole or not at all.

    Parameters
    ----------
    path : path
    x_mm, y_mm : ndarray, shape (nx,), (ny,), mm
        Ascending, equal steps.
    z_mm : ndarray, shape (ny, nx), mm
        NaN where unknown.
    form : str
        ``zemax`` (grid sag .DAT) or ``codev`` (.INT, which knows no lengths along x and y).
    derivatives : tuple of ndarray, each of shape (ny, nx), optional
        dz/dx, dz/dy and d2z/dxdy (1/mm), for ``zemax``; its reader finds them itself without.
    title : str
        For ``codev``.
    overwrite : bool
        Whether an existing file may be replaced.

    Raises
    ------
    UsageError
        If the form is unknown, or the grid is none that it can hold.
    OutputError
        If it cannot be written; an old file is then as it was.
    """
    if form not in {"zemax", "codev"}:
        raise UsageError(f"form {form!r}", expected="zemax or codev")
    if form == "zemax":
        blocks = formats.zemax_grid_sag_text(x_mm, y_mm, z_mm, derivatives)
    else:
        blocks = formats.codev_int_text(z_mm, title)
    with io.atomic_path(path, overwrite) as temporary, temporary.open("wb") as stream:
        stream.writelines(blocks)


def _recorded(path: Path | str) -> PointSet | None:
    """Return the points of a journal of `capture`; None for any other file."""
    from cmm_align.device.recordings import is_journal_file

    if not (Path(path).is_file() and is_journal_file(Path(path))):
        return None
    from cmm_align.device.address import replay_url
    from cmm_align.device.capture import capture_points  # loads the dialects

    return capture_points(replay_url(path)).points


def _refuse_hints(path: Path | str, hints: formats.Hints) -> None:
    if hints.columns is not None or hints.decimal is not None:
        raise UsageError(
            f"--columns or --decimal for {path}", expected="a text: HDF5 names its datasets itself"
        )


def _refuse_face(path: Path | str, face: int | None) -> None:
    if face is not None:
        raise UsageError(f"--face {face} for {path}", expected="a STEP or IGES file: others have no faces")


def _is_hdf5(path: Path | str) -> bool:
    """Return whether a file is HDF5 by content; the suffix decides where the content says nothing."""
    if Path(path).is_dir():
        raise MissingFileError("is a folder", where=str(path), expected="a file")
    try:
        with Path(path).open("rb") as stream:
            head = stream.read(len(io.MAGIC))
    except OSError as error:
        raise MissingFileError(f"cannot read it ({error.strerror})", where=str(path)) from None
    if not head and Path(path).suffix.lower() not in _HDF5_SUFFIXES:
        raise MalformedInputError("the file is empty (0 bytes)", where=str(path), expected="points")
    if head == io.MAGIC:
        return True
    return Path(path).suffix.lower() in _HDF5_SUFFIXES and (not head or io.MAGIC.startswith(head))
