"""What steers a fit beside the distances: weights, locked motions, places that the part is known to have.

*Weights* multiply the squared distance of a point. *Locks* take motions out of the problem: the columns are
dropped before it is solved, and what is left is solved for the best, which is not what a solution with some
of its numbers set to zero would be. *Datum terms* are further rows: places of the part (fiducials) that are
known with some uncertainty.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmm_align.numerics.rotations import left_jacobian, rotation_from_vector, vector_from_rotation

Array = NDArray[np.float64]

AXES: Final = ("rx", "ry", "rz", "tx", "ty", "tz")
"""The six motions, in the order of all matrices."""


class Placement(NamedTuple):
    """Where the measured cloud lies: ``p = rotation (q - centroid) + position``."""

    rotation: Array
    position_mm: Array


class Lock(NamedTuple):
    """Motions that stay as they are at the start, in a frame of their own.

    The motion away from the start is ``p -> R(w) (p - centre) + centre + t``; locked components of w and t,
    along the axes of the frame, are zero.
    """

    start: Placement
    axes: Array
    """Axes of the frame as columns, shape (3, 3), frame `surface`."""
    centre_mm: Array
    """What rotations turn about, shape (3,), mm, frame `surface`."""
    locked: NDArray[np.bool_]
    """Which of (rx, ry, rz, tx, ty, tz), shape (6,)."""


class DatumTerms(NamedTuple):
    """Places that are known softly: each row wants ``direction . (place - target)`` to be zero."""

    points_mm: Array
    """As measured, about the centroid of the cloud, shape (m, 3), mm."""
    targets_mm: Array
    """Where they should be, shape (m, 3), mm, frame `surface`."""
    directions: Array
    """Unit vectors, shape (m, 3), frame `surface`."""
    weights: Array
    """How many points of the surface each row counts for, shape (m,)."""


class Steering(NamedTuple):
    """What steers a fit beside the distances; nothing by default."""

    weights: Array | None = None
    """Weight of each point, shape (n,), not negative."""
    datum: DatumTerms | None = None
    lock: Lock | None = None

    def of(self, pick: NDArray[np.intp]) -> Steering:
        """Return the steering of the points with these indices, shape (k,)."""
        return self if self.weights is None else self._replace(weights=self.weights[pick])


FREELY: Final = Steering()


def datum_rows(datum: DatumTerms, placement: Placement, length_mm: float) -> Array:
    """Return the rows of the datum terms, shape (7, m): six motions and the distance to the target.

    Parameters
    ----------
    datum : DatumTerms
    placement : Placement
    length_mm : float
        Scale of the rotation columns, mm.
    """
    arm = datum.points_mm @ placement.rotation.T
    rows = np.empty((7, len(arm)))
    rows[:3] = np.cross(arm, datum.directions).T / length_mm
    rows[3:6] = datum.directions.T
    rows[6] = np.einsum("ij,ij->i", datum.directions, arm + placement.position_mm - datum.targets_mm)
    return rows


def _away(lock: Lock, placement: Placement) -> tuple[Array, Array, Array]:
    """Return rotation vector and shift from the start, along the axes of the lock, and the moved centre."""
    w = vector_from_rotation(placement.rotation @ lock.start.rotation.T)
    arm = lock.start.rotation.T @ (lock.centre_mm - lock.start.position_mm)
    centre = placement.rotation @ arm + placement.position_mm
    return lock.axes.T @ w, lock.axes.T @ (centre - lock.centre_mm), centre


def allowed_motions(lock: Lock | None, placement: Placement, length_mm: float) -> Array:
    """Return an orthonormal basis of the motions that the lock leaves, shape (6, k), scaled.

    Parameters
    ----------
    lock : Lock or None
        None leaves all six.
    placement : Placement
        Where the cloud lies now.
    length_mm : float
        Scale of the rotations, mm.
    """
    if lock is None:
        return np.eye(6)
    w, _, centre = _away(lock, placement)
    turns = left_jacobian(lock.axes @ w) @ lock.axes[:, ~lock.locked[:3]]
    shifts = lock.axes[:, ~lock.locked[3:]]
    arm = placement.position_mm - centre
    basis = np.zeros((6, turns.shape[1] + shifts.shape[1]))
    basis[:3, : turns.shape[1]] = turns * length_mm
    basis[3:, : turns.shape[1]] = np.cross(turns.T, arm).T
    basis[3:, turns.shape[1] :] = shifts
    return np.asarray(np.linalg.qr(basis)[0], dtype=np.float64)


def held(lock: Lock | None, placement: Placement) -> Placement:
    """Return the placement with its locked motions exactly as at the start.

    A step along the allowed motions leaves them by its square; this takes the square back.

    Parameters
    ----------
    lock : Lock or None
    placement : Placement
    """
    if lock is None:
        return placement
    w, t, _ = _away(lock, placement)
    w, t = np.where(lock.locked[:3], 0.0, w), np.where(lock.locked[3:], 0.0, t)
    turn = rotation_from_vector(lock.axes @ w)
    arm = lock.start.position_mm - lock.centre_mm
    return Placement(turn @ lock.start.rotation, turn @ arm + lock.centre_mm + lock.axes @ t)
