"""What the ball reaches: the envelope in place of the analytic offset, found cheaply and exactly.

The centre of a ball that touches the surface at p stands at ``o = p + r n``. It can stand there only if no
other place of the surface is nearer to o than r. Where that fails, the centre stays on the envelope, higher
up (`numerics.ball_envelope`), and the foot of the measured centre is another place.

Where to look. Take the vertical plane through p and another place q that the ball would meet. In it the
ball is a circle of radius <= r tangent to the profile at p; a profile that curves towards the ball by less
than 1/r everywhere between p and q stays below that circle. A profile's curvature is at most
``k sqrt(1 + slope^2)`` (k the largest curvature towards the probe, Meusnier). So the ball is held off only
if, within r of the centre, somewhere ``r k sqrt(1 + slope^2) >= 1``: a *tight* place. A nominal without
tight places is reached everywhere, and this is known from the curvatures at its nodes alone. (With a border
that is not convex the surface is taken to continue as smoothly across the gap.)
"""

from __future__ import annotations

from enum import IntEnum
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmm_align.numerics.ball_envelope import ball_rest
from cmm_align.numerics.chunked import in_threads
from cmm_align.surfaces.geometry import principal_curvatures
from cmm_align.surfaces.protocol import Array, Mask, Surface

CodeArray = NDArray[np.uint8]

NEARLY_TIGHT: Final = 0.95
"""Places count as tight from this share on: the tightest one may lie between two nodes."""
HELD_OFF_MM: Final = 1e-6
"""A ball held off by less than this still reaches: 1 nm."""

_RASTER: Final = 400
_DIRECTIONS: Final = 16
_ZOOMS: Final = 5


class Reach(IntEnum):
    """Whether the ball touches the nominal at a node."""

    REACHED = 0
    """It does, and the envelope is the analytic offset there."""
    EDGE = 1
    """It does, but an edge that stands a little proud is touched first."""
    SHADOWED = 2
    """It is held off by another part of the surface."""
    TIGHT = 3
    """The surface curves towards the probe more than the ball: ``r k >= 1``."""


class Reached(NamedTuple):
    """What the ball does at n nodes."""

    code: CodeArray
    """`Reach`, shape (n,)."""
    centre_mm: Array
    """Centre of the ball, shape (n, 3), mm, frame `surface`: ``p + r n`` where it reaches; elsewhere the
    point of the envelope over that, along the projection direction."""
    held_off_mm: Array
    """How far above ``p + r n`` that is, shape (n,), mm; 0 where the ball reaches."""


class InsideRaster(NamedTuple):
    """Which places of a raster belong to a surface."""

    x0_mm: float
    y0_mm: float
    step_mm: float
    inside: Mask
    """Shape (ny, nx)."""


class Tightest(NamedTuple):
    """Where a surface curves most towards the probe."""

    curvature_per_mm: float
    x_mm: float
    y_mm: float


def tight_places(points_mm: Array, concave_per_mm: Array, slope: Array, radius_mm: float) -> Array:
    """Return the places near which a ball may be held off.

    Parameters
    ----------
    points_mm : ndarray, shape (n, 3), mm, frame `surface`
        Nodes of the nominal.
    concave_per_mm : ndarray, shape (n,), 1/mm
        Largest curvature towards the probe.
    slope : ndarray, shape (n,)
        Dimensionless.
    radius_mm : float
        Tip radius, mm.

    Returns
    -------
    ndarray, shape (m, 2), mm
        Cells of r/8 that hold a tight node, by their centres; none for most optics.
    """
    rough = radius_mm * concave_per_mm
    if not float(rough.max()) * np.hypot(1.0, float(slope.max())) >= NEARLY_TIGHT:
        return np.empty((0, 2))
    tight = rough * np.sqrt(1.0 + slope**2) >= NEARLY_TIGHT
    cell = 0.125 * radius_mm
    result: Array = (np.unique(np.floor(points_mm[tight, :2] / cell), axis=0) + 0.5) * cell
    return result


def reach(
    surface: Surface,
    side: int,
    radius_mm: float,
    points_mm: Array,
    normals: Array,
    concave_per_mm: Array,
    tight_mm: Array,
    edge_proud_mm: float,
    pitch_mm: float = 0.0,
) -> Reached:
    """Return what the ball does at places of a nominal.

    Parameters
    ----------
    surface : Surface
    side : int
        +1 or -1, the probe's side.
    radius_mm : float
        Tip radius, mm.
    points_mm, normals : ndarray, shape (n, 3), mm, frame `surface`
        Places on the nominal and their unit normals towards the probe.
    concave_per_mm : ndarray, shape (n,), 1/mm
        Largest curvature towards the probe.
    tight_mm : ndarray, shape (m, 2), mm
        From `tight_places`.
    edge_proud_mm : float
        Height of an edge above the nominal that must not be touched first, mm.
    pitch_mm : float
        Distance of the nodes that `tight_mm` was found from, mm.
    """
    centre = points_mm + radius_mm * normals
    code = np.zeros(len(points_mm), dtype=np.uint8)
    held_off = np.zeros(len(points_mm))
    band = edge_band_mm(radius_mm, concave_per_mm, edge_proud_mm)
    code[near_edge(surface, points_mm[:, 0], points_mm[:, 1], band)] = Reach.EDGE
    if len(tight_mm):
        margin = radius_mm * (1.0 + 0.125) + pitch_mm
        from scipy.spatial import cKDTree  # slow to import

        gap, _ = cKDTree(tight_mm).query(centre[:, :2], distance_upper_bound=margin)
        k = np.flatnonzero(gap < margin)
        rest = ball_rest(
            surface.jet, surface.contains, side, radius_mm, centre[k, 0], centre[k, 1], points_mm[k, :2]
        )
        lift = side * (rest.height_mm - centre[k, 2])
        held = lift > HELD_OFF_MM
        code[k[held]] = Reach.SHADOWED
        held_off[k[held]] = lift[held]
        centre[k[held], 2] = rest.height_mm[held]
        code[radius_mm * concave_per_mm >= 1.0] = Reach.TIGHT
    return Reached(code, centre, held_off)


