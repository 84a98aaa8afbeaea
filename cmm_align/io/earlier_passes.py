"""Corrections that lie beside a map: the part may have been ground with one of them."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from cmm_align.errors import InputError
from cmm_align.io.hdf5_library import h5py
from cmm_align.io.safe_hdf5 import attribute, json_attribute, opened
from cmm_align.io.schema import CORRECTION
from cmm_align.io.surface_group import CARRIED


class EarlierPass(NamedTuple):
    """A correction of the same nominal."""

    path: Path
    pass_number: int
    applied_maps: tuple[str, ...]
    """Maps that it has in it from the passes before."""


def earlier_passes(
    folder: Path, nominal_digest: str, map_digest: str, leave_out: Iterable[Path] = ()
) -> list[EarlierPass]:
    """Return the corrections of a nominal in a folder, the latest pass first; only attributes are read.

    Parameters
    ----------
    folder : Path
        Where files named ``*.comp.h5`` are looked for.
    nominal_digest : str
        Of the nominal they must be for.
    map_digest : str
        Of the map in hand: a correction that was made from it cannot have led to it.
    leave_out : iterable of Path
        Files not to count, as the output of this very run.
    """
    found = []
    without = {path.resolve() for path in leave_out}
    for path in sorted(folder.glob("*.comp.h5")):
        if path.resolve() in without:
            continue
        try:
            with opened(path) as file:
                if file.attrs.get("schema") != CORRECTION:
                    continue
                applied = _applied(file)
                made_from = [attribute(file, "/plan", "map_digest"), *applied]
                if attribute(file, CARRIED, "digest") == nominal_digest and map_digest not in made_from:
                    found.append(
                        EarlierPass(path, attribute(file, "/plan", "pass_number", int), tuple(applied))
                    )
        except InputError:
            continue  # a file that cannot be read is no earlier pass
    return sorted(found, key=lambda one: -one.pass_number)


def _applied(file: h5py.File) -> list[str]:
    """Return the maps that a correction has in it from the passes before."""
    maps = json_attribute(file, "/plan", "applied_maps")
    return [str(name) for name in maps] if isinstance(maps, list) else []
