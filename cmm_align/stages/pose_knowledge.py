"""What the data cannot tell of the pose, what they tell badly, and where more points would help.

A motion is *weak* if the deviations tell it `WEAK` times worse than the motion that they tell best: the root
of the ratio of two eigenvalues of the scaled normal matrix, a number without unit that is the same for a
part a thousand times larger. Sigmas come from the covariance, so form error that is alike in neighbours is
in them.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import Final, NamedTuple

import numpy as np

from cmm_align.config import OffsetConfig
from cmm_align.model import Nominal
from cmm_align.model.pose_knowledge import Correlation, HelpfulPlace, PoseKnowledge, WeakMotion
from cmm_align.numerics.helpful_points import Sums, helpful_places, told_elsewhere
from cmm_align.numerics.observability import (
    Spectrum,
    first_of_most,
    free_motions_in_words,
    lined_up,
    uncertain_axes,
)
from cmm_align.surfaces.envelope import edge_band_mm
from cmm_align.surfaces.geometry import principal_curvatures, unit_normal
from cmm_align.surfaces.protocol import Array
from cmm_align.units import UM_PER_MM, URAD_PER_RAD

WEAK: Final = 200.0
"""Measured, times worse than the best motion: the demo window 17, 51 and 97 and other windows that hold all
their motions 130 at most; a mirror of 5 m whose lateral motions are loose 370, 600 and 1500; a sphere with
0.1 mm of freeform 150 to 300, with 0.01 mm 1500 to 3000; a paraboloid of R 100 mm sideways 2200."""
ALIKE: Final = 2.0
"""Weak motions within this factor of each other are turned to the axes: their own directions are chance."""
CORRELATED: Final = 0.95
SHARE: Final = 0.01
"""Share of the used points that is put at each helpful place."""
BLOCK: Final = 0.2
"""Helpful places are this share of the part apart: neighbours err alike."""

_NODES: Final = 24
_RAYS: Final = 16
"""Rays to each side of the bounds; their corners are among them."""
_ALONG: Final = 64
_BISECTIONS: Final = 30
_GUESSED: Final = 1e-2
"""A motion that was free is not told yet while more than this share of its variance is a guess."""
_NEARLY: Final = 0.1
"""Components below this share of the largest are left out of "nearly a translation"."""
_AXES: Final = ("rx", "ry", "rz", "tx", "ty", "tz")


class Spots(NamedTuple):
    """Places on a nominal, frame `part`."""

    points_mm: Array
    """Shape (m, 3), mm."""
    normals: Array
    """Shape (m, 3), towards the probe."""

    def rows(self, centroid_mm: Array, length_mm: float) -> Array:
        """Return how the deviations answer a small motion, shape (m, 6), scaled.

        Parameters
        ----------
        centroid_mm : ndarray, shape (3,), mm, frame `part`
            Where the motions turn about.
        length_mm : float
            Scale of the rotations, mm.
        """
        turn = np.cross(self.points_mm - centroid_mm, self.normals)
        return np.hstack([turn / length_mm, self.normals])

    def displacements(self, motion: Array, centroid_mm: Array, length_mm: float) -> Array:
        """Return how a scaled motion displaces the places, shape (m, 3), mm.

        Parameters
        ----------
        motion : ndarray, shape (6,), mm
        centroid_mm : ndarray, shape (3,), mm, frame `part`
        length_mm : float
            Scale of the rotations, mm.
        """
        turn: Array = np.cross(motion[:3] / length_mm, self.points_mm - centroid_mm)
        return turn + motion[3:]


class _Known(NamedTuple):
    """The fit, with rotations scaled to lengths."""

    spectral: Spectrum
    covariance_mm2: Array
    centroid_mm: Array
    length_mm: float
    n_used: int
    residual_mm: float

    def sigma_mm(self, motion: Array) -> float:
        """Return the standard uncertainty of a scaled motion."""
        return float(np.sqrt(max(float(motion @ self.covariance_mm2 @ motion), 0.0)))

    def alike(self) -> float:
        """Return how many points count for one where neighbours err alike; 1 for independent errors."""
        motions, values = (a[..., ~self.spectral.free] for a in (self.spectral.motions, self.spectral.values))
        variance = np.einsum("ij,ik,kj->j", motions, self.covariance_mm2, motions)
        return max(1.0, float(np.mean(variance * values)) * self.n_used / self.residual_mm**2)

    def sums(self, told: Array) -> Sums:
        """Return the sums behind the fit; free motions that could be told are guessed, to a radian."""
        keep = ~self.spectral.free
        values, motions = self.n_used * self.spectral.values[keep], self.spectral.motions[:, keep]
        normal = (motions * values) @ motions.T
        weight = (self.residual_mm / self.length_mm) ** 2
        inverse = (motions / values) @ motions.T + told @ told.T / weight
        score = normal @ self.covariance_mm2 @ normal + weight * self.residual_mm**2 * told @ told.T
        return Sums(inverse, score)

    def words(self, motion: Array, border: Spots) -> str:
        """Name one motion, and what it looks like over the part if it turns about a far axis."""
        words = self._name(motion)
        turn, shift = (float(np.linalg.norm(part)) for part in (motion[:3] / self.length_mm, motion[3:]))
        arm = np.linalg.norm(border.points_mm - self.centroid_mm, axis=1).max(initial=0.0)
        if words.startswith("translation") or turn * arm >= shift:
            return words
        clear = np.where(np.abs(motion[3:]) < _NEARLY * np.abs(motion[3:]).max(), 0.0, motion[3:])
        return f"{words} (nearly a {self._name(np.concatenate([np.zeros(3), clear]))})"

    def _name(self, motion: Array) -> str:
        one = Spectrum(np.zeros(1), motion[:, None], np.ones(1, dtype=bool))
        return free_motions_in_words(one, self.centroid_mm, self.length_mm)[0]

    def reach(self, motion: Array, border: Spots) -> float:
        """Return how far a unit of a motion displaces the border at most."""
        moved = border.displacements(motion, self.centroid_mm, self.length_mm)
        return float(np.linalg.norm(moved, axis=1).max(initial=0.0))


def pose_knowledge(
    nominal: Nominal,
    spectral: Spectrum,
    covariance: Array,
    centroid_mm: Array,
    length_mm: float,
    n_used: int,
    sigma_mm: float,
    *,
    min_observability: float = 1e-8,
) -> PoseKnowledge:
    """Return what a fit knows of its pose.

    Parameters
    ----------
    nominal : Nominal
    spectral : Spectrum
        Motions in frame `part`, rotations times `length_mm`; what was locked is not among them and counts
        as known.
    covariance : ndarray, shape (6, 6), rad and mm, frame `part`
        Of (rx, ry, rz, tx, ty, tz) about the centroid, zero along the free motions.
    centroid_mm : ndarray, shape (3,), mm, frame `part`
        Of the tip centres: where the motions turn about.
    length_mm : float
        Scale of the rotations, mm.
    n_used : int
        Points that steered the fit.
    sigma_mm : float
        Standard deviation of their residuals, mm; a further point has it too.
    min_observability : float
        The fit's threshold between free and observable motions.

    Returns
    -------
    PoseKnowledge

    Notes
    -----
    The gain of more points is predicted for least squares, in which each weighs the same. Where the
    covariance had to be raised for form error, many points at one place count for as many fewer. Costs a
    few ms whatever the number of points.
    """
    scale = np.array([length_mm] * 3 + [1.0] * 3)
    scaled = covariance * np.outer(scale, scale)
    known = _Known(spectral, scaled, centroid_mm, length_mm, n_used, sigma_mm)
    border, inside = border_of(nominal), _candidates(nominal)
    least = min_observability / SHARE * float(spectral.values.max(initial=0.0))
    free, values = spectral.motions[:, spectral.free], spectral.values[spectral.free]
    told, beyond = (
        told_elsewhere(free, values, spots.rows(centroid_mm, length_mm), least) for spots in (inside, border)
    )
    motions, n_weak = _observable(spectral)
    weak = [_weak(known, border, motion) for motion in motions[:, :n_weak].T]
    edge, edge_at = _edge_normal(known, border, beyond)
    shift, shift_at = _edge_shift(known, border, free)
    apart_mm = BLOCK * nominal.surface.bounds.diagonal_mm
    helped, helped_um, places = _helpful(known, motions, inside, border, told=told, apart_mm=apart_mm)
    return PoseKnowledge(
        weak=tuple(sorted(weak, key=lambda motion: -motion.times_worse)),
        edge_sigma_um=edge,
        edge_at_mm=edge_at,
        edge_shift_sigma_um=shift,
        edge_shift_at_mm=shift_at,
        correlations=tuple(_correlations(covariance, spectral)),
        helped=helped,
        helped_um=helped_um,
        points_each=_each(n_used),
        helpful=places,
    )


def border_of(nominal: Nominal) -> Spots:
    """Return places on the border of a nominal: where rays from the middle of its bounds leave it last."""
    b = nominal.surface.bounds
    middle, half = _middle(nominal), 0.5 * np.array([b.x_max - b.x_min, b.y_max - b.y_min])
    side = np.linspace(-1.0, 1.0, _RAYS, endpoint=False)
    one = np.ones(_RAYS)
    ray = np.concatenate([[side, -one], [one, side], [-side, one], [-one, -side]], axis=1) * half[:, None]
    share = np.linspace(0.0, 1.0, _ALONG + 1)

    def contains(f: Array) -> Array:
        x, y = (middle[k] + f * ray[k] for k in range(2))
        return nominal.surface.contains(x.ravel(), y.ravel()).reshape(x.shape)

    hit = contains(share[:, None] * np.ones(ray.shape[1]))
    ray, hit = ray[:, hit.any(axis=0)], hit[:, hit.any(axis=0)]
    last = _ALONG - np.argmax(hit[::-1], axis=0)
    low, high = share[last], share[np.minimum(last + 1, _ALONG)]
    for _ in range(_BISECTIONS):
        half_way = 0.5 * (low + high)
        there = contains(half_way)
        low, high = np.where(there, half_way, low), np.where(there, high, half_way)
    return _spots(nominal, middle[0] + low * ray[0], middle[1] + low * ray[1])


def _middle(nominal: Nominal) -> Array:
    """Return the middle of the bounds, shape (2,), mm, frame `surface`."""
    b = nominal.surface.bounds
    return np.array([0.5 * (b.x_min + b.x_max), 0.5 * (b.y_min + b.y_max)])


def _candidates(nominal: Nominal) -> Spots:
    """Return a light grid of places that the ball can touch without touching an edge."""
    b, surface = nominal.surface.bounds, nominal.surface
    cell = (np.arange(_NODES) + 0.5) / _NODES
    x, y = (
        a.ravel()
        for a in np.meshgrid(b.x_min + cell * (b.x_max - b.x_min), b.y_min + cell * (b.y_max - b.y_min))
    )
    inside = surface.contains(x, y)
    x, y = x[inside], y[inside]
    most = principal_curvatures(surface.jet(x, y), nominal.side).most
    x, y, most = (a[np.isfinite(most)] for a in (x, y, most))
    band = edge_band_mm(nominal.tip_radius_mm, most, OffsetConfig().edge_proud_um / UM_PER_MM)
    for u, v in ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)):
        inset = band / np.hypot(u, v)
        clear = surface.contains(x + u * inset, y + v * inset)
        x, y, band = x[clear], y[clear], band[clear]
    return _spots(nominal, x, y)


def _spots(nominal: Nominal, x_mm: Array, y_mm: Array) -> Spots:
    """Return the places of the nominal over a plane, in frame `part`."""
    jet = nominal.surface.jet(x_mm, y_mm)
    part_from_surface = nominal.surface_from_part.inverse()
    points, normals = np.stack([x_mm, y_mm, jet.z], axis=1), unit_normal(jet, nominal.side)
    fine = np.isfinite(points).all(axis=1) & np.isfinite(normals).all(axis=1)
    return Spots(part_from_surface.apply(points[fine]), part_from_surface.rotate(normals[fine]))


def _observable(spectral: Spectrum) -> tuple[Array, int]:
    """Return the observable motions, shape (6, k), weakest first, and how many of them are weak."""
    values, best = spectral.values, spectral.values.max(initial=0.0)
    weak = np.flatnonzero(~spectral.free & (values * WEAK**2 < best))
    breaks = np.flatnonzero(values[weak][1:] > ALIKE**2 * values[weak][:-1]) + 1
    groups = [lined_up(spectral.motions[:, group]) for group in np.split(weak, breaks)]
    strong = spectral.motions[:, ~spectral.free & (values * WEAK**2 >= best)]
    return np.hstack([*groups, strong]), len(weak)


def _weak(known: _Known, border: Spots, motion: Array) -> WeakMotion:
    """Return a weak motion with its words and standard uncertainty."""
    values, motions = known.spectral.values, known.spectral.motions
    own = float(values @ (motions.T @ motion) ** 2)
    words, sigma = known.words(motion, border), known.sigma_mm(motion)
    turn = 0.0 if words.startswith("translation") else float(np.linalg.norm(motion[:3])) / known.length_mm
    return WeakMotion(
        words=words,
        sigma_um=sigma * known.reach(motion, border) * UM_PER_MM,
        sigma_urad=sigma * turn * URAD_PER_RAD,
        times_worse=float(np.sqrt(values[-1] / own)),
    )


def _edge_normal(known: _Known, border: Spots, beyond: Array) -> tuple[float, tuple[float, float, float]]:
    """Return the largest sigma of the deviation at the border, um, and its place, mm."""
    rows = border.rows(known.centroid_mm, known.length_mm)
    if beyond.shape[1]:
        answer = np.sum((rows @ beyond) ** 2, axis=1)
        return np.inf, _at(border, answer)
    variance = np.einsum("ni,ij,nj->n", rows, known.covariance_mm2, rows)
    return _largest_um(variance), _at(border, variance)


def _edge_shift(known: _Known, border: Spots, free: Array) -> tuple[float, tuple[float, float, float]]:
    """Return how far a point at the border may be displaced, um, and its place, mm."""
    moves = np.stack(
        [border.displacements(unit, known.centroid_mm, known.length_mm) for unit in np.eye(6)], axis=2
    )
    if free.shape[1]:
        return np.inf, _at(border, np.sum((moves @ free) ** 2, axis=(1, 2)))
    covariances = moves @ known.covariance_mm2 @ moves.transpose(0, 2, 1)
    spread = np.asarray(np.linalg.eigvalsh(covariances)[:, -1], dtype=np.float64)
    return _largest_um(spread), _at(border, spread)


def _largest_um(variance_mm2: Array) -> float:
    """Return the root of the largest variance, um; NaN if there is none."""
    return float(np.sqrt(max(variance_mm2.max(), 0.0))) * UM_PER_MM if len(variance_mm2) else np.nan


def _at(spots: Spots, weight: Array) -> tuple[float, float, float]:
    """Return the place where a weight is largest; NaN if there is none."""
    if len(weight) == 0:
        return np.nan, np.nan, np.nan
    x, y, z = spots.points_mm[int(np.argmax(weight))]
    return float(x), float(y), float(z)


def _correlations(covariance: Array, spectral: Spectrum) -> Iterator[Correlation]:
    """Name the pairs of motions about the centroid that look alike, most alike first."""
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    known = (sigma > 0.0) & ~uncertain_axes(spectral)
    found = [
        (float(covariance[i, j] / (sigma[i] * sigma[j])), i, j)
        for i, j in combinations(np.flatnonzero(known), 2)
    ]
    for rho, i, j in sorted(found, key=lambda pair: -abs(pair[0])):
        if abs(rho) > CORRELATED:
            shift_first = sorted((_AXES[i], _AXES[j]), reverse=_AXES[i][0] != _AXES[j][0])
            words = f"{' and '.join(map(_plain, shift_first))} look alike"
            yield Correlation(_AXES[i], _AXES[j], float(np.clip(rho, -1.0, 1.0)), words)


def _plain(axis: str) -> str:
    """Write the name of a motion out."""
    return f"a {'turn about' if axis[0] == 'r' else 'shift along'} {axis[1]}"


def _each(n_used: int) -> int:
    """Return how many points are put at a helpful place."""
    return max(1, round(SHARE * n_used))


def _helpful(
    known: _Known, motions: Array, inside: Spots, border: Spots, *, told: Array, apart_mm: float
) -> tuple[str, float, tuple[HelpfulPlace, ...]]:
    """Return the weakest motion, its sigma now, um, and the places that would help it."""
    variance = known.residual_mm**2
    rows = inside.rows(known.centroid_mm, known.length_mm)
    if variance <= 0.0 or motions.shape[1] == 0 or len(rows) == 0:
        return "", 0.0, ()
    motions = np.hstack([lined_up(told), motions])
    now = known.sums(told)
    weakest = motions[:, first_of_most(np.array([now.variance(motion) for motion in motions.T]))]
    each = _each(known.n_used)
    of_mean = min(variance, variance * known.alike() / each)
    chosen = helpful_places(
        now,
        motions,
        rows,
        inside.points_mm,
        count=each,
        variance=of_mean,
        apart_mm=apart_mm,
        guessed=told.shape[1],
    )
    reach_um = known.reach(weakest, border) * UM_PER_MM

    def um(sums: Sums) -> float:
        total = sums.variance(weakest)
        guessed = (variance / known.length_mm) ** 2 * float(np.sum((told.T @ sums.inverse @ weakest) ** 2))
        return np.inf if guessed > _GUESSED * total else float(np.sqrt(total)) * reach_um

    places = []
    one, more = now, now
    for k in chosen:
        one = one.with_points(rows[k], 1, variance)
        more = more.with_points(rows[k], each, of_mean)
        x, y, z = (float(value) for value in inside.points_mm[k])
        places.append(HelpfulPlace((x, y, z), um(one), um(more)))
    return known.words(weakest, border), um(now), tuple(places)
