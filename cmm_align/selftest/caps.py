"""A ball of the wrong radius on a spherical cap: what the fit makes of it is known in closed form.

With c = cos(half angle), ``m1 = (1 + c) / 2``, ``m2 = (1 + c + c^2) / 3``, a radius error dr and points
spread evenly by area, the part is lifted by ``dr m1 / m2`` and a PV of ``dr (m1 / m2) (1 - c)`` is left:
least squares of ``dr - t cos(theta)``. The sums over the points of the case itself are taken in place of the
integrals, so that the answer is exact for them to first order in dr / R; dr is so small that the second
order is below 1 pm.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from cmm_align.config import AlignConfig
from cmm_align.pose import Pose
from cmm_align.selftest.finding import Finding
from cmm_align.selftest.parts import FEW_NODES, GOLDEN_RAD, TIP_RADIUS_MM, feet_of, measured, part
from cmm_align.stages.align import align
from cmm_align.stages.offset import offset
from cmm_align.units import NM_PER_MM, RAD_PER_DEG

HALF_ANGLES_DEG: Final = (30.0, 45.0, 60.0, 70.0)
_RADIUS_MM: Final = 50.0
_ERROR_MM: Final = 1e-4
_POINTS: Final = 3000


def radius_errors() -> list[Finding]:
    """Compare the lift of the part and the PV that is left with the table of caps."""
    return [finding for angle in HALF_ANGLES_DEG for finding in _cap(angle)]


def _cap(half_angle_deg: float) -> list[Finding]:
    least = np.cos(half_angle_deg * RAD_PER_DEG)
    # In pairs opposite each other, so that no tilt or shift is left over by the places themselves.
    heights = 1.0 - (1.0 - least) * np.linspace(0.0, 1.0, _POINTS // 2)
    height = np.repeat(heights, 2)
    turn = np.repeat(GOLDEN_RAD * np.arange(_POINTS // 2), 2) + np.tile([0.0, np.pi], _POINTS // 2)
    out = _RADIUS_MM * np.sqrt(1.0 - height**2)
    rim = 1.01 * _RADIUS_MM * np.sin(half_angle_deg * RAD_PER_DEG)
    surface = part(
        f'shape = "circle"\nradius = {rim}', f'kind = "conic"\nradius = {-_RADIUS_MM}\nconic = 0.0'
    )
    feet, normals = feet_of(surface, out * np.cos(turn), out * np.sin(turn))
    tips = feet + (TIP_RADIUS_MM + _ERROR_MM) * normals
    home = Pose.identity("machine", "part")
    found = align(
        measured(tips, home), offset(surface, TIP_RADIUS_MM, FEW_NODES), AlignConfig(search="never")
    )
    top = np.array([[0.0, 0.0, TIP_RADIUS_MM]])
    lift = float((top - found.part_from_machine.apply(top))[0, 2])
    share = float(height.sum() / (height**2).sum())
    pv = _ERROR_MM * share * (1.0 - least)
    name = f"cap of {half_angle_deg:.0f} deg"
    return [
        Finding(f"{name}: lift", abs(lift - _ERROR_MM * share) * NM_PER_MM, "nm", 1),
        Finding(f"{name}: PV", abs(float(np.ptp(found.deviation_mm)) - pv) * NM_PER_MM, "nm", 1),
    ]
