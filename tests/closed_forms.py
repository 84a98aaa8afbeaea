"""Surfaces whose distance, foot point, curvature and equidistant surface are known in closed form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cmm_align.surfaces.protocol import Bounds, Jet


@dataclass(frozen=True)
class ClosedForm:
    """A height field over a square; subclasses give the jet."""

    half_mm: float = 20.0
    kind: str = "prescription"

    @property
    def bounds(self):
        return Bounds(-self.half_mm, self.half_mm, -self.half_mm, self.half_mm)

    def contains(self, x_mm, y_mm):
        return (np.abs(x_mm) <= self.half_mm + 1e-9) & (np.abs(y_mm) <= self.half_mm + 1e-9)


@dataclass(frozen=True)
class Plane(ClosedForm):
    """z = a x + b y."""

    a: float = 0.3
    b: float = -0.2

    def jet(self, x, y):
        zero = np.zeros(np.shape(x))
        return Jet(self.a * x + self.b * y, zero + self.a, zero + self.b, zero, zero, zero)


@dataclass(frozen=True)
class Sphere(ClosedForm):
    """Cap of a sphere of radius |R| with its vertex at the origin; R > 0 is a bowl (concave upwards)."""

    radius_mm: float = 50.0

    def jet(self, x, y):
        s = np.sqrt(self.radius_mm**2 - x * x - y * y)
        sign = np.sign(self.radius_mm)
        z = sign * (abs(self.radius_mm) - s)
        return Jet(
            z,
            sign * x / s,
            sign * y / s,
            sign * (1 / s + x * x / s**3),
            sign * x * y / s**3,
            sign * (1 / s + y * y / s**3),
        )

    @property
    def centre(self):
        return np.array([0.0, 0.0, self.radius_mm])


@dataclass(frozen=True)
class Cylinder(ClosedForm):
    """Top of a cylinder about an axis along y, radius R, vertex line at z = 0."""

    radius_mm: float = 60.0

    def jet(self, x, y):
        s = np.sqrt(self.radius_mm**2 - x * x)
        zero = np.zeros(np.shape(x))
        return Jet(s - self.radius_mm, -x / s, zero, -1 / s - x * x / s**3, zero, zero)


@dataclass(frozen=True)
class Paraboloid(ClosedForm):
    """z = (x^2 / a + y^2 / b) / 2: of revolution if a = b."""

    a_mm: float = 60.0
    b_mm: float = 60.0

    def jet(self, x, y):
        one = np.ones(np.shape(x))
        z = 0.5 * (x * x / self.a_mm + y * y / self.b_mm)
        return Jet(z, x / self.a_mm, y / self.b_mm, one / self.a_mm, 0.0 * one, one / self.b_mm)


@dataclass(frozen=True)
class Torus(ClosedForm):
    """Outer top of a torus: profile radius r in yz swept about an axis parallel to y at z = -(R + r)."""

    major_mm: float = 80.0
    minor_mm: float = 40.0

    def jet(self, x, y):
        # rho(y) = R + sqrt(r^2 - y^2) is the distance from the axis; z = sqrt(rho^2 - x^2) - (R + r).
        t = np.sqrt(self.minor_mm**2 - y * y)
        rho = self.major_mm + t
        rho_y = -y / t
        rho_yy = -1 / t - y * y / t**3
        h = np.sqrt(rho * rho - x * x)
        h_y = rho * rho_y / h
        return Jet(
            h - (self.major_mm + self.minor_mm),
            -x / h,
            h_y,
            -1 / h - x * x / h**3,
            x * h_y / h**2,
            (rho_y**2 + rho * rho_yy) / h - h_y**2 / h,
        )

    def offset(self, r):
        """The equidistant surface is the torus with a larger profile."""
        return Torus(self.half_mm, self.kind, self.major_mm, self.minor_mm + r)


def finite_difference_jet(surface, x, y, h=1e-4):
    """Derivatives of the height and of the stated gradient, by central differences."""
    east, west, north, south = (surface.jet(x + dx, y + dy) for dx, dy in ((h, 0), (-h, 0), (0, h), (0, -h)))
    return Jet(
        surface.jet(x, y).z,
        (east.z - west.z) / (2 * h),
        (north.z - south.z) / (2 * h),
        (east.zx - west.zx) / (2 * h),
        (north.zx - south.zx) / (2 * h),
        (north.zy - south.zy) / (2 * h),
    )
