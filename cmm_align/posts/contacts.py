"""From tool centres back to the surface: what a program would grind, found from its numbers alone.

The surface on which the tool centres lie has the normal of the part at the contacts (`numerics.wheel`), so
the wheel is taken off along the normal of the path itself. Where the lines of a path lie beside each other
like the rows of a net, its two tangents are central differences of sixth order; elsewhere (borders, spirals)
the normal is that of a cubic through the neighbours. A normal that is wrong by d moves the contact
across the surface, and off it by ``R d^2 / 2`` only.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmm_align.numerics.local_normals import local_cubic_normals
from cmm_align.numerics.wheel import Wheel, centre_from_contact
from cmm_align.surfaces.protocol import Array

IntArray = NDArray[np.int64]
Mask = NDArray[np.bool_]

_REACH: Final = 3
_WEIGHTS: Final = (45.0 / 60.0, -9.0 / 60.0, 1.0 / 60.0)
_UNEVEN: Final = 0.05
"""Steps of a net that change by more than this share are no even steps."""
_NEIGHBOURS: Final = 28
_MORE_NEIGHBOURS: Final = 56
_SAMPLE: Final = 400
_MORE: Final = 4000
_UNSEEN: Final = 2.0
"""Where a sample is judged, the worst of all points may be worse than that of the sample."""


class Contacts(NamedTuple):
    """Contacts recovered from n tool centres."""

    points_mm: Array
    """Shape (n, 3), mm."""
    normals: Array
    """Shape (n, 3), out of the material."""
    error_mm: float
    """Estimated largest error along the normal."""


def contacts(centres_mm: Array, starts: IntArray, wheel: Wheel, outward: Array) -> Contacts:
    """Take the wheel off a path.

    Parameters
    ----------
    centres_mm : ndarray, shape (n, 3), mm
        Tool centres in the order of the path.
    starts : ndarray, shape (k,)
        First point of each stroke.
    wheel : Wheel
        Axis in the frame of the centres.
    outward : ndarray, shape (3,)
        A direction out of the material, as the one in which the tool is lifted.

    Returns
    -------
    Contacts
        Tested against the exact contacts; the error of the normals is judged by a second, wider fit.

    Raises
    ------
    GeometryError
        If there are too few points, or a torus would touch with its flat face.
    """
    normals, found = _of_net(centres_mm, starts)
    cloud = _thinned(centres_mm, outward)
    if not found.all():
        normals[~found] = local_cubic_normals(cloud, _NEIGHBOURS, centres_mm[~found])
    normals[normals @ outward < 0.0] *= -1.0
    some = np.concatenate([_some(np.flatnonzero(found), _SAMPLE), _some(np.flatnonzero(~found), _MORE)])
    second = local_cubic_normals(cloud, min(_MORE_NEIGHBOURS, len(cloud)), centres_mm[some])
    away = np.linalg.norm(np.cross(second, normals[some]), axis=1)
    # A neighbourhood of twice the area errs 2^1.5 times as much: the difference is more than the error.
    return Contacts(
        centres_mm - centre_from_contact(wheel, normals),
        normals,
        0.5 * wheel.radius_mm * float(away.max()) ** 2 * (1.0 if len(some) == len(centres_mm) else _UNSEEN),
    )


def _of_net(centres: Array, starts: IntArray) -> tuple[Array, Mask]:
    """Return the normals of points whose strokes lie beside each other, and which those are."""
    normals, found = np.full_like(centres, np.nan), np.zeros(len(centres), np.bool_)
    bounds = [*starts.tolist(), len(centres)]
    if len(starts) < 2 * _REACH + 1:
        return normals, found
    rows: list[IntArray] = []
    offsets = [0]
    for first, end in pairwise(bounds):
        row = np.arange(first, end)
        if rows:
            before = centres[rows[-1]]
            if (centres[row[-1]] - centres[row[0]]) @ (before[-1] - before[0]) < 0.0:
                row = row[::-1]
            middle = len(row) // 2
            nearest = int(np.argmin(np.sum((before - centres[row[middle]]) ** 2, axis=1)))
            offsets.append(offsets[-1] + nearest - middle)
        rows.append(row)
    left = min(offsets)
    width = max(o + len(r) for o, r in zip(offsets, rows, strict=True)) - left
    if len(rows) * width > 4 * len(centres) + 1000:
        return normals, found
    net = np.full((len(rows), width), -1)
    for j, (row, offset) in enumerate(zip(rows, offsets, strict=True)):
        net[j, offset - left : offset - left + len(row)] = row
    known = net >= 0
    grid = np.where(known[..., None], centres[net], np.nan)
    along, across = _difference(grid, 1), _difference(grid, 0)
    normal = np.cross(along, across)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    good = known & np.isfinite(normal).all(axis=-1)
    normals[net[good]] = normal[good]
    found[net[good]] = True
    return normals, found


def _difference(grid: Array, axis: int) -> Array:
    """Return central differences of sixth order, NaN where there are no even steps on both sides."""
    moved = np.moveaxis(grid, axis, 0)
    out = np.full_like(moved, np.nan)
    n = len(moved)
    if n < 2 * _REACH + 1:
        return grid * np.nan
    inner = slice(_REACH, n - _REACH)
    out[inner] = 0.0
    for k, weight in enumerate(_WEIGHTS, 1):
        out[inner] += weight * (moved[_REACH + k : n - _REACH + k] - moved[_REACH - k : n - _REACH - k])
    step = np.linalg.norm(np.diff(moved, axis=0), axis=-1)
    uneven = np.abs(np.diff(step, axis=0)) > _UNEVEN * step[1:]
    for k in range(2 * _REACH - 1):
        out[inner][uneven[k : k + n - 2 * _REACH]] = np.nan
    return np.moveaxis(out, 0, axis)


def _some(numbers: NDArray[np.intp], most: int) -> NDArray[np.intp]:
    """Return so many of the numbers at most, evenly spread."""
    return numbers[np.unique(np.linspace(0, len(numbers) - 1, min(most, len(numbers))).astype(np.intp))]


def _thinned(centres: Array, outward: Array) -> Array:
    """Return one of several points, so that neighbours are as near across the path as along it."""
    from scipy.spatial import ConvexHull  # slow to import

    up = outward / np.linalg.norm(outward)
    flat = np.linalg.svd(up[None, :])[2][1:]
    along = float(np.median(np.linalg.norm(np.diff(centres, axis=0), axis=1)))
    area = float(ConvexHull(centres @ flat.T).volume)
    across = area / (len(centres) * along)
    every = int(np.clip(round(across / along), 1, max(1, len(centres) // 200)))
    return centres[::every]
