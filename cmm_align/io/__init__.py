"""The door to our own files: read, write, and what is in them.

The only importer of h5py. Every file is written whole or not at all (`atomic`), and read with distrust
(`safe_hdf5`). `schema` lists all datasets with their units.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeAlias

from cmm_align.errors import InputError, MalformedInputError, WrongStageError
from cmm_align.io import alignment_file, correction_file, map_file, nominal_file, schema
from cmm_align.io.atomic import atomic_path, check_writable
from cmm_align.io.describing import datasets, headlines, steps_of
from cmm_align.io.hdf5_library import h5py
from cmm_align.io.points_hdf5 import read_points_hdf5
from cmm_align.io.safe_hdf5 import MAGIC, attribute, opened
from cmm_align.io.writing import new_file
from cmm_align.model import Alignment, Correction, DeviationMap, Nominal
from cmm_align.provenance import Step

Noun: TypeAlias = Nominal | Alignment | DeviationMap | Correction

__all__ = [
    "MAGIC",
    "Noun",
    "atomic_path",
    "check_writable",
    "describe",
    "read",
    "read_alignment",
    "read_correction",
    "read_map",
    "read_nominal",
    "read_points_hdf5",
    "read_steps",
    "schema_of",
    "write",
]


def read(path: Path | str) -> Noun:
    """Return what a file of ours holds; a nominal comes with its equidistant net.

    Raises
    ------
    MissingFileError
        If there is no such file.
    MalformedInputError
        If it is not a file of ours, or damaged.
    """
    with opened(path) as file:
        name = _schema(file, path)
        if name == schema.NOMINAL:
            return nominal_file.read_body(file, with_equidistant=True)
        if name == schema.ALIGNMENT:
            return alignment_file.read_body(file)
        if name == schema.MAP:
            return map_file.read_body(file)
        return correction_file.read_body(file)


def read_nominal(path: Path | str, with_equidistant: bool = False) -> Nominal:
    """Return the nominal of a file of `offset`.

    Parameters
    ----------
    path : path
    with_equidistant : bool
        Whether to read the net of nodes and triangles too, which comes anyway where the ball does not reach
        everywhere; the smooth surfaces always come.

    Raises
    ------
    WrongStageError
        If the file is of another stage.
    """
    with opened(path) as file:
        _require(file, path, schema.NOMINAL)
        return nominal_file.read_body(file, with_equidistant)


def read_alignment(path: Path | str) -> Alignment:
    """Return the alignment of a file of `align`.

    Raises
    ------
    WrongStageError
        If the file is of another stage.
    """
    with opened(path) as file:
        _require(file, path, schema.ALIGNMENT)
        return alignment_file.read_body(file)


def read_map(path: Path | str) -> DeviationMap:
    """Return the map of a file of `error-map`.

    Raises
    ------
    WrongStageError
        If the file is of another stage.
    """
    with opened(path) as file:
        _require(file, path, schema.MAP)
        return map_file.read_body(file)


def read_correction(path: Path | str) -> Correction:
    """Return the correction of a file of `compensate`.

    Raises
    ------
    WrongStageError
        If the file is of another stage.
    """
    with opened(path) as file:
        _require(file, path, schema.CORRECTION)
        return correction_file.read_body(file)


def write(noun: Noun, path: Path | str, steps: Sequence[Step] = (), overwrite: bool = False) -> None:
    """Write a noun, whole or not at all.

    Parameters
    ----------
    noun : Nominal, Alignment, DeviationMap or Correction
    path : path
    steps : sequence of Step
        All steps that led here, oldest first.
    overwrite : bool
        Whether an existing file may be replaced.

    Raises
    ------
    OutputExistsError, OutputLockedError, OutputError
        If it cannot be written; an old file is then as it was.
    """
    if isinstance(noun, Nominal):
        with new_file(path, schema.NOMINAL, steps, overwrite) as file:
            nominal_file.write_body(file, noun)
    elif isinstance(noun, Alignment):
        with new_file(path, schema.ALIGNMENT, steps, overwrite) as file:
            alignment_file.write_body(file, noun)
    elif isinstance(noun, DeviationMap):
        with new_file(path, schema.MAP, steps, overwrite) as file:
            map_file.write_body(file, noun)
    elif isinstance(noun, Correction):
        with new_file(path, schema.CORRECTION, steps, overwrite) as file:
            correction_file.write_body(file, noun)
    else:
        raise InputError(f"cannot write a {type(noun).__name__}", where=str(path))


def schema_of(path: Path | str) -> str | None:
    """Return the schema of an HDF5 file of ours, or None if it is somebody else's.

    Raises
    ------
    MissingFileError, MalformedInputError
        If it is not a readable HDF5 file.
    """
    with opened(path) as file:
        name = str(file.attrs.get("schema", ""))
        return name if name in schema.STAGES else None


def read_steps(path: Path | str) -> tuple[Step, ...]:
    """Return the steps that led to a file of ours, oldest first.

    Raises
    ------
    MalformedInputError
        If it is not a file of ours.
    """
    with opened(path) as file:
        _schema(file, path)
        return steps_of(file)


def describe(path: Path | str) -> dict[str, Any]:
    """Return what is in a file of ours and where it came from, without reading large arrays.

    Returns
    -------
    dict
        ``schema``, ``schema_version``, ``created_by``, ``what``, ``next``, ``steps`` (of `Step`),
        ``datasets`` (each ``name``, ``shape``, ``dtype``, ``units``, ``description``) and ``numbers``
        (``group/name`` to value, units in the names).

    Raises
    ------
    MalformedInputError
        If it is not a file of ours.
    """
    with opened(path) as file:
        name = _schema(file, path)
        return {
            "schema": name,
            "schema_version": attribute(file, "/", "schema_version", int),
            "created_by": attribute(file, "/", "created_by"),
            "what": schema.STAGES[name].noun,
            "next": schema.STAGES[name].taker,
            "steps": steps_of(file),
            "datasets": datasets(file),
            "numbers": headlines(file),
        }


def _schema(file: h5py.File, path: Path | str) -> str:
    """Return the schema after checking that the file is ours, complete, and not newer than this program."""
    if "schema" not in file.attrs and "complete" not in file.attrs:
        raise MalformedInputError("not a file of cmm-align", where=f"{path}:/@schema", expected="a schema")
    name = str(attribute(file, "/", "schema"))
    if name not in schema.STAGES:
        raise MalformedInputError(
            f"schema {name!r}", where=f"{path}:/@schema", expected=f"one of {', '.join(schema.STAGES)}"
        )
    version = attribute(file, "/", "schema_version", int)
    if version > schema.VERSION:
        raise MalformedInputError(
            f"schema version {version} is newer than this program",
            where=f"{path}:/@schema_version",
            expected=f"at most {schema.VERSION}",
            remedy="update cmm-align",
        )
    if "complete" not in file.attrs or not attribute(file, "/", "complete", bool):
        raise MalformedInputError(
            "the file is not complete: its writer was stopped",
            where=f"{path}:/@complete",
            remedy="make it again",
        )
    return name


def _require(file: h5py.File, path: Path | str, wanted: str) -> None:
    name = _schema(file, path)
    if name != wanted:
        stage, want = schema.STAGES[name], schema.STAGES[wanted]
        raise WrongStageError(
            f"this is {stage.noun} (made by `{stage.maker}`)",
            where=str(path),
            expected=f"{want.noun} (made by `{want.maker}`)",
            remedy=stage.taker,
        )
