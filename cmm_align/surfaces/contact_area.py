"""The area of the nominal that each foot point stands for: weights that no uneven scan can bias.

A plain mean over points counts a patch scanned ten times as densely ten times. With the areas a_i of this
module ``sum(a_i f(x_i))`` is a quadrature of f over the measured part of the surface instead.

1. Feet that all but coincide become one place and share its area.
2. The places are triangulated in the projection. A place has the cell of all that is nearer to it than to
   any other place (Voronoi); cells depend on the places alone, where triangles are a matter of chance on a
   grid, which has two diagonals to choose from. At the outline the cells are cut off by halves.
3. What was not measured belongs to nobody: the inside of the outline only, and no wide holes.
4. The area on the surface is the projected one over ``|n_z|``.

Wide holes. The circle through the corners of a Delaunay triangle holds no other place. The *gap* at a place
is the largest such circle through it. A circle is wide if it is more than `WIDEST` times as large as the
gaps beside it (the least gap among the neighbours of a corner, of the corner with most), and as the usual
gap of the whole cloud. A triangle with a wide circle is left out if the middle of that circle lies in such a
triangle too, or outside. Places at the rim of a hole have neighbours with narrow gaps; between scan lines,
and between the places of a sparse scan beside a dense one, all gaps are alike. The usual gap speaks where
each line was scanned several times. Every place keeps a triangle, so no area is zero.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from cmm_align.errors import GeometryError
from cmm_align.numerics.point_density import filled_box
from cmm_align.numerics.triangle_net import triangle_net
from cmm_align.surfaces.protocol import Array, Mask
from cmm_align.surfaces.triangulation import Index, delaunay_triangles

MOST_PLACES: Final = 200_000
"""More feet than this are gathered in boxes first: about a fifth of the time for 1.2e6 feet."""
SAME_PLACE: Final = 0.01
"""Feet within a box of this share of their mean distance are one place: a touch that was repeated."""
WIDEST: Final = 3.0
"""A hole is this many times as wide as the gaps next to it and as the usual ones."""
COARSEST: Final = 0.1
"""The usual gap is at most this share of the shorter side."""
THINNEST: Final = 1e-7
"""A cloud whose width is a smaller share of its length is a line."""

_GOLDEN: Final = 0.6180339887498949


def contact_areas(x_mm: Array, y_mm: Array, normals: Array, *, most_places: int = MOST_PLACES) -> Array:
    """Return the area of the nominal that each foot point stands for.

    Parameters
    ----------
    x_mm, y_mm : ndarray, shape (n,), mm, frame `surface`
        Feet of the measured points on the nominal, in any order.
    normals : ndarray, shape (n, 3), frame `surface`
        Unit normals of the nominal there, to either side.
    most_places : int
        Feet beyond this number are gathered in as many square boxes, those of a box sharing its area.

    Returns
    -------
    ndarray, shape (n,), mm^2
        Above zero. Their sum is the area of the measured part of the nominal.

    Raises
    ------
    GeometryError
        If a foot is not finite, or all lie on one line.

    Notes
    -----
    Accuracy tested: of second order in the distance of the feet, and in the size of the boxes where there
    are more feet than `most_places`. Areas of a triangle's corners: Meyer, Desbrun, Schroeder and Barr 2003,
    "Discrete differential-geometry operators for triangulated 2-manifolds", section 3.3,
    doi 10.1007/978-3-662-05105-4_2.
    """
    if not (np.isfinite(x_mm).all() and np.isfinite(y_mm).all()):
        raise GeometryError("a foot point is not finite", expected="points that lie on the nominal")
    place, x, y = _places(x_mm, y_mm, most_places)
    across, along = np.linalg.eigvalsh(np.cov(x, y)) if len(x) > 2 else (0.0, 0.0)
    if across <= THINNEST**2 * along:
        raise GeometryError(
            "the points lie on one line: there is no area to share",
            remedy="measure a second line, or leave the weighting by area out",
        )
    share = _cell_areas(x, y, delaunay_triangles(x, y)) / np.bincount(place)
    result: Array = share[place] / np.abs(normals[:, 2])
    return result


def _places(x: Array, y: Array, most: int) -> tuple[NDArray[np.intp], Array, Array]:
    """Return the place of each foot, and the middle of the feet of each place."""
    x0, y0 = float(x.min()), float(y.min())
    area = float(np.ptp(x)) * float(np.ptp(y))
    box = float(np.sqrt(area / most)) if len(x) > most else SAME_PLACE * float(np.sqrt(area / len(x)))
    box = max(box, 1e-9 * float(max(np.ptp(x), np.ptp(y))), 1e-300)
    # No border of a box falls on a regular grid, where rounding would choose the box.
    ix, iy = (np.floor((v - v0) / box + _GOLDEN).astype(np.int64) for v, v0 in ((x, x0), (y, y0)))
    place: NDArray[np.intp]
    _, place = np.unique(iy * (int(ix.max()) + 1) + ix, return_inverse=True)
    count = np.bincount(place)
    return place, x0 + np.bincount(place, x - x0) / count, y0 + np.bincount(place, y - y0) / count


def _cell_areas(x: Array, y: Array, triangles: Index) -> Array:
    """Return the projected area of the cell of each place, shape (n,)."""
    across, twice = _edges(x, y, triangles)
    solid = twice > 0.0
    triangles, across, twice = triangles[solid], across[solid], twice[solid]
    with np.errstate(over="ignore"):  # slivers of rounding: wider than anything
        circle = np.sqrt(across.prod(axis=1)) / (2.0 * twice)
    # Squared edges a, b, c opposite the corners: cot A = (b + c - a) / (4 area).
    cotangent = (across.sum(axis=1, keepdims=True) - 2.0 * across) / (2.0 * twice[:, None])
    part = across * cotangent / 8.0  # between an edge and the centre of the circle, for one of its ends
    nearer = part[:, [1, 2, 0]] + part[:, [2, 0, 1]]
    blunt = cotangent < 0.0
    quarter = 0.125 * twice[:, None] * (1.0 + blunt)
    within = np.where(blunt.any(axis=1, keepdims=True), quarter, nearer)

    # The way to the centre of the circle leads over the side opposite a blunt corner, and on from there.
    neighbours = triangle_net(np.stack([x, y, np.zeros_like(x)], axis=1), triangles).neighbours
    leads = blunt.any(axis=1)
    over = np.where(leads, neighbours[np.arange(len(blunt)), blunt.argmax(axis=1)], -1)
    wide = _wide(x, y, triangles, circle)
    unmeasured = _all_the_way(wide & (over < 0), wide, over)
    beyond = _all_the_way(leads & ((over < 0) | unmeasured[over]), leads, over)
    outside = np.zeros(len(x), dtype=bool)
    outside[triangles[beyond & ~unmeasured]] = True
    areas = np.where(outside[triangles], within, nearer)[~unmeasured]
    places = triangles[~unmeasured].ravel()
    return np.asarray(np.bincount(places, areas.ravel(), minlength=len(x)), dtype=np.float64)


def _all_the_way(found: Mask, through: Mask, over: Index) -> Mask:
    """Return the triangles found, and those `through` which the way leads to one of them; shape (m,)."""
    through = through & (over >= 0)
    while True:
        more = found | (through & found[over])
        if np.array_equal(more, found):
            return found
        found = more


def _edges(x: Array, y: Array, triangles: Index) -> tuple[Array, Array]:
    """Return the squared edges opposite the corners, shape (m, 3), and twice the areas, shape (m,)."""
    px, py = x[triangles], y[triangles]
    ex, ey = (p[:, [2, 0, 1]] - p[:, [1, 2, 0]] for p in (px, py))
    return ex**2 + ey**2, ex[:, 0] * ey[:, 1] - ey[:, 0] * ex[:, 1]


def _wide(x: Array, y: Array, triangles: Index, circle: Array) -> Mask:
    """Return which triangles have circles, of radii of shape (m,), too large for a gap between places."""
    gap, beside = np.zeros(len(x)), np.full(len(x), np.inf)
    flat = triangles.ravel()
    np.maximum.at(gap, flat, np.repeat(circle, 3))
    np.minimum.at(beside, flat, np.repeat(gap[triangles].min(axis=1), 3))
    sides = float(np.ptp(x)), float(np.ptp(y))
    finest = 0.5 * float(np.sqrt(sides[0] * sides[1] / len(x)))
    usual = float(np.sqrt(0.5)) * filled_box(x, y, finest, COARSEST * min(sides))
    wide: Mask = circle > WIDEST * np.maximum(beside[triangles].max(axis=1), usual)
    return wide
