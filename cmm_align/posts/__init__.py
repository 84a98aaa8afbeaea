"""What grinding and figuring machines read, written from a correction and read back.

A post is one module with `blocks(job)`, the bytes of a file, and `read(raw, where, ...)`, which takes from
such a file what the machine would do, and nothing from the writer; one line in `POSTS` makes it known.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Final

from cmm_align.errors import MissingFileError, UsageError
from cmm_align.io.atomic import atomic_path
from cmm_align.io.kinds import POST_STEM
from cmm_align.numerics.wheel import Wheel
from cmm_align.posts import dwell, gcode, heidenhain, template, xyz, zemax
from cmm_align.posts.commanded import CommandedPoints, points_and_normals
from cmm_align.posts.dwell import Removal
from cmm_align.posts.job import ExportJob
from cmm_align.posts.template import Template, read_template
from cmm_align.surfaces.protocol import Array

__all__ = [
    "SUFFIXES",
    "CommandedPoints",
    "ExportJob",
    "Prepared",
    "Removal",
    "Template",
    "points_and_normals",
    "prepared",
    "read_back",
    "read_dwell",
    "read_template",
    "suffix_of",
    "write_export",
]

SUFFIXES: Final = {
    "xyz": ".xyz",
    "xyzijk": ".ijk.xyz",
    "zemax": ".sag.dat",
    "heidenhain": ".h",
    "gcode-raster": ".raster.nc",
    "gcode-spiral": ".spiral.nc",
    "dwell": ".dwell.mat",
}
"""What is put after the stem of the correction; that of a template stands in its file."""

_BLOCKS: Final = {
    "xyz": xyz.xyz_blocks,
    "xyzijk": xyz.xyzijk_blocks,
    "zemax": zemax.blocks,
    "heidenhain": heidenhain.blocks,
    "gcode-raster": gcode.raster_blocks,
    "gcode-spiral": gcode.spiral_blocks,
    "dwell": dwell.blocks,
}


def suffix_of(name: str, post: Template | None = None) -> str:
    """Return the suffix of the file of an export.

    Raises
    ------
    UsageError
        If there is no such export, or a template without its description.
    """
    if name == "template":
        return POST_STEM + _described(post).suffix
    if name not in SUFFIXES:
        raise UsageError(f"export {name!r}", expected=f"one of {', '.join([*SUFFIXES, 'template'])}")
    return SUFFIXES[name]


@dataclass(frozen=True, slots=True)
class Prepared:
    """An export that the settings allow, ready to be written once."""

    blocks: Iterator[bytes]

    def write(self, path: Path | str, *, overwrite: bool = False) -> None:
        """Write it, whole or not at all.

        Raises
        ------
        OutputError
            If it cannot be written; an old file is then as it was.
        """
        with atomic_path(path, overwrite) as temporary, temporary.open("wb") as stream:
            stream.writelines(self.blocks)


def prepared(name: str, job: ExportJob, post: Template | None = None) -> Prepared:
    """Return an export, checked and ready to be written.

    Raises
    ------
    UsageError
        If the settings do not allow it: no wheel, too many lines, an unknown footprint.
    """
    blocks = template.blocks(job, _described(post)) if name == "template" else _BLOCKS[name](job)
    first = next(blocks)  # what the settings do not allow is said before any file is opened
    return Prepared(chain([first], blocks))


def write_export(
    path: Path | str, name: str, job: ExportJob, post: Template | None = None, *, overwrite: bool = False
) -> None:
    """Write an export, whole or not at all; errors as `prepared` and `Prepared.write`."""
    prepared(name, job, post).write(path, overwrite=overwrite)


def read_back(
    path: Path | str,
    name: str,
    wheel: Wheel | None = None,
    *,
    post: Template | None = None,
    outward: Array | None = None,
) -> CommandedPoints:
    """Return the points that a machine would grind, from the file alone.

    Parameters
    ----------
    path : path
    name : str
        Of the export, as ``gcode-raster``.
    wheel : Wheel, optional
        Axis in frame `part`; needed where the file holds tool centres.
    post : Template, optional
        Description of a ``template``.
    outward : ndarray, shape (3,), optional
        A direction out of the material in frame `part`, for a template of tool centres alone.

    Returns
    -------
    CommandedPoints
        In frame `part`, for ``zemax`` in frame `surface`; with the accuracy of the points.

    Raises
    ------
    UsageError
        If the wheel is needed and missing, or the export is ``dwell`` (see `read_dwell`).
    MalformedInputError
        If the file is not whole, or not what its name says.
    """
    raw, where = _loaded(path), str(path)
    if name in {"xyz", "xyzijk"}:
        return xyz.read(raw, where)
    if name == "zemax":
        return zemax.read(raw, where)
    if name == "heidenhain":
        return heidenhain.read(raw, where)
    if name in {"gcode-raster", "gcode-spiral"}:
        if wheel is None:
            raise UsageError("tool centres without their wheel", where=where)
        return gcode.read(raw, where, wheel)
    if name == "template":
        return template.read(raw, where, _described(post), wheel, outward)
    raise UsageError(f"no points in an export {name!r}", where=where)


def read_dwell(path: Path | str) -> Removal:
    """Return the grid of a ``dwell`` export.

    Raises
    ------
    MissingFileError, MalformedInputError
        If there is no such file, or it is something else.
    """
    return dwell.read(_loaded(path), str(path))


def _described(post: Template | None) -> Template:
    if post is None:
        raise UsageError("a template without its description", remedy="give --post FILE.toml")
    return post


def _loaded(path: Path | str) -> bytes:
    try:
        return Path(path).read_bytes()
    except OSError as error:
        raise MissingFileError(f"cannot read it ({error.strerror})", where=str(path)) from None
