"""Why a fit found nothing: another unit, axes that are swapped or mirrored, a part that lies turned.

Each guess is tried on few points. First in the frame that the points came in, where every exchange of axes
can be told from every other; then wherever the part may lie, from its principal axes, where all mirror
images are one and the same.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import permutations, product
from typing import Final, NamedTuple

import numpy as np

from cmm_align.model import Nominal
from cmm_align.numerics.fit_steps import FitSettings
from cmm_align.numerics.linearisation import Measure, Placement, evaluate
from cmm_align.numerics.rigid_fit import fit
from cmm_align.numerics.rotations import vector_from_rotation
from cmm_align.pose import Pose
from cmm_align.stages.findings import Evidence, Finding
from cmm_align.surfaces.distance import facet_measure, light_net, smooth_measure
from cmm_align.surfaces.protocol import Array
from cmm_align.units import DEG_PER_RAD, UM_PER_MM, mm_per

POINTS: Final = 100
FITS_WELL: Final = 1e-3
"""A guess is named if its RMS is below this share of the size."""
FAR_BETTER: Final = 0.2
"""A mirror image is certain if it leaves less than this share of what the best proper motion leaves."""
SIZES: Final = (0.35, 1.6)
"""Size of a measurement over that of its nominal: half scans are small, fixtures are large."""
NEAR_RAD: Final = 0.2
"""A guess made in the frame of the file may turn this much more."""
_NODES: Final = 40
_INSIDE: Final = 0.5
_REFINED: Final = 4
_WAY_STEPS: Final = 8
_SMOOTH_STEPS: Final = 6
_TURNED_DEG: Final = 5.0

_UNITS: Final = (
    (1.0, ""),
    (mm_per("inch"), "the points are in inch, read as mm"),
    (1.0 / mm_per("inch"), "the nominal is in inch, read as mm"),
    (mm_per("m"), "the points are in m, read as mm"),
    (1.0 / mm_per("m"), "the points are in um, read as mm"),
    (mm_per("cm"), "the points are in cm, read as mm"),
    (1.0 / mm_per("cm"), "the nominal is in cm, read as mm"),
)


class _Guess(NamedTuple):
    axes: Array
    """Signed permutation, shape (3, 3)."""
    scale: float
    unit: str
    in_frame: bool
    rms_mm: float
    placement: Placement


class _Tried(NamedTuple):
    cost_mm2: float
    axes: Array
    placement: Placement


class _Bench(NamedTuple):
    """What all guesses are tried on."""

    points_mm: Array
    coarse: Measure
    fine: Measure
    nodes_mm: Array
    start: Pose
    settings: FitSettings


def explain_failure(
    points_mm: Array,
    nominal: Nominal,
    *,
    start: Pose | None = None,
    contact: bool = False,
    rms_mm: float = np.inf,
) -> tuple[Finding, ...]:
    """Say what points look like that could not be laid on a nominal.

    Parameters
    ----------
    points_mm : ndarray, shape (n, 3), mm, frame `machine`
        As read; a few are used.
    nominal : Nominal
    start : Pose, optional
        ``part_from_machine`` of the frame that they came in; the identity unless given.
    contact : bool
        They are contact points.
    rms_mm : float
        Of the fit that is to be explained, where there is one.

    Returns
    -------
    tuple of Finding
        Readings that fit well, best first; empty if none does. A proper motion without another unit comes
        before any other that is not far better.
    """
    bench = _bench(points_mm, nominal, start, contact=contact)
    guesses: list[_Guess] = []
    for scale, unit in _UNITS:
        if not SIZES[0] < scale * _radius(bench.points_mm) / _radius(bench.nodes_mm) < SIZES[1]:
            continue
        guesses += _in_the_frame(bench, scale, unit)
        guesses += _anywhere(bench, scale, unit)
    well = FITS_WELL * bench.settings.size_mm
    good = sorted((g for g in guesses if g.rms_mm <= well), key=lambda g: (g.rms_mm, not g.in_frame))
    if not good:
        return ()
    plain = min([rms_mm, *(g.rms_mm for g in guesses if _proper(g) and not g.unit)])
    named: dict[str, Finding] = {}
    for guess in good:
        far_better = guess.rms_mm < FAR_BETTER * plain
        usual = _proper(guess) and not guess.unit
        if not usual and not far_better:
            continue
        if usual and _turned_deg(guess, bench) < _TURNED_DEG:
            continue
        finding = _finding(guess, bench, rms_mm, sure=far_better and (not usual or np.isfinite(rms_mm)))
        named.setdefault(finding.name, finding)
        if guess.in_frame and not usual:
            break
    return tuple(named.values())


def _bench(points_mm: Array, nominal: Nominal, start: Pose | None, *, contact: bool) -> _Bench:
    """Choose few points and make the light net."""
    n = len(points_mm)
    few = points_mm[np.linspace(0, n - 1, min(n, POINTS)).round().astype(np.intp)]
    radius = 0.0 if contact else nominal.tip_radius_mm
    net = light_net(nominal.surface, nominal.side, radius, _NODES)
    size = nominal.surface.bounds.diagonal_mm
    rms_radius = float(np.sqrt(np.mean(np.sum((net.points_mm - net.points_mm.mean(axis=0)) ** 2, axis=1))))
    settings = FitSettings(size, rms_radius, 1e-4, _WAY_STEPS, 0.5, 1e-6)
    pose = nominal.surface_from_part @ (start or Pose.identity("part", "machine"))
    return _Bench(
        few,
        facet_measure(net, nominal.side),
        smooth_measure(nominal.surface, nominal.side, radius),
        net.points_mm,
        pose,
        settings,
    )


def _radius(points_mm: Array) -> float:
    """Return the radius about the centroid that holds nearly all points, mm."""
    return float(np.quantile(np.linalg.norm(points_mm - points_mm.mean(axis=0), axis=1), 0.98))


def _in_the_frame(bench: _Bench, scale: float, unit: str) -> list[_Guess]:
    """Try every exchange of axes where the points are, and refine the best."""
    tried: list[_Tried] = []
    everywhere = np.ones(len(bench.points_mm), dtype=bool)
    for axes in _signed_permutations():
        points = scale * bench.points_mm @ axes.T
        centroid = points.mean(axis=0)
        placement = Placement(bench.start.rotation, bench.start.apply(centroid[None])[0])
        there = evaluate(
            bench.coarse, points - centroid, placement, bench.settings.length_mm, used=everywhere
        )
        if np.mean(there.inside) > _INSIDE:
            tried.append(_Tried(there.cost_mm2, axes, placement))
    ways = []
    for trial in sorted(tried, key=lambda t: t.cost_mm2)[:_REFINED]:
        points = scale * bench.points_mm @ trial.axes.T
        way = _way(bench, points - points.mean(axis=0), trial.placement)
        if way is not None:
            ways.append(way._replace(axes=trial.axes))
    result = []
    for way in _best_of_each_hand(ways):
        guess = _refined(bench, way.axes, scale, unit, way.placement, in_frame=True)
        turn = np.linalg.norm(vector_from_rotation(guess.placement.rotation @ bench.start.rotation.T))
        result.append(guess._replace(in_frame=bool(turn < NEAR_RAD)))
    return result


def _anywhere(bench: _Bench, scale: float, unit: str) -> list[_Guess]:
    """Lay principal axes on principal axes, as they are and mirrored, and refine the best of each."""
    middle = bench.nodes_mm.mean(axis=0)
    target = _axes(bench.nodes_mm - middle)
    ways = []
    for axes in (np.eye(3), np.diag([1.0, 1.0, -1.0])):
        points = scale * bench.points_mm @ axes.T
        points = points - points.mean(axis=0)
        own = _axes(points)
        for signs in ((1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)):
            begun = Placement(target @ np.diag(np.array(signs, dtype=np.float64)) @ own.T, middle)
            way = _way(bench, points, begun)
            if way is not None:
                ways.append(way._replace(axes=axes))
    return [
        _refined(bench, way.axes, scale, unit, way.placement, in_frame=False)
        for way in _best_of_each_hand(ways)
    ]


def _way(bench: _Bench, points_mm: Array, begun: Placement) -> _Tried | None:
    """Fit on the light net; None if most points end beside it."""
    everywhere = np.ones(len(points_mm), dtype=bool)
    coarse = replace(bench.settings, tolerance=1e-3)
    way = fit(bench.coarse, points_mm, begun, coarse, used=everywhere)
    if np.mean(way.evaluation.inside) <= _INSIDE:
        return None
    return _Tried(way.evaluation.cost_mm2, np.eye(3), way.placement)


def _best_of_each_hand(ways: list[_Tried]) -> list[_Tried]:
    """Return the best proper and the best mirrored way."""
    ways = sorted(ways, key=lambda t: t.cost_mm2)
    proper = [w for w in ways if np.linalg.det(w.axes) > 0.0]
    mirrored = [w for w in ways if np.linalg.det(w.axes) < 0.0]
    return proper[:1] + mirrored[:1]


def _axes(centred_mm: Array) -> Array:
    """Return the principal axes as columns of a proper rotation, longest first."""
    axes = np.linalg.eigh(centred_mm.T @ centred_mm)[1][:, ::-1].copy()
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    result: Array = axes
    return result


def _refined(
    bench: _Bench, axes: Array, scale: float, unit: str, placement: Placement, *, in_frame: bool
) -> _Guess:
    """Fit a guess by smooth foot points."""
    points = scale * bench.points_mm @ axes.T
    few_steps = replace(bench.settings, max_iterations=_SMOOTH_STEPS)
    ended = fit(bench.fine, points - points.mean(axis=0), placement, few_steps)
    inside = float(np.mean(ended.evaluation.inside))
    rms = float(np.sqrt(ended.evaluation.cost_mm2)) if inside > _INSIDE else np.inf
    return _Guess(axes, scale, unit, in_frame, rms, ended.placement)


def _signed_permutations() -> Iterator[Array]:
    """Yield the 48 exchanges of axes, those that change least first."""
    found = []
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            axes = np.zeros((3, 3))
            axes[range(3), order] = signs
            found.append(axes)
    yield from sorted(found, key=lambda a: -float(np.trace(np.abs(a)) * 10.0 + a.sum()))


def _proper(guess: _Guess) -> bool:
    return bool(np.linalg.det(guess.axes) > 0.0)


def _turned_deg(guess: _Guess, bench: _Bench) -> float:
    """Return the angle between the frame of the file and where a proper guess ended."""
    turn = vector_from_rotation(guess.placement.rotation @ guess.axes @ bench.start.rotation.T)
    return float(np.linalg.norm(turn)) * DEG_PER_RAD


def _finding(guess: _Guess, bench: _Bench, rms_mm: float, *, sure: bool) -> Finding:
    """Put a guess into words."""
    gain = f"RMS {guess.rms_mm * UM_PER_MM:.4g} um so"
    if np.isfinite(rms_mm):
        gain += f", {rms_mm * UM_PER_MM:.4g} um as it is"
    evidence = Evidence.CLEAR if sure else Evidence.SUSPECT
    if guess.unit:
        words = guess.unit + ("" if _proper(guess) else f", and {_axes_in_words(guess)[1]}")
        return Finding("units", f"{words} ({gain})", evidence, "check --units of this command and of offset")
    if _proper(guess) and (not guess.in_frame or np.trace(np.abs(guess.axes)) == 3.0):
        words = f"the part fits when it is turned by {_turned_deg(guess, bench):.0f} degrees ({gain})"
        return Finding("turned", words, evidence, "give a start pose with --initial")
    name, words = _axes_in_words(guess)
    return Finding(name, f"{words} ({gain})", evidence, "export the points again with x, y, z right-handed")


def _axes_in_words(guess: _Guess) -> tuple[str, str]:
    """Name an exchange of axes; where the frame is not the part's, only that it mirrors."""
    if not guess.in_frame:
        return "mirrored", "the points are mirrored: an axis is flipped or two are swapped"
    order = np.argmax(np.abs(guess.axes), axis=1)
    signs = guess.axes[range(3), order]
    now = ", ".join(("-" if s < 0.0 else "") + "xyz"[k] for k, s in zip(order, signs, strict=True))
    flipped = " and ".join("xyz"[k] for k in range(3) if signs[k] < 0.0)
    if (order == np.arange(3)).all():
        return "flipped-axis", f"{flipped} of the points {'are' if ' ' in flipped else 'is'} flipped"
    swapped = [k for k in range(3) if order[k] != k]
    if len(swapped) == 2:
        names = " and ".join("xyz"[k] for k in swapped)
        return "swapped-axes", f"{names} of the points are swapped: x, y, z should be {now}"
    return "swapped-axes", f"the axes of the points are exchanged: x, y, z should be {now}"
