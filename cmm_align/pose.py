"""Rigid motions between named frames.

A pose is written ``target_from_source``: it takes coordinates in `source` and gives the same points
in `target`, ``p_target = R p_source + t``. Poses compose by adjacent names and refuse any other
order. Rotations are proper (det R = +1) always.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cmm_align.errors import InputError
from cmm_align.numerics.rotations import orthonormalised, rotation_from_vector, vector_from_rotation

Array = NDArray[np.float64]

__all__ = ["Pose", "orthonormalised", "rotation_from_vector", "vector_from_rotation"]

ORTHONORMAL_TOLERANCE: Final = 1e-6
"""Largest entry of R^T R - 1 that is taken for rounding of a printed matrix."""

_UNTURNED: Final = np.eye(3)


@dataclass(frozen=True, slots=True)
class Pose:
    """A rigid motion ``target_from_source``.

    Attributes
    ----------
    rotation : ndarray, shape (3, 3)
        Proper rotation.
    translation_mm : ndarray, shape (3,), mm, frame `target`
        Where the source's origin lies in the target frame.
    target, source : str
        Names of the frames.
    """

    rotation: Array
    translation_mm: Array
    target: str
    source: str

    @classmethod
    def identity(cls, target: str, source: str) -> Pose:
        """Return the motion that changes nothing but the frame's name."""
        return cls(np.eye(3), np.zeros(3), target, source)

    @classmethod
    def from_matrix(cls, matrix: Array, target: str, source: str, *, where: str = "") -> Pose:
        """Return the pose of a homogeneous matrix.

        Parameters
        ----------
        matrix : ndarray, shape (4, 4), mm
            ``[[R, t], [0, 1]]``.

        Raises
        ------
        InputError
            If the matrix is not a rigid motion, or mirrors.
        """
        matrix = np.asarray(matrix, dtype=np.float64)
        if matrix.shape != (4, 4) or not np.all(np.isfinite(matrix)):
            raise InputError("not a 4x4 matrix of numbers", where=where, expected="[[R, t], [0, 1]]")
        rotation = matrix[:3, :3]
        off = float(np.max(np.abs(rotation.T @ rotation - np.eye(3))))
        if off > ORTHONORMAL_TOLERANCE or not np.allclose(matrix[3], [0, 0, 0, 1]):
            raise InputError(f"not a rigid motion (R^T R is off by {off:.2g})", where=where)
        if np.linalg.det(rotation) < 0.0:
            raise InputError("the matrix mirrors", where=where, expected="det R = +1")
        return cls(orthonormalised(rotation), matrix[:3, 3].copy(), target, source)

    def matrix(self) -> Array:
        """Return the homogeneous matrix, shape (4, 4), mm."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.rotation
        matrix[:3, 3] = self.translation_mm
        return matrix

    def rotation_vector_rad(self) -> Array:
        """Return the rotation vector, shape (3,), rad."""
        return vector_from_rotation(self.rotation)

    def apply(self, points_mm: Array) -> Array:
        """Return points of frame `source` in frame `target`.

        Parameters
        ----------
        points_mm : ndarray, shape (N, 3), mm, frame `source`
        """
        return self.rotate(points_mm) + self.translation_mm

    def rotate(self, vectors: Array) -> Array:
        """Return directions of frame `source` in frame `target`, shape (N, 3)."""
        if np.array_equal(self.rotation, _UNTURNED):  # most nominals: no work, and no rounding
            return vectors
        result: Array = vectors @ self.rotation.T
        return result

    def inverse(self) -> Pose:
        """Return ``source_from_target``."""
        return Pose(self.rotation.T, -(self.rotation.T @ self.translation_mm), self.source, self.target)

    def __matmul__(self, other: Pose) -> Pose:
        """Compose: ``a_from_b @ b_from_c`` is ``a_from_c``; any other pair of names is refused."""
        if self.source != other.target:
            raise InputError(
                f"cannot compose {self.target}_from_{self.source} with {other.target}_from_{other.source}",
                expected="the inner frames to be the same",
            )
        return Pose(
            self.rotation @ other.rotation,
            self.rotation @ other.translation_mm + self.translation_mm,
            self.target,
            other.source,
        )
