"""The file of a correction, written by `compensate`."""

from __future__ import annotations

import json
from typing import Any, Final, TypeVar

import numpy as np

from cmm_align.io.hdf5_library import h5py
from cmm_align.io.records import read_record, typed, write_record
from cmm_align.io.safe_hdf5 import attribute, find, json_attribute, read_array, where_of
from cmm_align.io.surface_group import CARRIED, read_nominal_group, write_nominal_group
from cmm_align.io.writing import write_array
from cmm_align.model import (
    Correction,
    CorrectionBand,
    CorrectionLimits,
    GateReport,
    PassPrediction,
    PassResponse,
    Seat,
    Statistics,
    frozen_array,
)

T = TypeVar("T")

_GRIDS: Final = (
    "x_mm",
    "y_mm",
    "correction_mm",
    "total_correction_mm",
    "commanded_z_mm",
    "commanded_normal",
    "extended",
)

_MORE_GRIDS: Final = ("deviation_mm", "status")
_RECORDS: Final = ("band", "limits", "prediction", "response", "gate", "seat")
"""What files of older versions do not hold."""


def write_body(file: h5py.File, noun: Correction) -> None:
    """Fill a file with a correction."""
    write_nominal_group(file.create_group(CARRIED), noun.nominal)
    grid = file.create_group("grid")
    for name in _GRIDS:
        write_array(grid, name, getattr(noun, name))
    for name in _MORE_GRIDS:
        if getattr(noun, name) is not None:
            write_array(grid, name, getattr(noun, name))
    plan = file.create_group("plan")
    plan.attrs["gain"] = float(noun.gain)
    plan.attrs["gain_rule"] = noun.gain_rule
    plan.attrs["pass_number"] = noun.pass_number
    plan.attrs["worth_another_pass"] = bool(noun.worth_another_pass)
    plan.attrs["reason"] = noun.reason
    plan.attrs["map_digest"] = noun.map_digest
    plan.attrs["applied_maps"] = json.dumps(list(noun.applied_maps))
    statistics = file.create_group("statistics")
    write_record(statistics.create_group("predicted"), noun.predicted)
    write_record(statistics.create_group("before"), noun.before)
    for name in _RECORDS:
        if getattr(noun, name) is not None:
            write_record(plan.create_group(name), getattr(noun, name))


def read_body(file: h5py.File) -> Correction:
    """Return the correction of a file.

    Raises
    ------
    MalformedInputError
        If something is missing or not as expected.
    """
    x = read_array(file, "/grid/x_mm", (None,), finite=True)
    y = read_array(file, "/grid/y_mm", (None,), finite=True)
    shape = (len(y), len(x))
    maps = json_attribute(file, "/plan", "applied_maps")
    new = find(file, "/grid/status") is not None
    return Correction(
        nominal=read_nominal_group(file, CARRIED),
        x_mm=x,
        y_mm=y,
        correction_mm=read_array(file, "/grid/correction_mm", shape),
        total_correction_mm=read_array(file, "/grid/total_correction_mm", shape),
        commanded_z_mm=read_array(file, "/grid/commanded_z_mm", shape),
        commanded_normal=read_array(file, "/grid/commanded_normal", (*shape, 3)),
        extended=read_array(file, "/grid/extended", shape, "b"),
        gain=attribute(file, "/plan", "gain", float),
        pass_number=attribute(file, "/plan", "pass_number", int),
        predicted=read_record(file, "/statistics/predicted", Statistics),
        before=read_record(file, "/statistics/before", Statistics),
        worth_another_pass=attribute(file, "/plan", "worth_another_pass", bool),
        reason=attribute(file, "/plan", "reason"),
        map_digest=attribute(file, "/plan", "map_digest"),
        applied_maps=typed(maps, tuple[str, ...], where_of(file, "/plan/@applied_maps")),
        gain_rule=attribute(file, "/plan", "gain_rule") if new else "fixed",
        deviation_mm=read_array(file, "/grid/deviation_mm", shape) if new else None,
        status=_status(file, shape) if new else None,
        band=_record(file, "band", CorrectionBand),
        limits=_record(file, "limits", CorrectionLimits),
        prediction=_record(file, "prediction", PassPrediction),
        response=_record(file, "response", PassResponse),
        gate=_record(file, "gate", GateReport),
        seat=_record(file, "seat", Seat),
    )


def _status(file: h5py.File, shape: tuple[int, int]) -> Any:
    """Return the codes of the nodes as they travel."""
    return frozen_array(read_array(file, "/grid/status", shape, "i"), np.uint8)


def _record(file: h5py.File, name: str, kind: type[T]) -> T | None:
    """Return a record of the plan, None if the file has none."""
    path = f"/plan/{name}"
    return None if find(file, path) is None else read_record(file, path, kind)
