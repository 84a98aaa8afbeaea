"""Gauss-Newton for many placements of few points at once, and the score that ranks them.

All placements share one call of the measure and one batched eigen-decomposition, so a thousand starts cost
about as much as one placement of as many points. Nothing is guarded by halving: the best placement that each
start has seen is kept.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmm_align.numerics.chunked import CHUNK
from cmm_align.numerics.fit_steps import FitSettings
from cmm_align.numerics.linearisation import Measure
from cmm_align.numerics.outliers import MAD_SIGMA
from cmm_align.numerics.pose_starts import Starts

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

TRIMMED: Final = 0.8
"""Share of the points that a score listens to: the nearest ones, so that a tenth of strays is not heard."""
_STRAY: Final = 3.0 * MAD_SIGMA
"""Points beyond this many median distances do not pull."""
_DAMPING: Final = 1e-6
"""Share of the strongest motion's eigenvalue that is added to all: free motions stay."""
_LEAST_INSIDE: Final = 0.05
_SETTLED: Final = 1e-5
"""A placement that moves by less than this share of the size has arrived."""
_LOST: Final = 0.1
"""A placement with a smaller share of points inside, after some steps, has slid off for good."""
_PATIENCE: Final = 2


def fixed_order(n: int) -> NDArray[np.intp]:
    """Return 0 ... n - 1 well mixed, always in the same way: no start of it follows the scan lines.

    Parameters
    ----------
    n : int

    Notes
    -----
    Sorted by the finaliser of SplitMix64 (Steele, Lea, Flood 2014, doi 10.1145/2660193.2660195).
    """
    z = (np.arange(n, dtype=np.uint64) + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.argsort(z ^ (z >> np.uint64(31)), kind="stable")


class Settled(NamedTuple):
    """Where many starts have ended."""

    starts: Starts
    score_mm: Array
    """Shape (k,): see `scores`."""
    iterations: int


def scores(distance_mm: Array, inside: Mask) -> Array:
    """Return how badly placements fit: trimmed RMS of the distances over the share of points inside.

    Parameters
    ----------
    distance_mm : ndarray, shape (k, n), mm
        Past the border, distances to the continuation: a cloud that slides off finds no rest there.
    inside : ndarray of bool, shape (k, n)

    Returns
    -------
    ndarray, shape (k,), mm
        A cloud half off the target scores twice its RMS.
    """
    n = distance_mm.shape[1]
    heard = max(min(6, n), round(TRIMMED * n))
    square = np.nan_to_num(distance_mm, nan=np.inf) ** 2
    nearest = np.partition(square, heard - 1, axis=1)[:, :heard]
    share = np.maximum(inside.mean(axis=1), _LEAST_INSIDE)
    result: Array = np.sqrt(nearest.mean(axis=1)) / share
    return result


def settle(
    measure: Measure, points_mm: Array, starts: Starts, settings: FitSettings, iterations: int
) -> Settled:
    """Move every start downhill, all at once.

    Parameters
    ----------
    measure : Measure
        With a continuation past the border (facets).
    points_mm : ndarray, shape (n, 3), mm
        A few dozen to a few hundred points about their centroid.
    starts : Starts
    settings : FitSettings
        Size, length and largest rotation per step are used.
    iterations : int
        Most steps.
    """
    rotation, position = starts.rotations.copy(), starts.positions_mm.copy()
    best_rotation, best_position = rotation.copy(), position.copy()
    best = np.full(len(rotation), np.inf)
    on_the_way = np.arange(len(rotation))
    done = 0
    while len(on_the_way):
        arm = np.einsum("kij,nj->kni", rotation[on_the_way], points_mm)
        distance, inside, normal = _measured(measure, arm + position[on_the_way, None, :])
        score = scores(distance, inside)
        better = score < best[on_the_way]
        won = on_the_way[better]
        best[won], best_rotation[won], best_position[won] = score[better], rotation[won], position[won]
        if done == iterations:
            break
        step = _steps(arm, distance, normal, settings)
        rotation[on_the_way] = rotations_from_vectors(step[:, :3] / settings.length_mm) @ rotation[on_the_way]
        position[on_the_way] += step[:, 3:]
        done += 1
        moving = np.abs(step).max(axis=1) > _SETTLED * settings.size_mm
        lost = (inside.mean(axis=1) < _LOST) & (done > _PATIENCE)
        on_the_way = on_the_way[moving & ~lost]
    return Settled(Starts(best_rotation, best_position), best, done)


def rotations_from_vectors(vectors_rad: Array) -> Array:
    """Return the rotation matrices of rotation vectors, shape (k, 3, 3), by way of unit quaternions.

    Parameters
    ----------
    vectors_rad : ndarray, shape (k, 3), rad
    """
    angle = np.linalg.norm(vectors_rad, axis=1)
    w = np.cos(0.5 * angle)
    x, y, z = (0.5 * np.sinc(0.5 * angle / np.pi)[:, None] * vectors_rad).T
    rows = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
    ]
    return np.asarray(np.moveaxis(np.array(rows), 2, 0), dtype=np.float64)


def _measured(measure: Measure, p: Array) -> tuple[Array, Mask, Array]:
    """Return distances (k, n), who lies inside (k, n) and normals (k, n, 3)."""
    k, n, _ = p.shape
    flat = p.reshape(-1, 3)
    parts = [measure.distance(flat[i : i + CHUNK], None) for i in range(0, len(flat), CHUNK)]
    distance = np.concatenate([feet.distance_mm for feet, _ in parts]).reshape(k, n)
    normal = np.concatenate([feet.normal for feet, _ in parts]).reshape(k, n, 3)
    return distance, np.concatenate([mask for _, mask in parts]).reshape(k, n), normal


def _steps(arm: Array, distance: Array, normal: Array, settings: FitSettings) -> Array:
    """Return the clamped step (w length, t) of every placement, shape (k, 6), mm."""
    size = np.abs(distance)
    weight = np.isfinite(distance) & (size <= _STRAY * np.nanmedian(size, axis=1, keepdims=True))
    rows = np.concatenate([np.cross(arm, normal) / settings.length_mm, normal], axis=2)
    rows = np.where(weight[:, :, None], rows, 0.0)
    values = np.where(weight, distance, 0.0)
    across = rows.transpose(0, 2, 1)
    matrix = across @ rows
    pull = (across @ values[:, :, None])[:, :, 0]
    strongest = np.trace(matrix, axis1=1, axis2=2)[:, None, None]
    matrix = matrix + (_DAMPING * strongest + 1e-300) * np.eye(6)
    step: Array = -np.linalg.solve(matrix, pull[:, :, None])[:, :, 0]
    turn = np.linalg.norm(step[:, :3], axis=1) / settings.length_mm
    share = np.minimum(1.0, settings.max_rotation_rad / np.maximum(turn, 1e-300))
    far = share < 1.0
    if far.any():  # with the rotation clamped, the translation is solved anew
        step[far, :3] *= share[far, None]
        rest = pull[far] + (matrix[far] @ np.pad(step[far, :3], ((0, 0), (0, 3)))[:, :, None])[:, :, 0]
        step[far, 3:] = -np.linalg.solve(matrix[far][:, 3:, 3:], rest[:, 3:, None])[:, :, 0]
    length = np.linalg.norm(step[:, 3:], axis=1, keepdims=True)
    step[:, 3:] *= np.minimum(1.0, 0.5 * settings.size_mm / np.maximum(length, 1e-300))
    return step
