"""Rotation matrices and rotation vectors."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_SMALL_ANGLE_RAD: Final = 1e-4


def rotation_from_vector(vector_rad: Array) -> Array:
    """Return the rotation matrix of a rotation vector (Rodrigues' formula).

    Parameters
    ----------
    vector_rad : ndarray, shape (3,), rad
        Axis times angle, right-handed.

    Returns
    -------
    ndarray, shape (3, 3)
        Orthonormal to a few ulp for any angle.
    """
    angle = float(np.linalg.norm(vector_rad))
    x, y, z = (float(v) for v in vector_rad)
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    if angle < _SMALL_ANGLE_RAD:  # series: the quotients lose digits near zero
        a = 1.0 - angle**2 / 6.0
        b = 0.5 - angle**2 / 24.0
    else:
        a = np.sin(angle) / angle
        b = (1.0 - np.cos(angle)) / angle**2
    return orthonormalised(np.eye(3) + a * skew + b * (skew @ skew))


def vector_from_rotation(rotation: Array) -> Array:
    """Return the rotation vector of a rotation matrix, angle in [0, pi].

    Parameters
    ----------
    rotation : ndarray, shape (3, 3)
        A proper rotation.

    Returns
    -------
    ndarray, shape (3,), rad
        Axis times angle. By way of the quaternion, which is accurate at every angle.
    """
    m = rotation
    # The largest of the four squared components is computed first (Shepperd, 1978).
    squares = np.array(
        [
            1.0 + m[0, 0] + m[1, 1] + m[2, 2],
            1.0 + m[0, 0] - m[1, 1] - m[2, 2],
            1.0 - m[0, 0] + m[1, 1] - m[2, 2],
            1.0 - m[0, 0] - m[1, 1] + m[2, 2],
        ]
    )
    sums = np.array(
        [
            [0.0, m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]],
            [m[2, 1] - m[1, 2], 0.0, m[0, 1] + m[1, 0], m[0, 2] + m[2, 0]],
            [m[0, 2] - m[2, 0], m[0, 1] + m[1, 0], 0.0, m[1, 2] + m[2, 1]],
            [m[1, 0] - m[0, 1], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], 0.0],
        ]
    )
    k = int(np.argmax(squares))
    quaternion = sums[k] + 0.0
    quaternion[k] = squares[k]
    quaternion /= np.linalg.norm(quaternion)
    if quaternion[0] < 0.0:
        quaternion = -quaternion
    sine = float(np.linalg.norm(quaternion[1:]))
    if sine == 0.0:
        return np.zeros(3)
    angle = 2.0 * np.arctan2(sine, quaternion[0])
    vector: Array = quaternion[1:] * (angle / sine)
    return vector


def orthonormalised(rotation: Array) -> Array:
    """Return the proper rotation nearest to `rotation` (polar factor by SVD).

    Parameters
    ----------
    rotation : ndarray, shape (3, 3)
        Near a rotation.
    """
    u, _, vt = np.linalg.svd(rotation)
    result: Array = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    return result


def left_jacobian(w: Array) -> Array:
    """Return V(w), shape (3, 3): a steady twist (w, t) displaces the point it turns about by V t.

    Parameters
    ----------
    w : ndarray, shape (3,), rad
    """
    angle = float(np.linalg.norm(w))
    x, y, z = (float(value) for value in w)
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    if angle < _SMALL_ANGLE_RAD:
        a, b = 0.5, 1.0 / 6.0
    else:
        a = (1.0 - float(np.cos(angle))) / angle**2
        b = (angle - float(np.sin(angle))) / angle**3
    result: Array = np.eye(3) + a * skew + b * (skew @ skew)
    return result
