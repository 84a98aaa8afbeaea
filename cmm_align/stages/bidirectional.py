"""The bidirectional check: the measured cloud triangulated in turn, and the nominal measured against it.

Third step of the source paper (Photonics 2025, 12(5), 469, doi 10.3390/photonics12050469, section 2).

1. Triangulate the projection of the measured tip centres where `align` has laid them.
2. Take nodes on a grid over the measured region, each one tip radius out from the nominal, and measure them
   to the facets of the cloud; turn the sign, so that excess material is positive again.
3. Compare with the forward deviations at the same nodes.
4. Lay the nominal on the cloud. At the best pose it should hardly move.

*What may differ.* At a place with barycentric coordinates b in a facet, a surface lies
``1/2 sum b_i b_j (n_j - n_i) . (v_j - v_i)`` over the facet through its points v with normals n (exact for
quadratics: the remainder of linear interpolation); for a square net of step h on curvature k that is at most
``h^2 k / 4``. Facets are also tilted against the nominal, and a distance along another normal is another
distance. Noise is in the same vertices in both directions, so it drops out of the difference.

*How far the nominal may move.* The forward fit balances the deviations of the points, the reverse one those
of the nodes, and facets pull at it. Let g be the forward deviations less the rigid motion that explains most
of them (none at the best pose): the reverse fit then finds the motion that explains most of g, of the facets
and of their tilt at the nodes. What it finds beyond that is what the alignment has left, but for what is not
linear: the tilt of the facets in the deviations and in the motion. Least squares project, which makes none
of it larger.

Contact points are triangulated as they are and measured against the nominal itself.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmm_align.errors import GeometryError
from cmm_align.model import MIN_POINTS, Alignment, FitReport
from cmm_align.model.bidirectional import Bidirectional
from cmm_align.numerics.fit_steps import FitSettings
from cmm_align.numerics.foot_point import Feet
from cmm_align.numerics.linearisation import Measure, Placement, even_sample, rows_of
from cmm_align.numerics.observability import solve_observable, spectrum
from cmm_align.numerics.rigid_fit import fit
from cmm_align.numerics.rotations import vector_from_rotation
from cmm_align.numerics.triangle_net import TriangleNet, facet_distance, locate, triangle_net
from cmm_align.stages.deviation_statistics import deviation_statistics
from cmm_align.stages.way import COARSE_OBSERVABILITY
from cmm_align.surfaces.geometry import unit_normal
from cmm_align.surfaces.protocol import Array, Mask, Surface
from cmm_align.surfaces.triangulation import delaunay_triangles
from cmm_align.units import UM_PER_MM, URAD_PER_RAD

MOST_POINTS: Final = 200_000
"""Of more points an even sample is triangulated."""
NODES: Final = 40_000
"""Nodes of the nominal that are measured, about; no more than points."""
SLIVER: Final = 4.0
"""Facets with an edge this many times the usual one span the hull or a gap."""
ROUNDING: Final = 1e-13
"""Differences below this share of the size are rounding."""
LEAST_OBSERVABLE: Final = 1e-8
"""Motions below this share of the strongest one are not told by the data."""
_TOLERANCE: Final = 1e-9
_ITERATIONS: Final = 50
_LARGEST_TURN_RAD: Final = 0.5
_FLAT: Final = 1e-9


class _Cloud(NamedTuple):
    """The triangulated points, frame `surface`."""

    net: TriangleNet
    kept: Mask
    """Facets that are neither slivers nor gaps."""
    normals: Array
    """Of the nominal under each point, shape (n, 3)."""
    deviation_mm: Array
    number: NDArray[np.intp]
    """Of each point in the alignment."""


class _Nodes(NamedTuple):
    """Nodes of the nominal under facets, frame `surface`, shape (m, ...)."""

    points_mm: Array
    normals: Array
    triangle: NDArray[np.int32]
    share: Array
    """Barycentric coordinates in the facet, shape (m, 3)."""
    covered: float


class _Compared(NamedTuple):
    """Both directions at the nodes, each of shape (m,), mm, unless said otherwise."""

    backward: Array
    interpolated: Array
    facets: Array
    """How far the nominal lies over facets through points on it."""
    tilt: Array
    """What the tilt of the facet against the nominal adds to a distance."""
    facet_normals: Array
    """Towards the probe, shape (m, 3)."""

    @property
    def difference(self) -> Array:
        return self.backward - self.interpolated

    @property
    def rest(self) -> Array:
        return self.difference + self.facets - self.tilt


class _Reverse(NamedTuple):
    """Small motions (w length, t) about the centroid of the nodes, frame `surface`, shape (6,), mm."""

    found: Array
    expected: Array
    beyond: Array
    allowed_rms_mm: float
    rows: Array
    """What each unit motion changes in the deviations, shape (6, m)."""
    centred: Array
    length_mm: float


def bidirectional(alignment: Alignment, *, best_fit: bool | None = None) -> Bidirectional:
    """Measure the nominal against the triangulated cloud and hold the result against the alignment's.

    Parameters
    ----------
    alignment : Alignment
        The points that steered it are triangulated: an outlier would stand as a spike in the facets.
    best_fit : bool, optional
        Whether the pose is meant to be that of plain least squares over these points. Without it, the report
        decides: weights, locked motions, datum terms or another criterion move a pose on purpose.

    Returns
    -------
    Bidirectional

    Raises
    ------
    GeometryError
        If the points span no area, or no node of the nominal lies under their facets.

    Notes
    -----
    Sign: a bump outwards is positive in both directions. Tested: without noise both agree within
    ``h^2 k / 4``; a part that is laid 20 um off is reported so, and the reverse motion is that offset.
    """
    nominal = alignment.nominal
    contact = np.array_equal(alignment.tip_centre_part_mm, alignment.contact_part_mm)
    counts = np.flatnonzero(alignment.used & np.isfinite(alignment.deviation_mm))
    cloud = _cloud(alignment, counts[even_sample(len(counts), MOST_POINTS)])
    nodes = _nodes(cloud, nominal.surface, nominal.side, 0.0 if contact else nominal.tip_radius_mm)
    compared = _compared(cloud, nodes, nominal.side)
    wanted = _meant_as_best_fit(alignment.report) if best_fit is None else best_fit
    reverse = _reversed(alignment, counts, cloud, nodes, compared, wanted)

    least = ROUNDING * nominal.surface.bounds.diagonal_mm
    explained = _rms(compared.facets) + _rms(compared.tilt) + least
    numbers = {
        "spacing_mm": float(np.sqrt(_area(cloud) / len(cloud.deviation_mm))),
        "difference_rms_mm": _rms(compared.difference),
        "facets_rms_mm": _rms(compared.facets),
        "rest_rms_mm": _rms(compared.rest),
        "reverse_edge_mm": _edge(reverse.found, reverse),
        "reverse_rms_mm": _rms(reverse.found @ reverse.rows),
        "expected_rms_mm": _rms(reverse.expected @ reverse.rows),
        "unexplained_edge_mm": _edge(reverse.beyond, reverse),
        "unexplained_rms_mm": _rms(reverse.beyond @ reverse.rows),
        "allowed_rms_mm": reverse.allowed_rms_mm,
    }
    agree = numbers["rest_rms_mm"] <= explained
    at_rest = numbers["unexplained_rms_mm"] <= reverse.allowed_rms_mm
    motion = np.stack([reverse.found[:3] / reverse.length_mm, reverse.found[3:]])
    turn, shift = nominal.surface_from_part.inverse().rotate(motion)
    points, (x, y) = cloud.net.points_mm, nodes.points_mm[:, :2].T
    return Bidirectional(
        forward=deviation_statistics(cloud.deviation_mm, points[:, 0], points[:, 1]),
        backward=deviation_statistics(compared.backward, x, y),
        interpolated=deviation_statistics(compared.interpolated, x, y),
        n_measured=len(counts),
        covered=nodes.covered,
        difference_mean_mm=float(compared.difference.mean()),
        facets_max_mm=float(np.abs(compared.facets).max()),
        reverse_translation_mm=_three(shift),
        reverse_rotation_rad=_three(turn),
        agree=agree,
        at_rest=at_rest,
        consistent=agree and at_rest,
        words=_in_words(numbers, turn, agree=agree, at_rest=at_rest),
        **numbers,
    )


def _meant_as_best_fit(report: FitReport) -> bool:
    """Return whether a fit was plain least squares over its points."""
    plain = report.criterion == "least-squares" and report.weights == "equal"
    return plain and not report.locked and report.n_fiducials == 0


def _cloud(alignment: Alignment, pick: NDArray[np.intp]) -> _Cloud:
    """Triangulate some points of an alignment over the projection plane."""
    turn = alignment.nominal.surface_from_part
    points = turn.apply(alignment.tip_centre_part_mm[pick])
    flat = points[:, :2] - points[:, :2].mean(axis=0) if len(points) else np.zeros((0, 2))
    spread = np.linalg.svd(flat, compute_uv=False)
    if len(points) < MIN_POINTS or float(spread[1]) <= _FLAT * float(spread[0]):
        raise GeometryError(
            f"the {len(points)} measured points cannot be triangulated",
            expected="points that span an area",
            remedy="measure the part in more than one line",
        )
    triangles = delaunay_triangles(points[:, 0], points[:, 1])
    corner = points[:, :2][triangles]
    longest = np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2).max(axis=1)
    return _Cloud(
        triangle_net(points, triangles),
        longest <= SLIVER * float(np.median(longest)),
        turn.rotate(alignment.normals[pick]),
        alignment.deviation_mm[pick],
        pick,
    )


def _nodes(cloud: _Cloud, surface: Surface, side: int, radius: float) -> _Nodes:
    """Lay a grid of nodes over the measured region; keep those under a facet."""
    feet = cloud.net.points_mm - (radius + cloud.deviation_mm)[:, None] * cloud.normals
    low, high = feet[:, :2].min(axis=0), feet[:, :2].max(axis=0)
    pitch = float(np.sqrt(np.prod(high - low) / min(NODES, len(feet))))
    x, y = (a + pitch * (0.5 + np.arange(int((b - a) / pitch))) for a, b in zip(low, high, strict=True))
    px, py = (a.ravel() for a in np.meshgrid(x, y))
    there = surface.contains(px, py)
    px, py = px[there], py[there]
    jet = surface.jet(px, py)
    normals = unit_normal(jet, side)
    points = np.stack([px, py, jet.z], axis=1) + radius * normals
    triangle, inside = locate(cloud.net, points[:, 0], points[:, 1])
    under = inside & cloud.kept[triangle]
    if np.count_nonzero(under) < MIN_POINTS:
        raise GeometryError(
            f"only {np.count_nonzero(under)} places of the nominal lie under a facet of the measured cloud",
            expected=f"at least {MIN_POINTS}",
            remedy="measure more points",
        )
    points, triangle = points[under], triangle[under]
    share = _barycentric(cloud.net, points, triangle)
    return _Nodes(points, normals[under], triangle, share, float(np.mean(under)))


def _barycentric(net: TriangleNet, points_mm: Array, triangle: NDArray[np.int32]) -> Array:
    """Return the barycentric coordinates over the plane of points in their facets, shape (m, 3)."""
    away = net.points_mm[net.triangles[triangle]][:, :, :2] - points_mm[:, None, :2]
    one, other = np.roll(away, -1, axis=1), np.roll(away, -2, axis=1)
    area = one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0]
    share: Array = area / area.sum(axis=1, keepdims=True)
    return share


def _facet_error(cloud: _Cloud, nodes: _Nodes, corners: NDArray[np.int32]) -> Array:
    """Return how far the surface lies over the facets through its points, shape (m,), mm."""
    v, n, b = cloud.net.points_mm[corners], cloud.normals[corners], nodes.share
    bends = np.einsum(
        "nkc,nkc->nk", np.roll(n, -1, axis=1) - n, np.roll(v, -1, axis=1) - v
    )  # curvature along each edge times its length squared
    result: Array = 0.5 * np.einsum("nk,nk,nk->n", b, np.roll(b, -1, axis=1), bends)
    return result


def _compared(cloud: _Cloud, nodes: _Nodes, side: int) -> _Compared:
    """Measure the nodes to their facets, and read the forward deviations there."""
    distance, normal = facet_distance(cloud.net, nodes.points_mm, nodes.triangle)
    backward = -side * distance
    corners = cloud.net.triangles[nodes.triangle]
    return _Compared(
        backward,
        np.einsum("nk,nk->n", nodes.share, cloud.deviation_mm[corners]),
        _facet_error(cloud, nodes, corners),
        backward * (1.0 - nodes.normals[:, 2] / (side * normal[:, 2])),
        side * normal,
    )


def _reversed(
    alignment: Alignment,
    counts: NDArray[np.intp],
    cloud: _Cloud,
    nodes: _Nodes,
    compared: _Compared,
    wanted: bool,
) -> _Reverse:
    """Lay the nodes on the cloud, and work out what motion that must come to."""
    nominal = alignment.nominal
    placement = Placement(np.eye(3), nodes.points_mm.mean(axis=0))
    centred = nodes.points_mm - placement.position_mm
    length = float(np.sqrt(np.mean(np.sum(centred**2, axis=1))))
    threshold = COARSE_OBSERVABILITY if alignment.report.unobservable else LEAST_OBSERVABLE
    size = nominal.surface.bounds.diagonal_mm
    settings = FitSettings(size, length, _TOLERANCE, _ITERATIONS, _LARGEST_TURN_RAD, threshold)
    end = fit(_cloud_measure(cloud, nominal.side), centred, placement, settings).placement
    shift = end.position_mm - placement.position_mm
    found = np.concatenate([vector_from_rotation(end.rotation) * length, shift])

    to_surface = nominal.surface_from_part
    points = to_surface.apply(alignment.tip_centre_part_mm[counts])
    at_points = _rows(points, to_surface.rotate(alignment.normals[counts]), placement, length)
    left = _explained(at_points, alignment.deviation_mm[counts], threshold)
    remaining = cloud.deviation_mm - left @ at_points[:, np.searchsorted(counts, cloud.number)]
    corners = cloud.net.triangles[nodes.triangle]
    pull = np.einsum("nk,nk->n", nodes.share, remaining[corners]) - compared.facets + compared.tilt
    tilted = _rows(nodes.points_mm, compared.facet_normals, placement, length)
    expected = _explained(tilted, pull, threshold) + (0.0 if wanted else left)
    rows = _rows(nodes.points_mm, nodes.normals, placement, length)
    allowed = _rms(compared.tilt) + _rms(compared.rest) + _rms(found @ (tilted - rows)) + ROUNDING * size
    return _Reverse(found, expected, found - expected, allowed, rows, centred, length)


def _cloud_measure(cloud: _Cloud, side: int) -> Measure:
    """Return the distance from the facets of the cloud; nodes beyond them or over a gap do not count."""

    def measure(points_mm: Array, previous: Feet | None) -> tuple[Feet, Mask]:
        del previous
        triangle, inside = locate(cloud.net, points_mm[:, 0], points_mm[:, 1])
        distance, normal = facet_distance(cloud.net, points_mm, triangle)
        feet = Feet(points_mm[:, 0], points_mm[:, 1], side * distance, side * normal)
        return feet, inside & cloud.kept[triangle]

    return Measure(measure)


def _rows(points_mm: Array, normals: Array, placement: Placement, length: float) -> Array:
    """Return what each unit motion changes in the deviations, shape (6, n)."""
    zero = np.zeros(len(points_mm))
    return rows_of(points_mm, placement, Feet(zero, zero, zero, normals), length)[:6]


def _explained(rows: Array, deviation: Array, threshold: float) -> Array:
    """Return the rigid motion that explains most of the deviations, shape (6,)."""
    spectral = spectrum(rows @ rows.T / len(deviation), threshold)
    return -solve_observable(spectral, rows @ deviation / len(deviation))


def _edge(motion: Array, reverse: _Reverse) -> float:
    """Return the most that a small motion moves a node, mm."""
    steps = np.cross(motion[:3] / reverse.length_mm, reverse.centred) + motion[3:]
    return float(np.linalg.norm(steps, axis=1).max())


def _area(cloud: _Cloud) -> float:
    """Return the area of the projection that facets cover, mm^2."""
    a, b, c = (cloud.net.points_mm[cloud.net.triangles[cloud.kept, k], :2] for k in range(3))
    u, v = b - a, c - a
    return float(0.5 * np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]).sum())


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _three(vector: Array) -> tuple[float, float, float]:
    return float(vector[0]), float(vector[1]), float(vector[2])


def _in_words(numbers: dict[str, float], turn: Array, *, agree: bool, at_rest: bool) -> str:
    """Say the outcome in a sentence."""
    um = {name: value * UM_PER_MM for name, value in numbers.items()}
    differ = f"both directions differ by {um['difference_rms_mm']:.3g} um RMS"
    facets = f"facets of points {numbers['spacing_mm']:.2g} mm apart"
    told = (
        f"{differ}, as {facets} must ({um['facets_rms_mm']:.3g} um)"
        if agree
        else f"{differ}, of which {facets} leave {um['rest_rms_mm']:.3g} um unexplained"
    )
    moves = (
        f"the reverse fit moves the nominal by {um['reverse_edge_mm']:.3g} um at its edge "
        f"({np.linalg.norm(turn) * URAD_PER_RAD:.3g} urad)"
    )
    if at_rest:
        return f"{told}; {moves}, as must be expected of facets and of where the points lie"
    return (
        f"{told}; {moves}: {um['unexplained_edge_mm']:.3g} um of it, {um['unexplained_rms_mm']:.3g} um RMS "
        "in the deviations, were left by the alignment"
    )
