"""What changed since an earlier measurement, as a group in the file of a map."""

from __future__ import annotations

from cmm_align.io.hdf5_library import h5py
from cmm_align.io.records import read_record, write_record
from cmm_align.io.safe_hdf5 import read_array
from cmm_align.io.writing import write_array
from cmm_align.model import Change, Comparison


def write_comparison(file: h5py.File, comparison: Comparison) -> None:
    """Write a comparison to the group `/comparison`, its numbers to `/comparison/change`."""
    group = file.create_group("comparison")
    for name in ("x_mm", "y_mm", "before_mm", "after_mm", "u_mm", "changed"):
        write_array(group, name, getattr(comparison, name))
    write_record(group.create_group("change"), comparison.change)


def read_comparison(file: h5py.File) -> Comparison:
    """Return the comparison of a file.

    Raises
    ------
    MalformedInputError
        If something is missing or not as expected.
    """
    x = read_array(file, "/comparison/x_mm", (None,), finite=True)
    y = read_array(file, "/comparison/y_mm", (None,), finite=True)
    shape = (len(y), len(x))
    return Comparison(
        x_mm=x,
        y_mm=y,
        before_mm=read_array(file, "/comparison/before_mm", shape),
        after_mm=read_array(file, "/comparison/after_mm", shape),
        u_mm=read_array(file, "/comparison/u_mm", shape),
        changed=read_array(file, "/comparison/changed", shape, "b"),
        change=read_record(file, "/comparison/change", Change),
    )
