"""The least that any program has to do: ``python limit_program.py POINTS NOMINAL LAYOUT OUTPUT``.

It imports NumPy and h5py, reads the points and what a fit needs of the nominal (the group `surface`), makes
one pass over the points (a rigid motion and one distance), and writes datasets of the same names, shapes,
types, chunks and checksums as `align` does. No fit, no checks, no provenance. LAYOUT is JSON made by
`layout_of`, beforehand. What `align` takes more than this is its own doing.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import h5py
import numpy as np


def layout_of(path: Path) -> list[dict[str, object]]:
    """Return name, shape, type and storage of every dataset of a file."""
    found: list[dict[str, object]] = []

    def note(name: str, item: object) -> None:
        if isinstance(item, h5py.Dataset) and item.dtype.kind in "fiub":
            found.append(
                {
                    "name": name,
                    "shape": item.shape,
                    "dtype": item.dtype.str,
                    "chunks": item.chunks,
                    "compression": item.compression,
                    "fletcher32": bool(item.fletcher32),
                }
            )

    with h5py.File(path) as file:
        file.visititems(note)
    return found


def main() -> None:
    """Read, pass, write."""
    points_path, nominal_path, layout_path, output = sys.argv[1:]
    with h5py.File(points_path) as file:
        points = file["points_mm"][()]
    with h5py.File(nominal_path) as file:
        surface = {name: item[()] for name, item in file["surface"].items() if isinstance(item, h5py.Dataset)}
    rotation, normal = np.eye(3)[[1, 0, 2]], np.array([0.0, 0.6, 0.8])
    moved = points @ rotation.T + 1.0
    distance = moved @ normal
    with h5py.File(output, "w") as file:
        for entry in json.loads(Path(layout_path).read_text(encoding="utf-8")):
            shape, dtype = tuple(entry["shape"]), np.dtype(entry["dtype"])
            held = surface.get(entry["name"].rsplit("/", 1)[-1])
            if held is not None and held.shape == shape:
                data = held
            elif shape == moved.shape:
                data = moved
            elif shape == distance.shape and dtype.kind == "f":
                data = distance
            else:
                data = np.zeros(shape, dtype)
            storage = {k: entry[k] for k in ("chunks", "compression") if entry[k] is not None}
            if storage:
                storage["chunks"] = tuple(storage["chunks"])
                storage["fletcher32"] = entry["fletcher32"]
            file.create_dataset(entry["name"], data=data, dtype=dtype, **storage)


if __name__ == "__main__":
    main()
