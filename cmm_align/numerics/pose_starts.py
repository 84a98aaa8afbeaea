"""Placements to start from when nobody knows how the part lies: a small, complete set of first guesses.

The principal axes of the cloud are laid on those of the target, in every way that their lengths allow: both
directions of the normal, half turns, turns all around where two axes are of like length, exchanged axes
where a deep or narrow cloud hides which of them is the normal. A cloud that covers a part of the target only
is laid on patches of its own size all over it; one that reaches beyond it is shifted about.
Source of the plain case: principal axes and the four proper signs, as common in mesh registration.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmm_align.numerics.rotations import rotation_from_vector

Array = NDArray[np.float64]

ALIKE: Final = 1.35
"""Axes whose spreads are within this factor may be each other: uneven scanning changes spreads by a fifth."""
SMALLER: Final = 0.85
"""Below this share of the target's spread a cloud covers a part of it only."""
LARGER: Final = 1.15
CLOCKINGS: Final = 24
"""Turns about the normal on a whole target: every 15 degrees."""
PATCH_CLOCKINGS: Final = 12
"""The same on patches: the iteration finds the way from 15 degrees off."""
LATTICE: Final = 4
"""Patches along the longer axis of the target, less one."""
_EXTENT: Final = float(np.sqrt(3.0))
"""Half the length of an evenly covered side in standard deviations."""
_DEEP: Final = 3.0
"""Where the spread along the normal is not below the lateral ones by this factor, they may be exchanged."""
_CORE_ROUNDS: Final = 5
_CORE: Final = 2.0
"""Points beyond this many times the median Mahalanobis distance say nothing about the axes."""


class Frame(NamedTuple):
    """Centre, principal axes (columns, right-handed, longest first) and spreads of points."""

    centre_mm: Array
    axes: Array
    spread_mm: Array


class Starts(NamedTuple):
    """Many placements, ``p = rotation q + position`` each."""

    rotations: Array
    """Shape (k, 3, 3)."""
    positions_mm: Array
    """Shape (k, 3)."""


def principal_frame(points_mm: Array) -> Frame:
    """Return the principal frame of points, stray ones left out.

    Parameters
    ----------
    points_mm : ndarray, shape (n, 3), mm
    """
    core = points_mm
    for _ in range(_CORE_ROUNDS):
        frame = _plain_frame(core)
        floor = max(1e-6 * float(frame.spread_mm[0]), 1e-300)
        scaled = (points_mm - frame.centre_mm) @ frame.axes / np.maximum(frame.spread_mm, floor)
        reach = np.linalg.norm(scaled, axis=1)
        kept = points_mm[reach <= _CORE * float(np.median(reach))]
        if len(kept) == len(core) or len(kept) < 6:
            break
        core = kept
    return _plain_frame(core)


def first_guesses(points_mm: Array, target_points_mm: Array) -> Starts:
    """Return placements, one of which lies near every placement of the cloud on the target.

    Parameters
    ----------
    points_mm : ndarray, shape (n, 3), mm
        The cloud, about any origin.
    target_points_mm : ndarray, shape (m, 3), mm, frame `surface`
        Points spread evenly over the target.

    Returns
    -------
    Starts
        Proper rotations only. A dozen for an oblong part that is covered, some hundred for a part of one.
    """
    cloud, target = principal_frame(points_mm), _plain_frame(target_points_mm)
    ratio = cloud.spread_mm[:2] / np.maximum(target.spread_mm[:2], 1e-300)
    partial = bool(ratio.min() < SMALLER)
    lateral = max(cloud.spread_mm[0] / max(cloud.spread_mm[1], 1e-300), 1.0)
    wide = max(target.spread_mm[0] / max(target.spread_mm[1], 1e-300), 1.0)
    round_ = min(lateral, wide) < ALIKE
    bases = _bases(cloud)
    starts = [_laid(cloud, bases, target, _turns(CLOCKINGS) if round_ else _near_half_turns())]
    if ratio.max() > LARGER:
        starts.append(_shifted(cloud, bases, target, ratio))
    if partial:
        turns = _turns(PATCH_CLOCKINGS)
        starts += [_laid(cloud, bases, patch, turns) for patch in _patches(cloud, target, target_points_mm)]
    return Starts(
        np.concatenate([s.rotations for s in starts]), np.concatenate([s.positions_mm for s in starts])
    )


