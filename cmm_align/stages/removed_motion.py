"""What the best fit hid: the motion between the datum frame and the fit, as a drawing states it.

The start ``part_from_machine`` lays the part by its datums; the fit lays it by its surface. A place p of the
nominal was found at ``fit^-1 p`` in the machine, which the datums call ``q = start fit^-1 p``: so
``hidden = start @ fit.inverse()`` takes the surface as designed to the surface as it lies. It is read at the
middle of the aperture in frame `surface`, whose z is the projection direction:

    tilt (w_x, w_y): wedge, proud on the side of  side (-w_y, w_x)
    shift (d_x, d_y): decentre;   w_z: clocking;   side d_z: change of thickness

A fit that errs by a small motion (w, t) about the centroid c has ``hidden exp(-(w, t))``; so the rotation
vector changes by ``-J_r^-1 w`` and the middle m by ``-R (w x (m - c) + t)``: those two rows carry the
covariance of the fit over (J_r: Chirikjian, "Stochastic models, information theory, and Lie groups", vol. 2,
2012, section 10.6). Verdicts follow ISO 14253-1, with the guard band of the deviation map.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from cmm_align.config import ErrorMapConfig
from cmm_align.model import Nominal, Verdict
from cmm_align.model.removed_motion import (
    Clocking,
    Decentre,
    Direction,
    MotionLimits,
    RemovedMotion,
    Thickness,
    Wedge,
    limited,
)
from cmm_align.numerics.observability import Spectrum
from cmm_align.numerics.rotations import left_jacobian
from cmm_align.pose import Pose
from cmm_align.stages.pose_knowledge import border_of
from cmm_align.surfaces.protocol import Array
from cmm_align.units import DEG_PER_RAD, UM_PER_MM

NO_LIMITS: Final = MotionLimits()

ARCMIN_PER_RAD: Final = 60.0 * DEG_PER_RAD
LARGEST_DEG: Final = 5.0
"""A part that was turned further from the start was laid anyhow, not by its datums."""
LARGEST_SHIFT: Final = 0.1
"""The same for a shift, in diagonals of the nominal."""
_FREE: Final = 1e-3
"""Least share of a reading that motions which the fit did not tell must have, to make it unknown."""


class _Read(NamedTuple):
    """A reading of one or two numbers with what is known of it."""

    value: Array
    covariance: Array
    free: bool

    @property
    def size(self) -> float:
        """Length of the reading."""
        return float(np.linalg.norm(self.value))

    @property
    def most(self) -> float:
        """Standard uncertainty in the direction that is known least; infinite where a motion is free."""
        largest = float(np.linalg.eigvalsh(self.covariance)[-1])
        return np.inf if self.free else float(np.sqrt(max(largest, 0.0)))

    @property
    def along(self) -> float:
        """Standard uncertainty of the length, to first order."""
        if self.free or self.size == 0.0:
            return self.most
        unit = self.value / self.size
        return float(np.sqrt(max(float(unit @ self.covariance @ unit), 0.0)))


def removed_motion(
    part_from_machine: Pose,
    start: Pose,
    nominal: Nominal,
    covariance: Array,
    limits: MotionLimits = NO_LIMITS,
    *,
    spectral: Spectrum,
    centroid_mm: Array,
    length_mm: float,
    guard_factor: float = ErrorMapConfig().guard_factor,
) -> RemovedMotion:
    """Return the motion that the fit has taken away, relative to the datum frame.

    Parameters
    ----------
    part_from_machine : Pose
        The fit.
    start : Pose
        ``part_from_machine`` by the datums: the identity, or what the operator gave.
    nominal : Nominal
    covariance : ndarray, shape (6, 6), rad and mm, frame `part`
        Of (rx, ry, rz, tx, ty, tz) about the centroid, zero along the free motions.
    limits : MotionLimits
    spectral : Spectrum
        Motions in frame `part`, rotations times `length_mm`. A reading that a free or a locked motion would
        change has no uncertainty and no verdict.
    centroid_mm : ndarray, shape (3,), mm, frame `part`
        Of the tip centres: where the motions turn about.
    length_mm : float
        Scale of the rotations in `spectral`, mm.
    guard_factor : float
        Guard band in standard uncertainties.

    Returns
    -------
    RemovedMotion
        ``applies`` is False if the part was turned by more than 5 degrees, or shifted by more than a tenth
        of its size.

    Raises
    ------
    InputError
        If a pose is not ``part_from_machine``.

    Notes
    -----
    Sign: a surface that lies 10 um towards the probe is 10 um thicker. An uncertainty is that of the
    direction known least; a length fails by the one along itself.
    """
    hidden = start @ part_from_machine.inverse()
    border = nominal.surface_from_part.apply(border_of(nominal).points_mm)
    middle = _middle(nominal, border)
    turn, centre = hidden.rotation_vector_rad(), nominal.surface_from_part.inverse().apply(middle)
    shift = hidden.apply(centre) - centre
    reason = _no_datum(turn, shift, nominal.surface.bounds.diagonal_mm)
    if reason:
        verdict = Verdict.UNDECIDED if limited(limits) else Verdict.NONE
        return RemovedMotion(applies=False, reason=reason, verdict=verdict.value)
    to_surface = nominal.surface_from_part.rotation
    rows = _rows(hidden, centre - centroid_mm, to_surface)
    spread = rows @ covariance @ rows.T
    scale = np.array([length_mm] * 3 + [1.0] * 3)  # turns read as lengths compare with shifts
    told = spectral.motions[:, ~spectral.free]
    untold = scale[:, None] * (rows / scale) @ (np.eye(6) - told @ told.T)
    loose = np.linalg.norm(untold, axis=1) > _FREE
    value = np.concatenate([to_surface @ turn, to_surface @ shift])

    def read(*axes: int) -> _Read:
        pick = list(axes)
        return _Read(value[pick], spread[np.ix_(pick, pick)], bool(loose[pick].any()))

    wedge = _wedge(read(0, 1), nominal, border, limits, guard_factor)
    decentre = _decentre(read(3, 4), nominal, limits, guard_factor)
    clocking = _clocking(read(2), _reach(border, middle), limits, guard_factor)
    thickness = _thickness(read(5), nominal.side, limits, guard_factor)
    verdicts = {part.verdict for part in (wedge, decentre, clocking, thickness)}
    worst = next(v for v in (Verdict.FAIL, Verdict.UNDECIDED, Verdict.PASS, Verdict.NONE) if v in verdicts)
    return RemovedMotion(True, "", worst.value, wedge, decentre, clocking, thickness)


def _middle(nominal: Nominal, border: Array) -> Array:
    """Return the aperture's centre on the nominal, shape (3,), mm, frame `surface`."""
    b = nominal.surface.bounds
    x, y = 0.5 * (b.x_min + b.x_max), 0.5 * (b.y_min + b.y_max)
    z = float(nominal.surface.jet(np.array([x]), np.array([y])).z[0])
    if not np.isfinite(z):  # a hole in the middle
        z = float(border[:, 2].mean()) if len(border) else 0.0
    return np.array([x, y, z])


