"""Made-up measurements whose answer is known: a closed-form surface, a form error, noise, an alignment."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cmm_align.model import Alignment, FitReport, Nominal, frozen_array
from cmm_align.pose import Pose
from cmm_align.surfaces.geometry import unit_normal
from cmm_align.surfaces.protocol import Array, Bounds, Jet, Mask

Field = Callable[[Array, Array], Array]


@dataclass(frozen=True)
class Quadric:
    """z = a x + b y + c x^2 + d y^2 on a rectangle, or on the ellipse in it."""

    half_x: float = 51.0
    half_y: float = 31.0
    a: float = 0.0
    b: float = 0.0
    c: float = 0.0
    d: float = 0.0
    round: bool = False
    kind: str = "prescription"

    @property
    def bounds(self) -> Bounds:
        return Bounds(-self.half_x, self.half_x, -self.half_y, self.half_y)

    def jet(self, x_mm: Array, y_mm: Array) -> Jet:
        one = np.ones_like(x_mm)
        return Jet(
            self.a * x_mm + self.b * y_mm + self.c * x_mm**2 + self.d * y_mm**2,
            self.a + 2 * self.c * x_mm,
            self.b + 2 * self.d * y_mm,
            2 * self.c * one,
            0 * one,
            2 * self.d * one,
        )

    def contains(self, x_mm: Array, y_mm: Array) -> Mask:
        u, v = np.abs(x_mm) / self.half_x, np.abs(y_mm) / self.half_y
        slack = 1.0 + 1e-9
        return (u**2 + v**2 <= slack) if self.round else ((u <= slack) & (v <= slack))


PLANE = Quadric()
WINDOW = Quadric(c=0.008, d=0.006)
"""Slopes to 42 degrees."""
SLOPE_45 = Quadric(a=1.0)


def form_error_mm(x: Array, y: Array) -> Array:
    """A smooth form error like that of a first grinding pass, about 27 um PV on 102 x 62 mm."""
    u, v = x / 51.0, y / 31.0
    value = (
        0.55 * (u**2 - v**2)
        + 0.30 * u * v
        + 0.25 * (u**3 - 3 * u * v**2)
        + 0.22 * np.cos(5.0 * u + 1.0) * np.cos(3.0 * v)
        + 0.30 * np.exp(-((x - 20.0) ** 2 + (y + 8.0) ** 2) / (2 * 9.0**2))
    )
    return 0.0135 * value


def random_places(surface: Quadric, n: int, seed: int = 0) -> tuple[Array, Array]:
    """n places at random over the aperture."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(-surface.half_x, surface.half_x, 2 * n)
    y = rng.uniform(-surface.half_y, surface.half_y, 2 * n)
    inside = surface.contains(x, y)
    return x[inside][:n], y[inside][:n]


def aligned(
    surface: Quadric,
    error: Field,
    places: tuple[Array, Array],
    *,
    side: int = 1,
    noise_mm: float = 0.0,
    seed: int = 1,
    tip_radius_mm: float = 1.5,
    surface_from_part: Pose | None = None,
    digest: str = "0" * 64,
) -> Alignment:
    """The alignment of a perfect fit: foot points at `places`, deviations the error plus white noise."""
    turn = surface_from_part or Pose.identity("surface", "part")
    x, y = places
    jet = surface.jet(x, y)
    n = unit_normal(jet, side)
    e = error(x, y) + noise_mm * np.random.default_rng(seed).standard_normal(len(x))
    foot = np.stack([x, y, jet.z], axis=1)
    back = turn.inverse()
    centre = back.apply(foot + (tip_radius_mm + e)[:, None] * n)
    return Alignment(
        nominal=Nominal(surface, side, tip_radius_mm, turn, digest),
        part_from_machine=Pose.identity("part", "machine"),
        covariance=frozen_array(np.zeros((6, 6))),
        tip_centre_machine_mm=frozen_array(centre),
        tip_centre_part_mm=frozen_array(centre),
        contact_part_mm=frozen_array(back.apply(foot + e[:, None] * n)),
        normals=frozen_array(back.rotate(n)),
        deviation_mm=frozen_array(e),
        used=frozen_array(np.ones(len(x)), np.bool_),
        judged=frozen_array(np.ones(len(x)), np.bool_),
        status=frozen_array(np.zeros(len(x)), np.uint8),
        ids=frozen_array(np.arange(len(x)), np.int64),
        report=FitReport(1, "made up", True, (), {}, 0.0, "smooth", 0, 0),
    )
