"""Made-up corrections whose commanded surface is a closed form: nominal, corrected surface, grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cmm_align.model import Correction, Nominal, Statistics, frozen_array
from cmm_align.pose import Pose
from cmm_align.surfaces.geometry import unit_normal
from cmm_align.surfaces.protocol import Array, Bounds, Jet, Mask, Surface

NO_STATISTICS = Statistics(1, 0.0, 0.0, 0.0, 0.0, 0.0, (0.0, 0.0), (0.0, 0.0))
ON_ITS_SIDE = Pose(
    np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]), np.zeros(3), "surface", "part"
)
"""Projected along x of the part."""


@dataclass(frozen=True)
class Bowl:
    """The lower half of a sphere with its lowest point at the origin; a dome for a negative radius."""

    radius_mm: float = 60.0
    half_x: float = 20.0
    half_y: float = 15.0
    round: bool = False
    kind: str = "prescription"

    @property
    def bounds(self) -> Bounds:
        return Bounds(-self.half_x, self.half_x, -self.half_y, self.half_y)

    def jet(self, x_mm: Array, y_mm: Array) -> Jet:
        r = self.radius_mm
        w = np.sign(r) * np.sqrt(r * r - x_mm**2 - y_mm**2)
        return Jet(
            r - w,
            x_mm / w,
            y_mm / w,
            (w**2 + x_mm**2) / w**3,
            x_mm * y_mm / w**3,
            (w**2 + y_mm**2) / w**3,
        )

    def contains(self, x_mm: Array, y_mm: Array) -> Mask:
        u, v = np.abs(x_mm) / self.half_x, np.abs(y_mm) / self.half_y
        return (u**2 + v**2 <= 1.0 + 1e-9) if self.round else ((u <= 1.0 + 1e-9) & (v <= 1.0 + 1e-9))


@dataclass(frozen=True)
class Rippled:
    """A surface with a wave added along z."""

    base: Surface
    amplitude_mm: float = 0.005
    wave_mm: float = 20.0
    kind: str = "prescription"

    @property
    def bounds(self) -> Bounds:
        return self.base.bounds

    def jet(self, x_mm: Array, y_mm: Array) -> Jet:
        j, k, a = self.base.jet(x_mm, y_mm), 2.0 * np.pi / self.wave_mm, self.amplitude_mm
        cx, sx, cy, sy = np.cos(k * x_mm), np.sin(k * x_mm), np.cos(k * y_mm), np.sin(k * y_mm)
        return Jet(
            j.z + a * cx * cy,
            j.zx - a * k * sx * cy,
            j.zy - a * k * cx * sy,
            j.zxx - a * k * k * cx * cy,
            j.zxy + a * k * k * sx * sy,
            j.zyy - a * k * k * cx * cy,
        )

    def contains(self, x_mm: Array, y_mm: Array) -> Mask:
        return self.base.contains(x_mm, y_mm)


def correction_to(
    corrected: Surface,
    nominal: Surface | None = None,
    *,
    step_mm: float = 0.5,
    side: int = 1,
    surface_from_part: Pose | None = None,
) -> Correction:
    """The correction that commands one surface where another one (itself by default) is nominal."""
    surface = nominal or corrected
    b = surface.bounds
    x, y = (
        low + step_mm * np.arange(round((high - low) / step_mm) + 1)
        for low, high in ((b.x_min, b.x_max), (b.y_min, b.y_max))
    )
    xg, yg = np.meshgrid(x, y)
    inside = surface.contains(xg.ravel(), yg.ravel()).reshape(xg.shape)
    jet, now = surface.jet(xg, yg), corrected.jet(xg, yg)
    total = (now.z - jet.z) * unit_normal(jet, side)[..., 2]
    return Correction(
        nominal=Nominal(surface, side, 1.5, surface_from_part or Pose.identity("surface", "part"), "0" * 64),
        x_mm=frozen_array(x),
        y_mm=frozen_array(y),
        correction_mm=frozen_array(np.where(inside, total, np.nan)),
        total_correction_mm=frozen_array(np.where(inside, total, np.nan)),
        commanded_z_mm=frozen_array(np.where(inside, now.z, np.nan)),
        commanded_normal=frozen_array(np.where(inside[..., None], unit_normal(now, side), np.nan)),
        extended=frozen_array(np.zeros_like(inside), np.bool_),
        gain=1.0,
        pass_number=1,
        predicted=NO_STATISTICS,
        before=NO_STATISTICS,
        worth_another_pass=True,
        reason="made up",
        map_digest="0" * 64,
    )
