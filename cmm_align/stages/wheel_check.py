"""Whether a wheel can grind a commanded surface: gouges, air cuts, and what a shifted old path would cost.

Locally the wheel fits where the corrected surface is less concave than the wheel in every direction. Its
second derivatives are those of the nominal plus second differences of the correction along z on the grid.
What the wheel would take off below the commanded surface (the overcut) is then measured, wheel against
nodes: from tool centres spread over the part and from those where the surface fills the wheel most, to
nodes spread over the part and along rays from each centre.

A path that is only shifted by the correction and keeps the normals of the nominal touches at another
place of the wheel: with d the angle between both normals it overcuts by ``R (1 - cos d)``, about
``R |grad e|^2 / 2``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cmm_align.config import CompensateConfig
from cmm_align.errors import InputError, UsageError
from cmm_align.model import Correction
from cmm_align.numerics.wheel import Wheel, centre_from_contact, distance_to_wheel, fill_of_wheel
from cmm_align.surfaces.geometry import unit_normal
from cmm_align.surfaces.protocol import Array, Jet, Mask
from cmm_align.units import UM_PER_MM

MOST_OVERCUT_MM: Final = 1e-4
"""An overcut up to this is no gouge: it lies below what grinding repeats."""
FILL_WARNING: Final = 0.8
"""A wheel that is filled more than this leaves little room for the next pass."""

_AXES: Final = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
_SPREAD: Final = 30
"""Nodes along each side from which the overcut is measured everywhere."""
_WORST: Final = 400
_CHUNK: Final = 250


@dataclass(frozen=True, slots=True)
class WheelCheck:
    """How a wheel and a commanded surface go together; places (x, y) are mm in frame `surface`."""

    wheel: Wheel
    slope_change_rad: float
    """Largest angle between the normals of the nominal and of the commanded surface."""
    slope_change_at_mm: tuple[float, float]
    old_normals_mm: float
    """What a path with the old normals would overcut at worst."""
    fill: float
    """Largest share of the wheel's curvature that the commanded surface has."""
    fill_at_mm: tuple[float, float]
    overcut_mm: float
    """What the wheel takes off below the commanded surface at worst, along the wheel's normal."""
    overcut_at_mm: tuple[float, float]
    """Where that material is."""


@dataclass(frozen=True, slots=True)
class DepthCheck:
    """What a pass takes off, against the range of its correction, mm."""

    depth_mm: float
    range_mm: float
    """Largest minus smallest correction."""

    @property
    def least_mm(self) -> float:
        """Return what is taken off where it is least."""
        return self.depth_mm - self.range_mm


def wheel_of(config: CompensateConfig) -> Wheel | None:
    """Return the wheel of the settings; None if there is none.

    Raises
    ------
    UsageError
        If the settings contradict each other, or the axis is no direction.
    """
    radius, tip = config.wheel_radius_mm, config.wheel_tip_radius_mm
    if tip > 0.0 and radius == 0.0:
        raise UsageError("a rim radius of the wheel without its radius", remedy="give --wheel-radius too")
    if tip > radius:
        raise UsageError(
            f"a rim of radius {tip:g} mm on a wheel of radius {radius:g} mm",
            expected="--wheel-tip-radius below --wheel-radius (the wheel's largest radius)",
        )
    axis = _axis_of(config.wheel_axis)
    return None if radius == 0.0 else Wheel(radius, tip, axis)


def _axis_of(text: str) -> tuple[float, float, float]:
    """Return the unit vector of an axis in words or numbers."""
    if text.strip().lower() in _AXES:
        return _AXES[text.strip().lower()]
    try:
        vector = np.array([float(part) for part in text.split(",")])
    except ValueError:
        vector = np.zeros(0)
    length = float(np.linalg.norm(vector))
    if vector.shape != (3,) or not np.isfinite(length) or length == 0.0:
        raise UsageError(f"wheel axis {text!r}", expected='x, y, z or a direction as "0, 0.6, 0.8"')
    x, y, z = (vector / length).tolist()
    return (x, y, z)