def _no_datum(turn: Array, shift: Array, diagonal_mm: float) -> str:
    """Return why the start cannot have been a datum frame, or nothing."""
    angle_deg, shift_mm = float(np.linalg.norm(turn)) * DEG_PER_RAD, float(np.linalg.norm(shift))
    if angle_deg <= LARGEST_DEG and shift_mm <= LARGEST_SHIFT * diagonal_mm:
        return ""
    return (
        f"the part lies {angle_deg:.3g} deg and {shift_mm:.3g} mm from the start, so that is no datum frame: "
        "wedge and decentre need a part that was laid by its datums, or --initial"
    )


def _rows(hidden: Pose, arm_mm: Array, to_surface: Array) -> Array:
    """Return how (rotation vector, shift) in frame `surface` answer an error of the fit, shape (6, 6)."""
    x, y, z = (float(value) for value in arm_mm)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    rows = np.zeros((6, 6))
    rows[:3, :3] = -to_surface @ np.linalg.inv(left_jacobian(-hidden.rotation_vector_rad()))
    rows[3:, :3] = to_surface @ hidden.rotation @ cross
    rows[3:, 3:] = -to_surface @ hidden.rotation
    return rows


def _verdict(read: _Read, unit: float, limit: float, guard_factor: float) -> str:
    """Return the decision under the rule of ISO 14253-1; what is free (an infinite u) is undecided."""
    if limit <= 0.0:
        return Verdict.NONE.value
    margin, guard = limit - read.size * unit, guard_factor * unit
    if margin >= guard * read.most:
        return Verdict.PASS.value
    failed = margin < 0.0 and margin <= -guard * read.along
    return (Verdict.FAIL if failed else Verdict.UNDECIDED).value


