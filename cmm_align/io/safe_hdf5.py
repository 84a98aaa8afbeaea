"""Reading HDF5 that nobody vouches for.

HDF5 can point out of the file (external links, virtual datasets, external storage), declare terabytes in
a kilobyte, and ask for shared libraries. All of that is refused from the metadata, before data are read.
Every path is walked component by component, because a link hides in any of them.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cmm_align.errors import InputError, MalformedInputError, MissingFileError
from cmm_align.io.hdf5_library import h5py
from cmm_align.io.schema import VERSION

MAGIC: Final = b"\x89HDF\r\n\x1a\n"
MAX_VALUES: Final = 500_000_000
MAX_BYTES: Final = 4 << 30
MAX_EXPANSION: Final = 1000
_LZF: Final = 32000
_FILTERS: Final = {
    h5py.h5z.FILTER_DEFLATE,
    h5py.h5z.FILTER_SHUFFLE,
    h5py.h5z.FILTER_FLETCHER32,
    _LZF,
}
_KIND_WORDS: Final = {"f": "float", "i": "integer", "b": "boolean", "S": "text"}
_DAMAGE: Final = (OSError, RuntimeError, KeyError, ValueError, TypeError, UnicodeDecodeError)


@contextlib.contextmanager
def opened(path: Path | str) -> Iterator[h5py.File]:
    """Open an HDF5 file for reading.

    Raises
    ------
    MissingFileError
        If there is no such file.
    MalformedInputError
        If it is not HDF5, or is cut off.
    """
    where = str(path)
    try:
        with Path(path).open("rb") as stream:
            head = stream.read(len(MAGIC))
            size = os.fstat(stream.fileno()).st_size
    except OSError as error:
        raise MissingFileError(f"cannot read it ({error.strerror})", where=where) from None
    if not head:
        raise MalformedInputError("the file is empty (0 bytes)", where=where, expected="an HDF5 file")
    if head != MAGIC:
        short = MAGIC.startswith(head)
        what = f"the file is incomplete ({size} bytes)" if short else "not an HDF5 file"
        raise MalformedInputError(what, where=where, expected="the signature of HDF5")
    try:
        file = h5py.File(where, "r", locking="best-effort")
    except _DAMAGE as error:
        stored = re.search(r"stored_eof = (\d+)", str(error))
        of = f" of {stored[1]}" if stored else ""
        raise MalformedInputError(
            f"the file is incomplete or damaged ({size}{of} bytes)", where=where, remedy="make it again"
        ) from None
    try:
        yield file
    except InputError:
        raise
    except _DAMAGE as error:
        raise MalformedInputError(
            f"the file is damaged ({error})", where=where, remedy="make it again"
        ) from error
    finally:
        file.close()


def where_of(file: h5py.File, path: str) -> str:
    """Return ``file:/path`` for messages."""
    return f"{file.filename}:{path}"


def find(file: h5py.File, path: str) -> h5py.Group | h5py.Dataset | None:
    """Return what lies at an absolute path, or None; links out of the file are refused.

    Raises
    ------
    MalformedInputError
        If a component of the path is anything but a hard link.
    """
    here: Any = file
    walked = ""
    for name in path.strip("/").split("/"):
        if not isinstance(here, h5py.Group):
            return None
        walked = f"{walked}/{name}"
        link = here.get(name, getlink=True)
        if link is None:
            return None
        if not isinstance(link, h5py.HardLink):
            raise MalformedInputError(
                "a soft or external link", where=where_of(file, walked), expected="data inside this file"
            )
        here = here[name]
    return here if isinstance(here, h5py.Group | h5py.Dataset) else None


def group(file: h5py.File, path: str) -> h5py.Group:
    """Return the group at a path, or the root for ``/``.

    Raises
    ------
    MalformedInputError
        If there is none.
    """
    if path == "/":
        return file
    found = find(file, path)
    if not isinstance(found, h5py.Group):
        raise MalformedInputError("the group is missing", where=where_of(file, path))
    return found


def dataset(file: h5py.File, path: str) -> h5py.Dataset:
    """Return the dataset at a path after checking all that can be checked without reading it.

    Raises
    ------
    MalformedInputError
        If it is missing, lies outside the file, or is larger than it can be.
    """
    where = where_of(file, path)
    found = find(file, path)
    if not isinstance(found, h5py.Dataset):
        raise MalformedInputError(
            "the dataset is missing",
            where=where,
            expected="a file as our command wrote it",
            remedy="make it anew: something took the dataset out, or the file is of another kind",
        )
    if found.is_virtual or found.external:
        raise MalformedInputError(
            "its data lie outside the file", where=where, expected="data inside this file"
        )
    properties = found.id.get_create_plist()
    for index in range(properties.get_nfilters()):
        code = properties.get_filter(index)[0]
        if code not in _FILTERS:
            raise MalformedInputError(
                f"it needs filter {code}", where=where, expected="gzip, lzf, shuffle or fletcher32"
            )
    if found.shape is None:
        raise MalformedInputError("it is empty", where=where)
    values = math.prod(found.shape)
    size, stored = values * found.dtype.itemsize, found.id.get_storage_size()
    if values > MAX_VALUES or (size > MAX_BYTES and size > MAX_EXPANSION * stored) or (size and not stored):
        raise MalformedInputError(
            f"it declares {values} values of shape {found.shape} and stores {stored} bytes",
            where=where,
            expected=f"at most {MAX_VALUES} values, and all of them stored",
        )
    return found


def read_array(
    file: h5py.File,
    path: str,
    shape: tuple[int | None, ...],
    kind: str = "f",
    *,
    finite: bool = False,
) -> NDArray[Any]:
    """Return a dataset as a read-only array of float64, int64 or bool.

    Parameters
    ----------
    file : h5py.File
    path : str
        Absolute path of the dataset.
    shape : tuple
        Expected shape; None stands for any length.
    kind : str
        ``f`` for numbers, ``i`` for integers, ``b`` for booleans (also stored as 0 and 1).
    finite : bool
        Whether NaN and infinity are refused.

    Raises
    ------
    MalformedInputError
        If the dataset is missing, unsafe, damaged, or not as expected.
    """
    where = where_of(file, path)
    found = dataset(file, path)
    wanted = "(" + ", ".join("n" if n is None else str(n) for n in shape) + ")"
    if len(found.shape) != len(shape) or any(
        n is not None and n != m for n, m in zip(shape, found.shape, strict=True)
    ):
        raise MalformedInputError(f"shape {found.shape}", where=where, expected=wanted)
    allowed = {"f": "fiu", "i": "iu", "b": "biu"}[kind]
    if found.dtype.kind not in allowed:
        raise MalformedInputError(f"type {found.dtype}", where=where, expected=f"{_KIND_WORDS[kind]} values")
    try:
        raw = found[()]
    except _DAMAGE as error:
        raise MalformedInputError(
            f"its data are damaged ({error})", where=where, remedy="make the file again"
        ) from None
    array: NDArray[Any] = np.asarray(raw, dtype={"f": np.float64, "i": np.int64, "b": np.bool_}[kind])
    if finite and not np.isfinite(array).all():
        place = np.argwhere(~np.isfinite(array))[0].tolist()
        raise MalformedInputError(f"not finite at {place}", where=where, expected="finite numbers")
    array.flags.writeable = False
    return array


def read_text(file: h5py.File, path: str) -> str:
    """Return a scalar text of fixed length (UTF-8).

    Raises
    ------
    MalformedInputError
        If it is missing, unsafe or not text.
    """
    found = dataset(file, path)
    if found.shape != () or found.dtype.kind != "S":
        raise MalformedInputError(
            f"type {found.dtype} of shape {found.shape}", where=where_of(file, path), expected="one text"
        )
    return bytes(found[()]).decode("utf-8")


def is_older(file: h5py.File) -> bool:
    """Return whether a file was written by an older version: what came later may be missing in it."""
    return "schema_version" in file.attrs and attribute(file, "/", "schema_version", int) < VERSION


def attribute(file: h5py.File, path: str, name: str, kind: type = str) -> Any:
    """Return a scalar attribute of the object at `path` as str, int, float or bool.

    Raises
    ------
    MalformedInputError
        If it is missing or of another type.
    """
    where = where_of(file, f"{path.rstrip('/')}/@{name}")
    owner = file if path == "/" else find(file, path)
    if owner is None or name not in owner.attrs:
        raise MalformedInputError("the attribute is missing", where=where)
    stored = owner.attrs.get_id(name)
    if stored.shape != ():
        raise MalformedInputError(f"shape {stored.shape}", where=where, expected="a single value")
    value = owner.attrs[name]
    if isinstance(value, bytes):
        value = value.decode("utf-8", "replace")
    if isinstance(value, np.generic):
        value = value.item()
    accepted = {float: (float, int), int: int, bool: bool, str: str}[kind]
    if not isinstance(value, accepted) or (isinstance(value, bool) and kind is not bool):  # type: ignore[arg-type]
        raise MalformedInputError(f"{value!r}", where=where, expected=f"a value of type {kind.__name__}")
    return kind(value)


def json_attribute(file: h5py.File, path: str, name: str) -> Any:
    """Return a scalar text attribute parsed as JSON.

    Raises
    ------
    MalformedInputError
        If it is missing or not JSON.
    """
    text = attribute(file, path, name)
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        raise MalformedInputError(
            "not JSON", where=where_of(file, f"{path.rstrip('/')}/@{name}"), expected="JSON text"
        ) from None
