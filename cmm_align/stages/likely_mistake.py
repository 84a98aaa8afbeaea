"""Which mistake explains a file best: a few hypotheses, each tried on some of its points.

A hypothesis changes the points back (axes swapped, mirrored, another frame, another unit) or changes what
the file should say (the sign of the correction, its normal part written as dz, a pass left out). It
explains the file if what is left is a small share of the correction and of what was left without it.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cmm_align.numerics.grid_field import carried_on
from cmm_align.pose import Pose
from cmm_align.stages.told_surface import Found, ToldSurface
from cmm_align.surfaces.protocol import Array
from cmm_align.units import mm_per

SAMPLE: Final = 4000
"""Points that the hypotheses are tried on."""
EXPLAINS: Final = 0.05
"""Share of the sum of all corrections that may be left."""
BETTER: Final = 0.2
"""Share of what was off before that may be left."""
ON_SURFACE: Final = 0.98
"""Share of the points that must lie over the aperture."""

_AXES: Final = "xyz"


def likely_mistake(
    told: ToldSurface,
    found: Found,
    points_mm: Array | None,
    surface_from_file: Pose,
    other_frames: dict[str, Pose],
    this_pass_mm: Array,
) -> str:
    """Return what a file looks like, as ``x and y swapped``; empty if nothing explains it.

    Parameters
    ----------
    told : ToldSurface
    found : Found
        All points of the file.
    points_mm : ndarray, shape (n, 3), mm, or None
        The same as they stand in the file; None for a field, which has no frame to be wrong.
    surface_from_file : Pose
    other_frames : dict of str to Pose
        ``surface_from_file`` if the file were in another frame, by what to call that.
    this_pass_mm : ndarray, shape (ny, nx), mm
        The correction of this pass on the grid.
    """
    some = np.unique(np.linspace(0, len(found.x_mm) - 1, SAMPLE).astype(np.intp))
    size = float(np.sqrt(np.nanmean(told.total_mm**2)))
    before = _left(found.total_mm[some], found.told_mm[some])
    tried = dict(_values(told, found, some, this_pass_mm))
    if points_mm is not None:
        for words, moved in _places(points_mm[some], surface_from_file, other_frames):
            there = told.found(moved)
            tried[words] = _left(there.total_mm, there.told_mm)
    words, left = min(tried.items(), key=lambda item: item[1])
    return words if left < min(EXPLAINS * size, BETTER * before) else ""


def _left(total: Array, told: Array) -> float:
    """Return the RMS of what is off; infinite if too many points lie beside the aperture."""
    known = np.isfinite(total) & np.isfinite(told)
    if float(np.mean(known)) < ON_SURFACE:
        return float("inf")
    return float(np.sqrt(np.mean((total - told)[known] ** 2)))


def _values(
    told: ToldSurface, found: Found, some: NDArray[np.intp], this_pass_mm: Array
) -> Iterator[tuple[str, float]]:
    """Give what is left if the file should say something else along the normal."""
    total, right = found.total_mm[some], found.told_mm[some]
    now = told.at(carried_on(this_pass_mm, 1), found.x_mm[some], found.y_mm[some])
    first_pass = np.nanmax(np.abs(right - now), initial=0.0) < mm_per("nm")
    steep = np.abs(found.n_z[some])
    earlier = () if first_pass else (("a correction without those of the earlier passes", now),)
    for words, other in (
        *earlier,
        ("the wrong sign of the correction", right - 2.0 * now),
        ("the wrong sign of all corrections", -right),
        ("e_n written as dz", right * steep),
        ("a normal correction divided by n_z twice", right / steep),
        ("a file without the correction of this pass", right - now),
        ("the nominal, with no correction at all", 0.0 * right),
        ("a correction applied twice", right + now),
        ("the wrong sign of the correction and e_n written as dz", -right * steep),
    ):
        yield words, _left(total, other)


def _places(
    points_mm: Array, surface_from_file: Pose, other_frames: dict[str, Pose]
) -> Iterator[tuple[str, Array]]:
    """Give the points, frame `surface`, as they would be without a mistake."""
    for first, second in ((0, 1), (0, 2), (1, 2)):
        order = [0, 1, 2]
        order[first], order[second] = second, first
        swapped = points_mm[:, order]
        words = f"{_AXES[first]} and {_AXES[second]} swapped"
        yield words, surface_from_file.apply(swapped)
        for k in (first, second):
            sign = np.where(np.arange(3) == k, -1.0, 1.0)
            yield f"{words} and {_AXES[k]} mirrored", surface_from_file.apply(swapped * sign)
    for name, signs in (
        ("x mirrored", (-1, 1, 1)),
        ("y mirrored", (1, -1, 1)),
        ("z with the wrong sign", (1, 1, -1)),
        ("a part turned by 180 degrees about z", (-1, -1, 1)),
        ("a part turned by 180 degrees about x", (1, -1, -1)),
        ("a part turned by 180 degrees about y", (-1, 1, -1)),
    ):
        yield name, surface_from_file.apply(points_mm * np.array(signs, dtype=np.float64))
    for name, unit in (("inches", "inch"), ("um", "um"), ("metres", "m")):
        yield f"lengths in {name}", surface_from_file.apply(points_mm * mm_per(unit))
    for name, pose in other_frames.items():
        yield name, pose.apply(points_mm)
