"""Where a grinding wheel stands when it touches a surface: spheres and tori.

With the contact P and the unit normal n out of the material, the centre of a spherical wheel of radius R
is ``C = P + R n``. A toroidal wheel (largest radius R, rim of radius r, axis a) is all that lies within r
of a disc of radius ``R - r`` across a; its centre is

    C = P + r n + (R - r) m,    m = n_p / |n_p|,    n_p = n - (n . a) a.

Both are P plus the gradient of the wheel's support function at n, so the surface on which the centres lie
has the normal n too (R. Schneider, "Convex Bodies: The Brunn-Minkowski Theory", 2014, section 2.5): the way
back needs nothing but the centres. The curvatures of the torus at the contact are ``1/r`` in the plane of
a and n and ``c / (R - r + r c)`` across it, ``c = |n_p|`` (do Carmo, section 3-3, example 6).

What it does not do: shanks, spindles, cup wheels that touch with their flat face.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cmm_align.errors import GeometryError

Array = NDArray[np.float64]

FLAT: Final = 0.05
"""Least sine between normal and axis of a torus: nearer to its flat face the contact runs off."""


@dataclass(frozen=True, slots=True)
class Wheel:
    """A spherical or toroidal grinding wheel.

    Attributes
    ----------
    radius_mm : float
        Where it is largest.
    tip_radius_mm : float
        Of the rounded rim; 0 for a sphere.
    axis : tuple of float
        Unit vector that a torus turns about, in the frame of the normals it is used with.
    """

    radius_mm: float
    tip_radius_mm: float = 0.0
    axis: tuple[float, float, float] = (0.0, 1.0, 0.0)

    @property
    def is_sphere(self) -> bool:
        """Return whether the axis does not matter."""
        return self.tip_radius_mm in {0.0, self.radius_mm}

    @property
    def words(self) -> str:
        """Return the wheel in words."""
        if self.is_sphere:
            return f"sphere, radius {self.radius_mm:g} mm"
        axis = ", ".join(f"{a:.6g}" for a in self.axis)
        return f"torus, radius {self.radius_mm:g} mm, rim {self.tip_radius_mm:g} mm, axis ({axis})"


def centre_from_contact(wheel: Wheel, normals: Array) -> Array:
    """Return the vectors from contact to tool centre.

    Parameters
    ----------
    wheel : Wheel
    normals : ndarray, shape (n, 3)
        Unit normals out of the material at the contacts.

    Returns
    -------
    ndarray, shape (n, 3), mm
        Exact to rounding; NaN where a normal is NaN.

    Raises
    ------
    GeometryError
        If a torus would touch with its flat face.
    """
    if wheel.is_sphere:
        return np.asarray(wheel.radius_mm * normals)
    axis = np.asarray(wheel.axis)
    across = normals - (normals @ axis)[:, None] * axis
    sine = np.linalg.norm(across, axis=1)
    if np.any(sine < FLAT):
        worst = normals[int(np.nanargmin(sine))]
        raise GeometryError(
            f"the wheel would touch with its flat face where the normal is "
            f"({worst[0]:.4f}, {worst[1]:.4f}, {worst[2]:.4f})",
            expected=f"a sine of at least {FLAT:g} between normal and axis of the wheel",
            remedy="check --wheel-axis",
        )
    ring = (wheel.radius_mm - wheel.tip_radius_mm) / sine
    return np.asarray(wheel.tip_radius_mm * normals + ring[:, None] * across)


def distance_to_wheel(wheel: Wheel, from_centre_mm: Array) -> Array:
    """Return how far points are outside the wheel, negative inside.

    Parameters
    ----------
    wheel : Wheel
    from_centre_mm : ndarray, shape (..., 3), mm
        From the tool centre to the points.

    Returns
    -------
    ndarray, shape (...), mm
    """
    if wheel.is_sphere:
        return np.asarray(np.linalg.norm(from_centre_mm, axis=-1) - wheel.radius_mm)
    height = from_centre_mm @ np.asarray(wheel.axis)
    square = np.einsum("...i,...i->...", from_centre_mm, from_centre_mm) - height**2
    past = np.sqrt(np.maximum(square, 0.0)) - (wheel.radius_mm - wheel.tip_radius_mm)
    return np.asarray(np.hypot(np.maximum(past, 0.0), height) - wheel.tip_radius_mm)


def fill_of_wheel(wheel: Wheel, normals: Array, hessian_per_mm: tuple[Array, Array, Array]) -> Array:
    """Return which share of the wheel's curvature a height field has, in the worst direction.

    Parameters
    ----------
    wheel : Wheel
        Axis in the frame of the height field.
    normals : ndarray, shape (n, 3)
        Unit normals out of the material; the sign of n_z is the side of the wheel.
    hessian_per_mm : tuple of ndarray, each of shape (n,), 1/mm
        z_xx, z_xy and z_yy.

    Returns
    -------
    ndarray, shape (n,)
        The wheel fits where it is below 1; negative where the surface is convex all round.
    """
    nx, ny, nz = np.ascontiguousarray(normals.T)
    ax, ay, az = (1.0, 0.0, 0.0) if wheel.is_sphere else wheel.axis  # a sphere has every axis
    second_x, second_y, second_z = ay * nz - az * ny, az * nx - ax * nz, ax * ny - ay * nx
    sine = np.sqrt(second_x**2 + second_y**2 + second_z**2)
    second_x, second_y, second_z = second_x / sine, second_y / sine, second_z / sine
    first_x, first_y = second_y * nz - second_z * ny, second_z * nx - second_x * nz
    if wheel.is_sphere:
        bent_first = bent_second = np.full(len(nx), 1.0 / wheel.radius_mm)
    else:
        r = wheel.tip_radius_mm
        bent_first = np.full(len(nx), 1.0 / r)
        bent_second = sine / (wheel.radius_mm - r + r * sine)
    xx, xy, yy = (nz * h for h in hessian_per_mm)  # the second form of xy components of tangents
    a = (xx * first_x**2 + 2.0 * xy * first_x * first_y + yy * first_y**2) / bent_first
    b = (xx * second_x**2 + 2.0 * xy * second_x * second_y + yy * second_y**2) / bent_second
    c = xx * first_x * second_x + xy * (first_x * second_y + first_y * second_x) + yy * first_y * second_y
    c /= np.sqrt(bent_first * bent_second)
    return np.asarray(0.5 * (a + b) + np.hypot(0.5 * (a - b), c))
