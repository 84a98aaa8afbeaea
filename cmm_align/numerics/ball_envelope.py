"""Where a ball comes to rest on a height field: the exact envelope, as a continuous maximisation.

A ball of radius r that comes down along z over (X, Y) stops with its centre at

    E(X, Y) = max over (u, v) of  s(u, v) + sqrt(r^2 - (u - X)^2 - (v - Y)^2),

the dilation of the height field by the ball, the upper boundary of the Minkowski sum of the part with it
(J. Serra, "Image Analysis and Mathematical Morphology", 1982, chapter XII; for probes: ISO 16610-85).
The maximum is looked for on a pattern of directions of the ball, and refined from several of its hills by
Newton's method, or by a shrinking star where it lies on the border of the surface.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmm_align.numerics.foot_point import JetFunction

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
ContainsFunction = Callable[[Array, Array], Mask]

RINGS: Final = 6
"""Rings of the pattern: a hill narrower than some r/6 can hide between its directions."""
HILLS: Final = 3
"""Hills of the pattern that are climbed."""

_CHUNK: Final = 1024
_NEWTON_STEPS: Final = 40
_STAR_STEPS: Final = 60
_HALVINGS: Final = 40
_GAIN: Final = 0.15
"""A hill this share of the radius lower than the best top is not climbed: a pattern's place is nearer to its
top than that, unless the surface is sharp there."""
_SMALL: Final = 1e-7
"""A step below this share of the radius ends the climb; the height feels its square."""
_GOLDEN_RAD: Final = 2.399963229728653
_RIM: Final = 1.0 - 1e-9


class BallRest(NamedTuple):
    """A ball at rest over n places, frame `surface`."""

    height_mm: Array
    """Height of its centre, shape (n,), mm; NaN where it meets no surface within its radius."""
    x_mm: Array
    """Where it touches, shape (n,), mm."""
    y_mm: Array


class _Climb(NamedTuple):
    """The function to maximise and its derivatives at n places."""

    value: Array
    gx: Array
    gy: Array
    hxx: Array
    hxy: Array
    hyy: Array


def ball_rest(
    jet: JetFunction,
    contains: ContainsFunction,
    side: int,
    radius_mm: float,
    x_mm: Array,
    y_mm: Array,
    start_mm: Array | None = None,
) -> BallRest:
    """Return where a ball stops that comes along z over given places.

    Parameters
    ----------
    jet : callable
        Height and derivatives of the surface at places (x, y), mm.
    contains : callable
        Whether places lie on the surface; the ball touches nothing else.
    side : int
        +1 if the ball comes from +z, -1 if it comes from -z.
    radius_mm : float
        Radius of the ball, mm.
    x_mm, y_mm : ndarray, shape (n,), mm, frame `surface`
        Places of the ball's centre.
    start_mm : ndarray, shape (n, 2), mm, optional
        A place of contact to try besides those of the pattern, within the radius of (x, y).

    Returns
    -------
    BallRest
        Tested against closed forms (groove, paraboloid, cone) to 1e-9 mm, and to 1e-6 mm where the ball
        rests on the border of the surface.
    """
    height = np.empty(len(x_mm))
    touch = np.empty((len(x_mm), 2))
    for first in range(0, len(x_mm), _CHUNK):
        part = slice(first, first + _CHUNK)
        centre = np.stack([x_mm[part], y_mm[part]], axis=1)
        start = None if start_mm is None else start_mm[part]
        height[part], touch[part] = _rest(jet, contains, side, radius_mm, centre, start)
    return BallRest(side * height, touch[:, 0], touch[:, 1])


def _rest(
    jet: JetFunction, contains: ContainsFunction, side: int, radius: float, centre: Array, own: Array | None
) -> tuple[Array, Array]:
    """Return height (towards the ball) and contact of one chunk of places, shape (n, 2)."""
    n = len(centre)
    best, best_at = np.full(n, -np.inf), np.full((n, 2), np.nan)
    starts = _hills(jet, contains, side, radius, centre)
    if own is not None:
        starts.insert(0, (own, np.full(n, np.inf)))
    for at, height in starts:
        k = np.flatnonzero(height > best - _GAIN * radius)
        if len(k):
            value, place = _climbed(jet, contains, side, radius, centre[k], at[k], best[k])
            better = value > best[k]
            best[k[better]], best_at[k[better]] = value[better], place[better]
    return np.where(np.isfinite(best), best, np.nan), best_at


def _hills(
    jet: JetFunction, contains: ContainsFunction, side: int, radius: float, centre: Array
) -> list[tuple[Array, Array]]:
    """Return the highest places of the pattern, apart from each other by half a radius, and their values."""
    pattern = _pattern(radius)
    places = centre[:, None, :] + pattern[None, :, :]
    value = _value(jet, contains, side, radius, centre.repeat(len(pattern), axis=0), places.reshape(-1, 2))
    value = value.reshape(len(centre), len(pattern))
    rows = np.arange(len(centre))
    found = []
    for _ in range(HILLS):
        pick = np.argmax(value, axis=1)
        found.append((places[rows, pick], value[rows, pick]))
        gap = np.linalg.norm(pattern[None, :, :] - pattern[pick][:, None, :], axis=2)
        value = np.where(gap < 0.5 * radius, -np.inf, value)
    return found


def _pattern(radius: float) -> Array:
    """Return places on a disc that are evenly spread directions of the half ball, shape (m, 2), mm."""
    parts = [np.zeros((1, 2))]
    for ring in range(1, RINGS + 1):
        angle = 2.0 * np.pi * (np.arange(6 * ring) + 0.5 * (ring % 2)) / (6 * ring)
        reach = radius * np.sin(0.5 * np.pi * ring / (RINGS + 0.25))
        parts.append(reach * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    return np.concatenate(parts)


def _value(
    jet: JetFunction, contains: ContainsFunction, side: int, radius: float, centre: Array, at: Array
) -> Array:
    """Return the centre's height if the ball touched at `at`; minus infinity where it cannot."""
    rest = radius**2 - np.sum((at - centre) ** 2, axis=1)
    good = (rest > 0.0) & contains(at[:, 0], at[:, 1])
    value = np.full(len(at), -np.inf)
    z = side * np.asarray(jet(at[good, 0], at[good, 1]).z)
    value[good] = np.where(np.isfinite(z), z + np.sqrt(rest[good]), -np.inf)
    return value


