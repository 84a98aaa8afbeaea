"""The file of a deviation map, written by `error-map`."""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from typing import TypeVar

from cmm_align.errors import MalformedInputError
from cmm_align.io import alignment_file
from cmm_align.io.comparison_group import read_comparison, write_comparison
from cmm_align.io.hdf5_library import h5py
from cmm_align.io.records import read_record, typed, write_record
from cmm_align.io.safe_hdf5 import attribute, find, is_older, json_attribute, read_array, where_of
from cmm_align.io.writing import write_array
from cmm_align.model import (
    Conformance,
    DeviationMap,
    LadderRung,
    LowOrders,
    MapFilter,
    MapNumbers,
    RootCauses,
    Spectrum,
    Statistics,
    Verdict,
)

T = TypeVar("T")


def write_body(file: h5py.File, noun: DeviationMap) -> None:
    """Fill a file with a map and the alignment behind it."""
    alignment_file.write_body(file, noun.alignment)
    grid = file.create_group("grid")
    for name in ("x_mm", "y_mm", "deviation_mm", "sag_deviation_mm", "sigma_mm"):
        write_array(grid, name, getattr(noun, name))
    grid.attrs["spacing_mm"] = float(noun.spacing_mm)
    if noun.method:
        grid.attrs["method"] = noun.method
        grid.attrs["window_steps"] = float(noun.window_steps)
    if noun.filter is not None:
        write_record(file.create_group("filter"), noun.filter)
    if noun.low_orders is not None:
        write_record(file.create_group("low_orders"), noun.low_orders)
    if noun.comparison is not None:
        write_comparison(file, noun.comparison)
    if noun.root_causes is not None:
        write_record(file.create_group("root_causes"), noun.root_causes)
    if noun.spectrum is not None:
        write_record(file.create_group("spectrum"), noun.spectrum)
    for name in ("numbers", "conformance"):
        if getattr(noun, name) is not None:
            write_record(file.create_group(name), getattr(noun, name))
    statistics = file.create_group("statistics")
    write_record(statistics.create_group("nodes"), noun.statistics)
    write_record(statistics.create_group("points"), noun.point_statistics)
    statistics.attrs["pvr_mm"] = float(noun.pvr_mm)
    statistics.attrs["u_rms_mm"] = float(noun.u_rms_mm)
    statistics.attrs["ladder"] = json.dumps([asdict(rung) for rung in noun.ladder])
    statistics.attrs["verdict"] = noun.verdict.value
    statistics.attrs["verdict_lines"] = json.dumps(noun.verdict_lines)
    statistics.attrs["coverage"] = float(noun.coverage)


def _optional(file: h5py.File, path: str, kind: type[T]) -> T | None:
    """Return the record at a path, None where there is none."""
    return None if find(file, path) is None else read_record(file, path, kind)


def read_body(file: h5py.File) -> DeviationMap:
    """Return the map of a file.

    Raises
    ------
    MalformedInputError
        If something is missing or not as expected.
    """
    x = read_array(file, "/grid/x_mm", (None,), finite=True)
    y = read_array(file, "/grid/y_mm", (None,), finite=True)
    shape = (len(y), len(x))
    told = "method" in file["grid"].attrs  # older files say nothing of it
    ladder = json_attribute(file, "/statistics", "ladder")
    if is_older(file) and isinstance(ladder, list):
        ladder = [{"pvr_mm": math.nan, **rung} for rung in ladder if isinstance(rung, dict)]
    where = where_of(file, "/statistics/@ladder")
    verdict = attribute(file, "/statistics", "verdict")
    if verdict not in set(Verdict):
        raise MalformedInputError(
            f"{verdict!r}",
            where=where_of(file, "/statistics/@verdict"),
            expected="pass, fail, undecided or none",
        )
    return DeviationMap(
        alignment=alignment_file.read_body(file),
        x_mm=x,
        y_mm=y,
        deviation_mm=read_array(file, "/grid/deviation_mm", shape),
        sag_deviation_mm=read_array(file, "/grid/sag_deviation_mm", shape),
        sigma_mm=read_array(file, "/grid/sigma_mm", shape),
        statistics=read_record(file, "/statistics/nodes", Statistics),
        point_statistics=read_record(file, "/statistics/points", Statistics),
        pvr_mm=attribute(file, "/statistics", "pvr_mm", float),
        u_rms_mm=attribute(file, "/statistics", "u_rms_mm", float),
        ladder=typed(ladder, tuple[LadderRung, ...], where),
        verdict=Verdict(verdict),
        spacing_mm=attribute(file, "/grid", "spacing_mm", float),
        coverage=attribute(file, "/statistics", "coverage", float),
        verdict_lines=typed(
            json_attribute(file, "/statistics", "verdict_lines"),
            tuple[str, ...],
            where_of(file, "/statistics/@verdict_lines"),
        ),
        method=attribute(file, "/grid", "method") if told else "",
        window_steps=attribute(file, "/grid", "window_steps", float) if told else 0.0,
        low_orders=_optional(file, "/low_orders", LowOrders),
        root_causes=_optional(file, "/root_causes", RootCauses),
        filter=_optional(file, "/filter", MapFilter),
        comparison=None if find(file, "/comparison") is None else read_comparison(file),
        spectrum=_optional(file, "/spectrum", Spectrum),
        numbers=_optional(file, "/numbers", MapNumbers),
        conformance=_optional(file, "/conformance", Conformance),
    )
