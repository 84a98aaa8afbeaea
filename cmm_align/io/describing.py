"""What is in a file of ours, without reading its large arrays."""

from __future__ import annotations

from typing import Any

import numpy as np

from cmm_align.io.hdf5_library import h5py
from cmm_align.io.records import typed
from cmm_align.io.safe_hdf5 import attribute, find, group, json_attribute, where_of
from cmm_align.provenance import InputFile, Step

_HEADLINE_GROUPS = ("surface", "nominal_surface", "report", "grid", "statistics", "plan")


def steps_of(file: h5py.File) -> tuple[Step, ...]:
    """Return the steps that led to a file, oldest first.

    Raises
    ------
    MalformedInputError
        If one of them is damaged.
    """
    if find(file, "/provenance") is None:
        return ()
    steps = []
    for name in sorted(group(file, "/provenance")):
        path = f"/provenance/{name}"
        inputs = json_attribute(file, path, "inputs")
        steps.append(
            Step(
                command=attribute(file, path, "command"),
                version=attribute(file, path, "version"),
                time_utc=attribute(file, path, "time_utc"),
                parameters=json_attribute(file, path, "parameters"),
                inputs=typed(inputs, tuple[InputFile, ...], where_of(file, f"{path}/@inputs")),
            )
        )
    return tuple(steps)


def headlines(file: h5py.File) -> dict[str, Any]:
    """Return the single numbers and words of a file by ``group/name``, units in their names."""
    found: dict[str, Any] = {}
    for name in _HEADLINE_GROUPS:
        if isinstance(find(file, name), h5py.Group):
            _collect(file[name], name, found)
    return found


def datasets(file: h5py.File) -> list[dict[str, Any]]:
    """Return name, shape, type, units and description of every dataset."""
    found: list[dict[str, Any]] = []

    def note(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset):
            found.append(
                {
                    "name": f"/{name}",
                    "shape": list(item.shape or ()),
                    "dtype": str(item.dtype),
                    "units": str(item.attrs.get("units", "")),
                    "description": str(item.attrs.get("description", "")),
                }
            )

    file.visititems(note)  # follows hard links only
    return found


def _collect(owner: h5py.Group, prefix: str, found: dict[str, Any]) -> None:
    for key, value in owner.attrs.items():
        if isinstance(value, np.generic):
            found[f"{prefix}/{key}"] = value.item()
        elif isinstance(value, str):
            found[f"{prefix}/{key}"] = value
    for name in owner:
        if isinstance(find(owner.file, f"{owner.name}/{name}"), h5py.Group):
            _collect(owner[name], f"{prefix}/{name}", found)
