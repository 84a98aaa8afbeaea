"""Points from any HDF5 file that names them: a dataset `points_mm`, `points` or `xyz` of shape (N, 3).

Beside it may stand `ids` or `id`, `sigma_mm` and `weight`, each of shape (N,).
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from cmm_align.errors import MalformedInputError, UnitsError, WrongStageError
from cmm_align.io.hdf5_library import h5py
from cmm_align.io.safe_hdf5 import attribute, dataset, find, opened, read_array, where_of
from cmm_align.io.schema import STAGES
from cmm_align.model import PointKind, PointSet
from cmm_align.surfaces.protocol import Array
from cmm_align.units import mm_per

_NAMES: Final = ("points_mm", "points", "xyz")
_IDS: Final = ("ids", "id")
_FRAMES: Final = ("machine", "part", "grinder")


def read_points_hdf5(path: Path | str, units: str | None = None) -> PointSet:
    """Return the points of an HDF5 file of somebody else.

    The attributes `units`, `kind` and `frame` are taken from the dataset, or else from the root.

    Parameters
    ----------
    path : path
    units : str, optional
        Unit of length where the file states none; mm by default.

    Raises
    ------
    WrongStageError
        If it is a file of one of our stages, which holds no measurement.
    MalformedInputError
        If there is no such dataset, or it is not (N, 3) finite numbers; or if one beside it is not (N,), or
        holds what cannot be: an id that is no whole number, an uncertainty that is not above zero, a weight
        below it.
    UnitsError
        If the file states another unit than `units`.
    """
    with opened(path) as file:
        stage = STAGES.get(str(file.attrs.get("schema", "")))
        if stage is not None:
            raise WrongStageError(
                f"this is {stage.noun} (made by `{stage.maker}`), not points",
                where=str(path),
                expected="points of the measuring machine",
                remedy=f"{stage.taker}; the order is offset, align, error-map, compensate",
            )
        name = next((n for n in _NAMES if isinstance(find(file, n), h5py.Dataset)), None)
        if name is None:
            raise MalformedInputError(
                "no dataset of points",
                where=f"{path}:/",
                expected=f"one of {', '.join(_NAMES)} of shape (N, 3)",
            )
        dataset(file, f"/{name}")
        stated = _word(file, name, "units") or ("mm" if name.endswith("_mm") else "")
        if stated and units and mm_per(stated) != mm_per(units):
            raise UnitsError(f"it states {stated}, --units says {units}", where=where_of(file, f"/{name}"))
        scale = mm_per(stated or units or "mm", where=where_of(file, f"/{name}"))
        kind = _word(file, name, "kind") or PointKind.UNSTATED.value
        frame = _word(file, name, "frame") or "machine"
        if kind not in set(PointKind) or frame not in _FRAMES:
            raise MalformedInputError(
                f"kind {kind!r}, frame {frame!r}",
                where=where_of(file, f"/{name}"),
                expected="kind tip_centre, contact or nominal; frame machine or part",
            )
        points = read_array(file, f"/{name}", (None, 3), finite=True)
        numbered = next((n for n in _IDS if _is_there(file, n)), None)
        ids = None if numbered is None else read_array(file, f"/{numbered}", (len(points),), "i")
        sigma_mm, weight = (_beside(file, n, len(points)) for n in ("sigma_mm", "weight"))
    return PointSet.of(
        points if scale == 1.0 else points * scale,
        kind=PointKind(kind),
        frame=frame,
        ids=ids,
        source=str(path),
        sigma_mm=sigma_mm,
        weight=weight,
    )


def _is_there(file: h5py.File, name: str) -> bool:
    return isinstance(find(file, name), h5py.Dataset)


def _beside(file: h5py.File, name: str, count: int) -> Array | None:
    """Return a dataset with a number for each point; None if it is not there."""
    if not _is_there(file, name):
        return None
    stated = str(attribute(file, f"/{name}", "units")) if "units" in file[name].attrs else ""
    if name.endswith("_mm") and stated and mm_per(stated, where=where_of(file, f"/{name}")) != 1.0:
        raise UnitsError(f"{name} in {stated}", where=where_of(file, f"/{name}"), expected="mm")
    return read_array(file, f"/{name}", (count,), finite=True)


def _word(file: h5py.File, name: str, key: str) -> str:
    for owner, path in ((file[name], f"/{name}"), (file, "/")):
        if key in owner.attrs:
            return str(attribute(file, path, key))
    return ""