def edge_band_mm(radius_mm: float, concave_per_mm: Array, edge_proud_mm: float) -> Array:
    """Return how far from the edge a contact must lie, shape (n,), mm.

    A ball that touches at p clears the surface at distance d by ``d^2 (1/r - k) / 2``; an edge that stands
    proud by h is touched first within ``d = sqrt(2 r h / (1 - r k))``, at most the tip radius.

    Parameters
    ----------
    radius_mm : float
        Tip radius, mm.
    concave_per_mm : ndarray, shape (n,), 1/mm
        Largest curvature towards the probe: the widest band of all directions.
    edge_proud_mm : float
        Height of the edge above the nominal (burr, roll-off of the ball's seat, misplaced part), mm.
    """
    room = np.maximum(1.0 - radius_mm * concave_per_mm, 1e-12)
    result: Array = np.minimum(np.sqrt(2.0 * radius_mm * edge_proud_mm / room), radius_mm)
    return result


def inside_raster(surface: Surface) -> InsideRaster:
    """Return which places of a raster over a surface belong to it, for `near_edge`."""
    b = surface.bounds
    step = max(b.x_max - b.x_min, b.y_max - b.y_min) / _RASTER
    xs, ys = np.arange(b.x_min, b.x_max + step, step), np.arange(b.y_min, b.y_max + step, step)
    px, py = np.meshgrid(xs, ys)
    return InsideRaster(b.x_min, b.y_min, step, surface.contains(px.ravel(), py.ravel()).reshape(px.shape))


def near_edge(
    surface: Surface, x_mm: Array, y_mm: Array, width_mm: Array, raster: InsideRaster | None = None
) -> Mask:
    """Return which places lie within a width of the border of a surface.

    Parameters
    ----------
    surface : Surface
    x_mm, y_mm : ndarray, shape (n,), mm, frame `surface`
    width_mm : ndarray, shape (n,), mm
    raster : InsideRaster, optional
        Of the same surface, where it is made already.
    """
    near = np.zeros(len(x_mm), dtype=bool)
    widest = float(width_mm.max(initial=0.0))
    if widest <= 0.0:
        return near
    k = np.flatnonzero(_may_be_near(raster or inside_raster(surface), widest, x_mm, y_mm))
    x, y, width = x_mm[k], y_mm[k], width_mm[k]
    for angle in 2.0 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS:
        holds = surface.contains(x + width * np.cos(angle), y + width * np.sin(angle))
        if not holds.all():
            near[k[~holds]] = True
            k, x, y, width = k[holds], x[holds], y[holds], width[holds]
    return near


def _may_be_near(raster: InsideRaster, width_mm: float, x_mm: Array, y_mm: Array) -> Mask:
    """Return the places around which the raster is not inside everywhere, two steps past the width."""
    ny, nx = raster.inside.shape
    m = int(np.ceil(width_mm / raster.step_mm)) + 2
    outside = np.zeros((ny + 2 * m + 1, nx + 2 * m + 1), dtype=np.int32)
    outside[1:, 1:] = 1
    outside[m + 1 : m + 1 + ny, m + 1 : m + 1 + nx] = ~raster.inside
    sums = outside.cumsum(axis=0).cumsum(axis=1)  # how many are outside in a square, by its corners
    w = 2 * m + 1
    unclear = (sums[w:, w:] - sums[:-w, w:] - sums[w:, :-w] + sums[:-w, :-w] > 0).ravel()
    found = np.empty(len(x_mm), dtype=bool)

    def work(part: slice) -> None:
        u = (x_mm[part] - raster.x0_mm) / raster.step_mm + 0.5
        v = (y_mm[part] - raster.y0_mm) / raster.step_mm + 0.5
        ix = np.minimum(np.maximum(u, 0.0), nx - 0.5).astype(np.intp)
        iy = np.minimum(np.maximum(v, 0.0), ny - 0.5).astype(np.intp)
        found[part] = unclear.take(iy * nx + ix)

    in_threads(work, len(x_mm))
    return found


def tightest(
    surface: Surface, side: int, points_mm: Array, concave_per_mm: Array, pitch_mm: float
) -> Tightest:
    """Return the largest curvature towards the probe, looked for around the tightest node.

    Parameters
    ----------
    surface : Surface
    side : int
    points_mm : ndarray, shape (n, 3), mm, frame `surface`
    concave_per_mm : ndarray, shape (n,), 1/mm
    pitch_mm : float
        Distance of the nodes, mm.
    """
    k = int(np.argmax(concave_per_mm))
    best = Tightest(float(concave_per_mm[k]), float(points_mm[k, 0]), float(points_mm[k, 1]))
    span = pitch_mm
    for _ in range(_ZOOMS):
        u, v = (a.ravel() for a in np.meshgrid(*(np.linspace(-span, span, 9),) * 2))
        x, y = best.x_mm + u, best.y_mm + v
        inside = surface.contains(x, y)
        most = principal_curvatures(surface.jet(x[inside], y[inside]), side).most
        if len(most) and float(np.nanmax(most)) > best.curvature_per_mm:
            at = int(np.nanargmax(most))
            best = Tightest(float(most[at]), float(x[inside][at]), float(y[inside][at]))
        span *= 0.3
    return best
