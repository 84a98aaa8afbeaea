"""Making an HDF5 file of ours: the frame around the datasets, and one dataset."""

from __future__ import annotations

import contextlib
import json
import math
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cmm_align import __version__
from cmm_align.errors import InputError, OutputError
from cmm_align.io.atomic import atomic_path
from cmm_align.io.hdf5_library import h5py
from cmm_align.io.patient_file import PatientFile, uninterrupted
from cmm_align.io.safe_hdf5 import MAX_VALUES, dataset, opened
from cmm_align.io.schema import DATASETS, VERSION
from cmm_align.provenance import Step

_CHUNK_ROWS: Final = 16384
_SMALL_VALUES: Final = 256
"""Below this a dataset is stored in one piece: chunks would cost more than they hold."""

_TRIAL_VALUES: Final = 1_000_000
"""From this on a sample decides whether a dataset is compressed."""
_SAMPLE_BYTES = 1 << 16
_WORTH_IT: Final = 0.8


@contextlib.contextmanager
def new_file(path: Path | str, schema: str, steps: Sequence[Step], overwrite: bool) -> Iterator[h5py.File]:
    """Give an open file to fill; it appears at `path` complete and verified, or not at all.

    Raises
    ------
    OutputError
        If it cannot be written, exists, or is locked by another run.
    """
    written: dict[str, tuple[int, ...]] = {}
    with (
        atomic_path(path, overwrite, verify=lambda made: _verify(made, written, str(path))) as temporary,
        contextlib.closing(PatientFile(temporary)) as stream,
    ):
        try:
            with uninterrupted(), h5py.File(stream, "w") as file:
                file.attrs["schema"] = schema
                file.attrs["schema_version"] = VERSION
                file.attrs["created_by"] = f"cmm-align {__version__}"
                yield file
                _write_steps(file, steps)
                written |= _shapes(file)
                file.attrs["complete"] = True
        except Exception:
            if stream.error is None:
                raise  # else it follows from that one
        stream.close()
        if stream.error is not None:
            raise stream.error


def write_array(group: h5py.Group, name: str, values: ArrayLike, *, noun: str = "") -> None:
    """Write an array with its unit and meaning from the table of `schema`.

    Parameters
    ----------
    group : h5py.Group
    name : str
        Name of the dataset.
    values : array_like
        Numbers or booleans of any shape.
    noun : str, optional
        Group name to look up in the table; the group's own name by default.
    """
    array = np.asarray(values)
    entry = DATASETS[f"{noun or group.name.rsplit('/', 1)[-1]}/{name}"]
    if array.size > MAX_VALUES:
        raise OutputError(
            f"{array.size} values", where=f"{group.name}/{name}", expected=f"at most {MAX_VALUES}"
        )
    options: dict[str, Any] = {}
    if array.size > _SMALL_VALUES:
        row = math.prod(array.shape[1:])
        rows = max(1, min(array.shape[0], _CHUNK_ROWS * 3 // row))
        options = {"chunks": (rows, *array.shape[1:]), "fletcher32": True}
        if array.size < _TRIAL_VALUES or _shrinks(array[:rows]):
            options["compression"] = "lzf"
    elif array.size:
        options = {"chunks": array.shape, "fletcher32": True} if array.ndim else {}
    created = group.create_dataset(name, data=array, **options)
    _label(created, entry.units, entry.description)


def write_text(group: h5py.Group, name: str, text: str, *, noun: str) -> None:
    """Write a text (UTF-8, fixed length) as a scalar dataset."""
    raw = text.encode("utf-8")
    created = group.create_dataset(
        name, data=np.bytes_(raw), dtype=h5py.string_dtype("utf-8", max(1, len(raw)))
    )
    entry = DATASETS[f"{noun}/{name}"]
    _label(created, entry.units, entry.description)


def _shrinks(sample: NDArray[Any]) -> bool:
    """Return whether compressing is worth its time: noise in the last digits makes it a waste."""
    raw = sample.tobytes()[:_SAMPLE_BYTES]
    return len(zlib.compress(raw, 1)) < _WORTH_IT * len(raw)


def _label(created: h5py.Dataset, units: str, description: str) -> None:
    created.attrs["units"] = units
    created.attrs["description"] = description


def _write_steps(file: h5py.File, steps: Sequence[Step]) -> None:
    parent = file.create_group("provenance")
    for number, step in enumerate(steps):
        group = parent.create_group(f"{number:03d}")
        group.attrs["command"] = step.command
        group.attrs["version"] = step.version
        group.attrs["time_utc"] = step.time_utc
        group.attrs["parameters"] = json.dumps(dict(step.parameters))
        # Escaped: a name may hold bytes that are no UTF-8, and HDF5 refuses those.
        group.attrs["inputs"] = json.dumps([asdict(i) for i in step.inputs])


def _shapes(file: h5py.File) -> dict[str, tuple[int, ...]]:
    found: dict[str, tuple[int, ...]] = {}

    def note(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset):
            found[f"/{name}"] = item.shape

    file.visititems(note)
    return found


def _verify(temporary: Path, written: dict[str, tuple[int, ...]], target: str) -> None:
    """Read the last chunk of every dataset back under its checksum."""
    try:
        with opened(temporary) as file:
            good = bool(file.attrs.get("complete", False)) and _shapes(file) == written
            for path in written if good else ():
                found = dataset(file, path)
                if found.shape and found.size:
                    found[-1]
    except InputError as error:
        raise OutputError(f"what was written cannot be read back ({error.what})", where=target) from None
    if not good:
        raise OutputError(
            "what was written is not complete", where=target, remedy="check the space on its drive"
        )