def check_wheel(correction: Correction, wheel: Wheel) -> WheelCheck:
    """Measure how a wheel and the commanded surface go together.

    Parameters
    ----------
    correction : Correction
    wheel : Wheel
        Axis in frame `part`.

    Raises
    ------
    GeometryError
        If a torus would touch with its flat face.
    """
    turned = _in_surface(wheel, correction)
    x, y = np.meshgrid(correction.x_mm, correction.y_mm)
    jet = Jet(*(a.reshape(x.shape) for a in correction.nominal.surface.jet(x.ravel(), y.ravel())))
    inside = np.isfinite(correction.commanded_z_mm)
    iy, ix = np.nonzero(inside)
    normals = correction.commanded_normal[inside]
    # Half of the chord between both normals: exact for small angles, where the cosine is not.
    apart = unit_normal(jet, correction.nominal.side)[inside] - normals
    half_sine = 0.5 * np.sqrt(np.einsum("ni,ni->n", apart, apart))
    fill = fill_of_wheel(turned, normals, _hessian(correction, jet, inside))
    overcut, at = _overcut(correction, turned, normals, fill, iy, ix)

    def place(k: int) -> tuple[float, float]:
        return float(correction.x_mm[ix[k]]), float(correction.y_mm[iy[k]])

    steepest, tightest = int(np.argmax(half_sine)), int(np.argmax(fill))
    return WheelCheck(
        wheel=wheel,
        slope_change_rad=2.0 * float(np.arcsin(half_sine[steepest])),
        slope_change_at_mm=place(steepest),
        old_normals_mm=wheel.radius_mm * 2.0 * float(half_sine[steepest]) ** 2,
        fill=float(fill[tightest]),
        fill_at_mm=place(tightest),
        overcut_mm=overcut,
        overcut_at_mm=place(at),
    )


def refuse_gouge(check: WheelCheck) -> None:
    """Refuse a wheel that takes off what is to stay.

    Raises
    ------
    InputError
        With the place, the depth and how far the wheel is too large.
    """
    if check.overcut_mm > MOST_OVERCUT_MM:
        x, y = check.overcut_at_mm
        raise InputError(
            f"the wheel ({check.wheel.words}) gouges: {check.overcut_mm * UM_PER_MM:.2f} um too deep at "
            f"({x:.3f}, {y:.3f}) mm",
            expected="a corrected surface less concave than the wheel; its curvature is "
            f"{100.0 * check.fill:.0f} % of the wheel's at worst",
            remedy="take a smaller wheel, or a map with a longer --low-pass",
        )


def check_depth(correction: Correction, config: CompensateConfig) -> DepthCheck | None:
    """Return what the pass takes off at least; None if the depth of cut is not known.

    Raises
    ------
    InputError
        If the wheel would run in air somewhere: the depth is below range and margin.
    """
    if config.depth_of_cut_um == 0.0:
        return None
    known = correction.correction_mm[np.isfinite(correction.correction_mm)]
    found = DepthCheck(config.depth_of_cut_um / UM_PER_MM, float(known.max() - known.min()))
    if found.least_mm * UM_PER_MM < config.depth_margin_um:
        needed = found.range_mm * UM_PER_MM + config.depth_margin_um
        raise InputError(
            f"a depth of cut of {config.depth_of_cut_um:g} um leaves the wheel in air: the correction ranges "
            f"over {found.range_mm * UM_PER_MM:.2f} um",
            expected=f"at least {needed:.2f} um with the margin of {config.depth_margin_um:g} um",
            remedy="cut deeper, or take a smaller gain",
        )
    return found


def _in_surface(wheel: Wheel, correction: Correction) -> Wheel:
    """Return the wheel with its axis turned from frame `part` to frame `surface`."""
    x, y, z = correction.nominal.surface_from_part.rotate(np.array([wheel.axis]))[0].tolist()
    return Wheel(wheel.radius_mm, wheel.tip_radius_mm, (x, y, z))


