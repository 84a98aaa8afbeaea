"""Data whose best fit is known exactly: deviations that no small motion can make smaller.

With foot points s_i, normals n_i and Jacobian rows ``J_i = [s_i x n_i, n_i]``, deviations d in the null
space of J^T leave the identity an exact optimum of ``X_i = s_i + (r + d_i) n_i``, for
``(s + d n) x n = s x n``; the residuals are exactly d_i (data generators of NPL).
Moved by a known pose, that pose is the answer.

For the minimum zone the same with multipliers: seven points with ``|d_i| = t`` and signs such that
``sum l_i sign(d_i) J_i = 0`` with ``l_i > 0``, all others within; the zone is then exactly t.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from cmm_align.config import AlignConfig
from cmm_align.model import Nominal
from cmm_align.selftest.finding import Finding
from cmm_align.selftest.parts import (
    FEW_NODES,
    TIP_RADIUS_MM,
    even_places,
    feet_of,
    laid,
    measured,
    pose_error,
)
from cmm_align.stages.align import align
from cmm_align.stages.offset import offset
from cmm_align.surfaces.protocol import Array
from cmm_align.units import NM_PER_MM
from cmm_align.virtual.window import window

_POINTS: Final = 2000
_MANY: Final = 60_000
"""So many that a sample leads the way and short steps are carried on without a new look at the surface."""
_HALF_MM: Final = (48.0, 28.0)
_SIZE_MM: Final = 0.005
_LENGTH_MM: Final = 30.0
_LEAST_WEIGHT: Final = 0.05


def least_squares() -> list[Finding]:
    """Align null-space data; pose and residuals are known."""
    return [*_least_squares("least squares", _POINTS), *_least_squares("least squares, many", _MANY)]


def _least_squares(name: str, n: int) -> list[Finding]:
    """Align n points with deviations in the null space."""
    x, y = even_places(n, *_HALF_MM)
    feet, normals = feet_of(window(), x, y)
    basis, _ = np.linalg.qr(_rows(feet, normals))
    deviation = _SIZE_MM * np.sin(1.0 + 2.4 * np.arange(n))
    for _ in range(2):  # twice is enough for orthogonality to rounding
        deviation = deviation - basis @ (basis.T @ deviation)
    return _aligned(name, feet, normals, deviation, "least-squares")


def minimum_zone() -> list[Finding]:
    """Align data made from multipliers; pose, residuals and the zone are known."""
    x, y = even_places(_POINTS, *_HALF_MM)
    feet, normals = feet_of(window(), x, y)
    first, weight = _seven(_rows(feet, normals))
    deviation = 0.9 * _SIZE_MM * np.sin(1.0 + 2.4 * np.arange(_POINTS))
    deviation[first : first + 7] = np.sign(weight) * _SIZE_MM
    return _aligned("minimum zone", feet, normals, deviation, "minimum-zone")


def _aligned(name: str, feet: Array, normals: Array, deviation: Array, criterion: str) -> list[Finding]:
    """Lay the points on the table, align them, and compare all that comes back."""
    tips = feet + (TIP_RADIUS_MM + deviation)[:, None] * normals
    pose = laid()
    found = align(measured(tips, pose), _nominal(), AlignConfig(criterion=criterion, outliers="keep"))
    moved_nm, turned_rad = pose_error(found.part_from_machine, pose, tips)
    residual_nm = float(np.abs(found.deviation_mm - deviation).max()) * NM_PER_MM
    pv_nm = abs(float(np.ptp(found.deviation_mm) - np.ptp(deviation))) * NM_PER_MM
    rms = [float(np.sqrt(np.mean(e**2))) for e in (found.deviation_mm, deviation)]
    return [
        Finding(f"{name}: place", moved_nm, "nm", len(tips)),
        Finding(f"{name}: turn", turned_rad, "rad", 1),
        Finding(f"{name}: deviations", residual_nm, "nm", len(tips)),
        Finding(f"{name}: PV", pv_nm, "nm", 1),
        Finding(f"{name}: RMS", abs(rms[0] - rms[1]) * NM_PER_MM, "nm", 1),
    ]


def _nominal() -> Nominal:
    return offset(window(), TIP_RADIUS_MM, FEW_NODES)


def _rows(feet: Array, normals: Array) -> Array:
    return np.hstack([np.cross(feet, normals) / _LENGTH_MM, normals])


def _seven(rows: Array) -> tuple[int, Array]:
    """Return the first of seven neighbours whose multipliers are all of a size, and these."""
    for first in range(0, len(rows) - 7, 7):
        weight: Array = np.linalg.svd(rows[first : first + 7].T)[2][6]
        if np.abs(weight).min() > _LEAST_WEIGHT:
            return first, weight
    raise ArithmeticError("no seven points hold each other")
