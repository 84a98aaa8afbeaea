"""The forward model: a window measured with every answer known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmm_align.pose import Pose
from cmm_align.surfaces.geometry import unit_normal
from cmm_align.surfaces.protocol import Surface
from cmm_align.virtual.cmm import machine_from_part, scan_lines, tip_centres
from cmm_align.virtual.form_error import form_error
from cmm_align.virtual.window import TIP_RADIUS_MM, window

Array = NDArray[np.float64]

DOME = """
schema = "cmm-align/prescription/1"
[aperture]
shape = "rectangle"
width = 60.0
height = 40.0
[[term]]
kind = "conic"
radius = -60.0
conic = -0.3
[[term]]
kind = "xy_polynomial"
coefficients = { "1,0" = 0.02, "3,0" = 8e-5, "2,1" = 6e-5, "0,3" = -8e-5, "2,0" = -2e-3 }
"""
"""A small steep freeform."""


@dataclass(frozen=True)
class Truth:
    """Synthetic tip centres and what is behind them."""

    surface: Surface
    machine_from_part: Pose
    foot_mm: Array
    normals: Array
    deviation_mm: Array
    tip_centre_machine_mm: Array
    tip_radius_mm: float


def measured_window(
    *,
    noise_mm: float = 0.0,
    pv_mm: float = 0.027,
    lines: int = 21,
    per_line: int = 41,
    pose: Pose | None = None,
    seed: int = 3,
) -> Truth:
    """Measure the demo window; `pv_mm` = 0 is a part without form error."""
    surface = window()
    error = form_error(surface, pv_mm=pv_mm)
    x, y = scan_lines(surface.bounds, lines=lines, per_line=per_line)
    placed = machine_from_part() if pose is None else pose
    jet = surface.jet(x, y)
    return Truth(
        surface=surface,
        machine_from_part=placed,
        foot_mm=np.column_stack([x, y, jet.z]),
        normals=unit_normal(jet, 1),
        deviation_mm=error.at(x, y),
        tip_centre_machine_mm=tip_centres(
            surface, error.at, x, y, TIP_RADIUS_MM, noise_mm=noise_mm, pose=placed, seed=seed
        ),
        tip_radius_mm=TIP_RADIUS_MM,
    )