def _climb(jet: JetFunction, side: int, radius: float, centre: Array, at: Array) -> _Climb:
    """Return the function and its derivatives at places inside the disc."""
    dx, dy = (at - centre).T
    w = np.sqrt(np.maximum(radius**2 - dx * dx - dy * dy, (1.0 - _RIM) * radius**2))
    j = jet(at[:, 0], at[:, 1])
    return _Climb(
        side * j.z + w,
        side * j.zx - dx / w,
        side * j.zy - dy / w,
        side * j.zxx - 1.0 / w - dx * dx / w**3,
        side * j.zxy - dx * dy / w**3,
        side * j.zyy - 1.0 / w - dy * dy / w**3,
    )


def _climbed(
    jet: JetFunction,
    contains: ContainsFunction,
    side: int,
    radius: float,
    centre: Array,
    start: Array,
    floor: Array,
) -> tuple[Array, Array]:
    """Climb from one start a place: Newton inside, a shrinking star on the border.

    The star is spared where it would have to gain much to come above `floor`, what is known already.
    """
    at = start.copy()
    value = _value(jet, contains, side, radius, centre, at)
    shortest = np.ones(len(at))
    open_ = np.flatnonzero(np.isfinite(value))
    stuck = []
    for _ in range(_NEWTON_STEPS):
        if not len(open_):
            break
        whole = _newton_step(_climb(jet, side, radius, centre[open_], at[open_]), radius)
        there = np.linalg.norm(whole, axis=1) < _SMALL * radius
        step = whole * shortest[open_, None]
        trial = at[open_] + step
        found = _value(jet, contains, side, radius, centre[open_], trial)
        length = np.linalg.norm(step, axis=1)
        up = found >= value[open_] - _SMALL**2 * radius
        at[open_[up]], value[open_[up]] = trial[up], found[up]
        shortest[open_] = np.where(up, np.minimum(1.0, 2.0 * shortest[open_]), 0.25 * shortest[open_])
        cannot = ~there & (length < 1e-4 * radius)
        stuck.append(open_[cannot])
        open_ = open_[~(there | cannot)]
    rest = np.concatenate([*stuck, open_])
    rest = rest[value[rest] > floor[rest] - 0.25 * _GAIN * radius]
    if len(rest):
        at[rest], value[rest] = _star(
            jet, contains, side, radius, centre[rest], at[rest], value[rest], start[rest]
        )
    return value, at