def _wedge(tilt: _Read, nominal: Nominal, border: Array, limits: MotionLimits, guard_factor: float) -> Wedge:
    """State a tilt about x and y of frame `surface`."""
    proud = nominal.side * np.array([-tilt.value[1], tilt.value[0]])
    along = border[:, :2] @ proud / tilt.size if tilt.size > 0.0 else border[:, 0]
    extent = float(np.ptp(along)) if len(border) else np.nan
    return Wedge(
        angle_arcmin=tilt.size * ARCMIN_PER_RAD,
        u_arcmin=tilt.most * ARCMIN_PER_RAD,
        etd_um=float(np.tan(tilt.size)) * extent * UM_PER_MM,
        u_etd_um=tilt.most * extent * UM_PER_MM,
        towards=_in_part(proud, nominal),
        limit_arcmin=limits.wedge_arcmin,
        verdict=_verdict(tilt, ARCMIN_PER_RAD, limits.wedge_arcmin, guard_factor),
    )


def _decentre(across: _Read, nominal: Nominal, limits: MotionLimits, guard_factor: float) -> Decentre:
    """State a shift along x and y of frame `surface`."""
    return Decentre(
        shift_um=across.size * UM_PER_MM,
        u_um=across.most * UM_PER_MM,
        towards=_in_part(across.value, nominal),
        limit_um=limits.decentre_um,
        verdict=_verdict(across, UM_PER_MM, limits.decentre_um, guard_factor),
    )


def _clocking(spin: _Read, reach_mm: float, limits: MotionLimits, guard_factor: float) -> Clocking:
    """State a rotation about z of frame `surface`."""
    angle = float(spin.value[0])
    return Clocking(
        angle_arcmin=angle * ARCMIN_PER_RAD,
        u_arcmin=spin.most * ARCMIN_PER_RAD,
        edge_um=angle * reach_mm * UM_PER_MM,
        u_edge_um=spin.most * reach_mm * UM_PER_MM,
        limit_arcmin=limits.clocking_arcmin,
        verdict=_verdict(spin, ARCMIN_PER_RAD, limits.clocking_arcmin, guard_factor),
    )


def _thickness(along: _Read, side: int, limits: MotionLimits, guard_factor: float) -> Thickness:
    """State a shift along z of frame `surface`."""
    return Thickness(
        change_um=side * float(along.value[0]) * UM_PER_MM,
        u_um=along.most * UM_PER_MM,
        limit_um=limits.thickness_um,
        verdict=_verdict(along, UM_PER_MM, limits.thickness_um, guard_factor),
    )


def _reach(border: Array, middle: Array) -> float:
    """Return how far the border lies from the axis through the aperture's centre at most, mm."""
    return float(np.hypot(*(border - middle).T[:2]).max()) if len(border) else np.nan


def _in_part(plane: Array, nominal: Nominal) -> Direction:
    """Return the unit vector, frame `part`, of a vector of the xy plane of frame `surface`."""
    size = float(np.linalg.norm(plane))
    if size == 0.0:
        return 0.0, 0.0, 0.0
    flat = np.array([plane[0], plane[1], 0.0]) / size
    x, y, z = nominal.surface_from_part.inverse().rotate(flat)
    return float(x), float(y), float(z)