def _plain_frame(points_mm: Array) -> Frame:
    """Return the principal frame of all points."""
    centre = points_mm.mean(axis=0)
    values, vectors = np.linalg.eigh(np.cov((points_mm - centre).T, bias=True))
    axes = vectors[:, ::-1].copy()
    axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
    return Frame(centre, axes, np.sqrt(np.maximum(values[::-1], 0.0)))


def _bases(cloud: Frame) -> list[Array]:
    """Return the axes of the cloud in every order that their spreads allow; the last one is the normal."""
    a, b, c = cloud.axes.T
    first, second, third = np.maximum(cloud.spread_mm, 1e-300)
    orders = [(a, b)]
    if second < _DEEP * third:  # a narrow curved strip, a deep bowl
        orders.append((a, c))
    if first < ALIKE**2 * third:  # nearly a ball
        orders.append((b, c))
    return [np.stack([u, v, np.cross(u, v)], axis=1) for u, v in orders]


def _turns(count: int) -> Array:
    """Return angles all around, rad."""
    return np.asarray(2.0 * np.pi * np.arange(count) / count, dtype=np.float64)


def _near_half_turns() -> Array:
    """Return no turn and the half turn, each with a neighbour to both sides, rad."""
    aside = 2.0 * np.pi / CLOCKINGS
    return np.array([h + s for h in (0.0, np.pi) for s in (0.0, -aside, aside)])


def _laid(cloud: Frame, bases: list[Array], target: Frame, turns_rad: Array) -> Starts:
    """Lay every basis of the cloud on a frame of the target, turned, and turned over."""
    rotations = []
    for basis in bases:
        for over in (np.eye(3), np.diag([1.0, -1.0, -1.0])):
            for angle in turns_rad:
                clock = rotation_from_vector(np.array([0.0, 0.0, angle]))
                rotations.append(target.axes @ clock @ over @ basis.T)
    stack = np.stack(rotations)
    return Starts(stack, target.centre_mm - stack @ cloud.centre_mm)


def _shifted(cloud: Frame, bases: list[Array], target: Frame, ratio: Array) -> Starts:
    """Lay other places than the middle of the cloud on the middle of the target."""
    parts = []
    for k in np.flatnonzero(ratio > LARGER):
        beyond = _EXTENT * float(cloud.spread_mm[k] - target.spread_mm[k])
        for sign in (-1.0, 1.0):
            centre = cloud.centre_mm + sign * beyond * cloud.axes[:, k]
            parts.append(_laid(cloud._replace(centre_mm=centre), bases, target, _turns(PATCH_CLOCKINGS)))
    return Starts(
        np.concatenate([p.rotations for p in parts]), np.concatenate([p.positions_mm for p in parts])
    )


def _patches(cloud: Frame, target: Frame, target_points_mm: Array) -> list[Frame]:
    """Return the principal frames of patches as large as the cloud, all over the target."""
    flat = (target_points_mm - target.centre_mm) @ target.axes[:, :2]
    low, high = flat.min(axis=0), flat.max(axis=0)
    pitch = float((high - low).max()) / LATTICE
    counts = np.maximum(2, np.round((high - low) / pitch).astype(int))
    sides = [np.linspace(low[k], high[k], 2 * counts[k] + 1)[1::2] for k in range(2)]
    places = np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 2)
    # A disc of this radius has the spread of the cloud; a strip is as long as its half length.
    radius = max(_EXTENT * float(cloud.spread_mm[0]), 0.5 * pitch)
    patches = []
    for place in places:
        away = np.linalg.norm(flat - place, axis=1)
        nodes = target_points_mm[away <= radius]
        if len(nodes) < 6 or float(away.min()) > pitch:
            continue
        frame = _plain_frame(nodes)
        patches.append(frame._replace(centre_mm=target_points_mm[int(np.argmin(away))]))
    return patches
