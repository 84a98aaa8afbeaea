"""The rigid motion with a seventh unknown: how far, all in all, the points lie from the surface.

With the offset free the fit minimises the spread of the distances instead of their square. Where a surface
turns, a constant distance is no rigid motion and the offset is known; where it is nearly flat, it is not.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmm_align.numerics.fit_steps import stepped
from cmm_align.numerics.foot_point import Feet
from cmm_align.numerics.linearisation import Measure, Placement, evaluate, moved, rows_of

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_HELD: Final = 1e-6
"""Motions with less than this share of the largest eigenvalue stay as they are."""
_SETTLED: Final = 1e-8
"""A step this small beside the size ends the fit."""
_LONGEST: Final = 0.05
"""Longest step, in sizes."""
_HALVINGS: Final = 6
_MAX_STEPS: Final = 15


class FreeOffset(NamedTuple):
    """What a fit with a free offset found."""

    offset_mm: float
    """Mean distance of the points, mm."""
    rms_mm: float
    """RMS about that mean, mm."""
    leverage: float
    """RMS that an offset of one leaves after the best rigid motion: 0 for a plane, at most 1."""
    power: float
    """Correlation of what it leaves with what a sag of x^2 + y^2 leaves."""
    placement: Placement
    n: int
    """Points that counted."""


class _Look(NamedTuple):
    feet: Feet
    rows: Array
    distance_mm: Array
    flat: Array
    variance: float


def free_offset(
    measure: Measure, points_mm: Array, start: Placement, length_mm: float, size_mm: float, used: Mask
) -> FreeOffset:
    """Fit a rigid motion and a common offset.

    Parameters
    ----------
    measure : Measure
        Distance to the nominal itself: no tip radius taken off.
    points_mm : ndarray, shape (n, 3), mm
        About their centroid.
    start : Placement
        Of the fit with a stated offset.
    length_mm, size_mm : float
        Scale of the rotations and size of the part, mm.
    used : ndarray of bool, shape (n,)

    Notes
    -----
    Gauss-Newton with the mean taken off every column (Golub and Pereyra 1973, doi 10.1137/0710036: a linear
    unknown is eliminated). Motions that the data tell less than the offset itself are held.
    """
    placement = start
    feet = evaluate(measure, points_mm, placement, length_mm, used=used).feet
    now = _look(measure, points_mm, placement, length_mm, used, feet)
    for _ in range(_MAX_STEPS):
        step = _step(now)
        movement = float(np.linalg.norm(step))
        if not movement > _SETTLED * size_mm:
            break
        step *= min(1.0, _LONGEST * size_mm / movement)
        for _ in range(_HALVINGS):
            trial = stepped(placement, step, length_mm)
            there = _look(measure, points_mm, trial, length_mm, used, now.feet)
            if there.variance <= now.variance:
                break
            step = 0.5 * step
        else:
            break
        placement, now = trial, there
    leverage, power = leverage_of(now.rows.T, now.flat)
    return FreeOffset(
        float(now.distance_mm.mean()),
        float(np.sqrt(now.variance)),
        leverage,
        power,
        placement,
        len(now.distance_mm),
    )


def leverage_of(rows: Array, places_mm: Array) -> tuple[float, float]:
    """Return what a constant leaves of itself after the best rigid motion, and how far that looks like power.

    Parameters
    ----------
    rows : ndarray, shape (n, 6)
        Change of the distance for each motion, scaled.
    places_mm : ndarray, shape (n, 2), mm

    Returns
    -------
    leverage : float
        RMS left of an offset of one.
    power : float
        Correlation, from 0 to 1, with what is left of the squared distance from the centroid.
    """
    centred = places_mm - places_mm.mean(axis=0)
    bowl = np.sum(centred**2, axis=1)
    columns = np.stack([np.ones(len(rows)), bowl / max(float(bowl.max()), 1e-300)], axis=1)
    values, motions = np.linalg.eigh(rows.T @ rows)
    kept = motions[:, values > 1e-2 * _HELD * values[-1]]
    basis = np.linalg.qr(rows @ kept)[0]
    left = columns - basis @ (basis.T @ columns)
    rms = np.sqrt(np.mean(left**2, axis=0))
    if min(rms) <= 1e-12:
        return float(rms[0]), 1.0
    return float(rms[0]), abs(float(np.mean(left[:, 0] * left[:, 1]))) / float(rms[0] * rms[1])


def _look(
    measure: Measure, points_mm: Array, placement: Placement, length_mm: float, used: Mask, previous: Feet
) -> _Look:
    """Measure the used points under a placement."""
    p = moved(points_mm, placement)
    feet, _ = measure.distance(p, previous)
    counts = used & np.isfinite(feet.distance_mm)
    if np.count_nonzero(counts) <= 0.5 * np.count_nonzero(used):
        return _Look(previous, np.zeros((6, 0)), np.zeros(0), np.zeros((0, 2)), np.inf)
    rows = rows_of(p, placement, feet, length_mm)[:, counts]
    return _Look(
        feet, rows[:6], rows[6], np.stack([feet.x_mm, feet.y_mm], axis=1)[counts], float(np.var(rows[6]))
    )


def _step(now: _Look) -> Array:
    """Return the Gauss-Newton step for the spread of the distances, scaled."""
    n = len(now.distance_mm)
    strongest = float(np.linalg.eigvalsh(now.rows @ now.rows.T)[-1]) / n
    rows = now.rows - now.rows.mean(axis=1, keepdims=True)
    values, motions = np.linalg.eigh(rows @ rows.T / n)
    keep = values > _HELD * strongest
    pull = motions[:, keep].T @ (rows @ (now.distance_mm - now.distance_mm.mean())) / n
    step: Array = -motions[:, keep] @ (pull / values[keep])
    return step