def _newton_step(c: _Climb, radius: float) -> Array:
    """Return uphill steps, shape (n, 2): Newton's where the hill is round, damped elsewhere."""
    mean, half = -0.5 * (c.hxx + c.hyy), np.hypot(0.5 * (c.hxx - c.hyy), c.hxy)
    lift = np.maximum(0.0, 1e-3 / radius - (mean - half)) + np.where(mean < half, 0.5 / radius, 0.0)
    axx, ayy, axy = -c.hxx + lift, -c.hyy + lift, -c.hxy
    det = axx * ayy - axy * axy
    step = np.stack([(ayy * c.gx - axy * c.gy) / det, (axx * c.gy - axy * c.gx) / det], axis=1)
    length = np.linalg.norm(step, axis=1)
    held: Array = step * np.minimum(1.0, 0.3 * radius / np.maximum(length, 1e-300))[:, None]
    return np.where(np.isfinite(held), held, 0.0)


def _star(
    jet: JetFunction,
    contains: ContainsFunction,
    side: int,
    radius: float,
    centre: Array,
    at: Array,
    value: Array,
    start: Array,
) -> tuple[Array, Array]:
    """Climb by looking round in eight directions that turn, nearer each time nothing is higher.

    Places past the border are drawn back to it, on the way to an anchor on the surface, so that the climb
    goes on along the border.
    """
    at, value = at.copy(), value.copy()
    anchor = _anchors(contains, radius, at, start)
    reach = np.full(len(at), 0.05 * radius)
    eight = 0.25 * np.pi * np.arange(8)
    for k in range(_STAR_STEPS):
        angle = eight + k * _GOLDEN_RAD
        star = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        trial = at[:, None, :] + reach[:, None, None] * star[None, :, :]
        trial = _drawn_back(contains, trial.reshape(-1, 2), anchor.repeat(8, axis=0)).reshape(trial.shape)
        found = _value(jet, contains, side, radius, centre.repeat(8, axis=0), trial.reshape(-1, 2))
        found = found.reshape(-1, 8)
        pick = np.argmax(found, axis=1)
        rows = np.arange(len(at))
        up = found[rows, pick] > value
        at[up], value[up] = trial[rows, pick][up], found[rows, pick][up]
        reach = np.where(up, 1.2 * reach, 0.7 * reach)
    return at, value


def _anchors(contains: ContainsFunction, radius: float, at: Array, start: Array) -> Array:
    """Return a place well inside the surface for each place on its border: the middle of what is near."""
    pattern = _pattern(radius)
    near = at[:, None, :] + pattern[None, :, :]
    inside = contains(near[..., 0].ravel(), near[..., 1].ravel()).reshape(near.shape[:2])
    count = np.maximum(inside.sum(axis=1), 1)
    middle = at + np.where(inside[:, :, None], pattern[None, :, :], 0.0).sum(axis=1) / count[:, None]
    return np.where(contains(middle[:, 0], middle[:, 1])[:, None], middle, start)


def _drawn_back(contains: ContainsFunction, at: Array, anchor: Array) -> Array:
    """Return places outside of the surface drawn back to its border by halving, shape (n, 2)."""
    k = np.flatnonzero(~contains(at[:, 0], at[:, 1]))
    inside, outside = anchor[k].copy(), at[k].copy()
    for _ in range(_HALVINGS if len(k) else 0):
        middle = 0.5 * (inside + outside)
        good = contains(middle[:, 0], middle[:, 1])[:, None]
        inside, outside = np.where(good, middle, inside), np.where(good, outside, middle)
    at = at.copy()
    at[k] = inside
    return at