def _hessian(correction: Correction, jet: Jet, inside: Mask) -> tuple[Array, Array, Array]:
    """Return z_xx, z_xy and z_yy of the commanded surface at the nodes inside, each of shape (n,), 1/mm.

    On the border of the aperture there are no differences: there it is that of the nominal alone.
    """
    dz = correction.commanded_z_mm - jet.z
    dx, dy = (float(nodes[1] - nodes[0]) for nodes in (correction.x_mm, correction.y_mm))
    more = np.full((3, *dz.shape), np.nan)
    more[0, :, 1:-1] = (dz[:, 2:] - 2.0 * dz[:, 1:-1] + dz[:, :-2]) / dx**2
    more[1, 1:-1, 1:-1] = (dz[2:, 2:] - dz[2:, :-2] - dz[:-2, 2:] + dz[:-2, :-2]) / (4.0 * dx * dy)
    more[2, 1:-1] = (dz[2:] - 2.0 * dz[1:-1] + dz[:-2]) / dy**2
    np.nan_to_num(more, copy=False)
    return (jet.zxx + more[0])[inside], (jet.zxy + more[1])[inside], (jet.zyy + more[2])[inside]


def _overcut(
    correction: Correction,
    wheel: Wheel,
    normals: Array,
    fill: Array,
    iy: NDArray[np.intp],
    ix: NDArray[np.intp],
) -> tuple[float, int]:
    """Return how deep a wheel on its path comes below the surface, mm, and at which of the nodes inside."""
    ny, nx = correction.commanded_z_mm.shape
    number = np.full((ny, nx), -1)
    number[iy, ix] = np.arange(len(iy))
    points = np.stack([correction.x_mm[ix], correction.y_mm[iy], correction.commanded_z_mm[iy, ix]], axis=1)
    rows, columns = (np.unique(np.linspace(0, n - 1, min(n, _SPREAD)).astype(int)) for n in (ny, nx))
    spread = number[np.ix_(rows, columns)].ravel()
    spread = spread[spread >= 0]
    worst = np.argpartition(fill, -min(_WORST, len(fill)))[-min(_WORST, len(fill)) :]
    rays = _rays(max(nx, ny))
    deepest, at = 0.0, int(worst[0])
    centres = np.union1d(spread, worst)
    for first in range(0, len(centres), _CHUNK):
        k = centres[first : first + _CHUNK]
        centre = points[k] + centre_from_contact(wheel, normals[k])
        near_y = np.clip(iy[k][:, None] + rays[:, 0], 0, ny - 1)
        near_x = np.clip(ix[k][:, None] + rays[:, 1], 0, nx - 1)
        near = number[near_y, near_x]
        near = np.where(near < 0, k[:, None], near)  # outside the aperture: the contact itself, no overcut
        met = np.concatenate([np.broadcast_to(spread, (len(k), len(spread))), near], axis=1)
        distance = distance_to_wheel(wheel, points[met] - centre[:, None, :])
        row, column = np.unravel_index(int(np.argmin(distance)), distance.shape)
        if -distance[row, column] > deepest:
            deepest, at = float(-distance[row, column]), int(met[row, column])
    return deepest, at


def _rays(reach: int) -> NDArray[np.intp]:
    """Return offsets (dy, dx) in nodes along sixteen rays, at distances that grow by half each time."""
    angle = np.arange(16) * np.pi / 8.0
    lengths = np.unique(np.round(1.5 ** np.arange(0, np.log(max(reach, 2)) / np.log(1.5) + 1)))
    steps = np.round(lengths[:, None, None] * np.stack([np.sin(angle), np.cos(angle)], axis=1)).astype(
        np.intp
    )
    return np.unique(steps.reshape(-1, 2), axis=0)
