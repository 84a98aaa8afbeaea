"""How often the facets of a mesh cover each cell of a net: where it has holes, and where it lies double."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_PAIRS: Final = 4_000_000
"""Facets and cells looked at together."""
_STRICT: Final = 1e-9
"""A centre within this share of a facet's border is on it, and belongs to its neighbour as well."""


def cover_of_cells(
    xy_mm: Array, triangles: NDArray[np.int32], low: Array, pitch: Array, shape: tuple[int, int]
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Count the facets over the centre of each cell.

    Parameters
    ----------
    xy_mm : ndarray, shape (n, 2), mm
        Vertices over the plane.
    triangles : ndarray of int32, shape (m, 3)
        Counter-clockwise.
    low : ndarray, shape (2,), mm
        Lower left corner of the net.
    pitch : ndarray, shape (2,), mm
        Size of a cell.
    shape : tuple of int
        (ny, nx) cells.

    Returns
    -------
    strictly, touching : ndarray of int32, shape (ny, nx)
        Facets that hold the centre inside, and inside or on their border.
    """
    ny, nx = shape
    strictly, touching = (np.zeros(ny * nx, dtype=np.int32) for _ in range(2))
    place = (xy_mm - low) / pitch - 0.5  # in cells; centres have whole numbers
    corner = place[triangles]
    lowest = np.maximum(np.ceil(corner.min(axis=1) - 1e-6).astype(np.int64), 0)
    highest = np.minimum(np.floor(corner.max(axis=1) + 1e-6).astype(np.int64), (nx - 1, ny - 1))
    wide, tall = np.maximum(highest - lowest + 1, 0).T
    pairs = wide * tall
    steps = np.concatenate([[0], np.cumsum(pairs)])
    first = 0
    while first < len(triangles):
        last = max(first + 1, int(np.searchsorted(steps, steps[first] + _PAIRS, side="right")) - 1)
        part = np.arange(first, last)
        facet = np.repeat(part, pairs[part])
        inner = np.arange(len(facet)) - (steps[facet] - steps[first])
        ix = lowest[facet, 0] + inner % np.maximum(wide[facet], 1)
        iy = lowest[facet, 1] + inner // np.maximum(wide[facet], 1)
        least = _least_share(corner[facet], ix, iy)
        cell = iy * nx + ix
        strictly += np.bincount(cell[least > _STRICT], minlength=ny * nx).astype(np.int32)
        touching += np.bincount(cell[least >= -_STRICT], minlength=ny * nx).astype(np.int32)
        first = last
    return strictly.reshape(shape), touching.reshape(shape)


def _least_share(corner: Array, ix: NDArray[np.int64], iy: NDArray[np.int64]) -> Array:
    """Return the smallest barycentric coordinate of each centre in its facet."""
    a, b, c = corner[:, 0], corner[:, 1], corner[:, 2]
    twice = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    p = np.stack([ix, iy], axis=1).astype(np.float64)
    least = np.full(len(p), np.inf)
    for one, other in ((a, b), (b, c), (c, a)):
        share = (other[:, 0] - one[:, 0]) * (p[:, 1] - one[:, 1]) - (other[:, 1] - one[:, 1]) * (
            p[:, 0] - one[:, 0]
        )
        least = np.minimum(least, share)
    return least / np.maximum(twice, 1e-300)
