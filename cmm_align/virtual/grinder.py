"""A virtual grinder: it cuts the surface it is told, with the errors that grinders have.

    part = process error + c * (commanded - nominal) + wheel + wear + drift + mounting + chance,

all along the normal, as functions of the foot point. The process error comes back in every pass; that is
why telling the machine the opposite helps. ``c *`` is the transfer, by spatial frequency: ``c(f) = c_0
exp(-(pi f w)^2 / (4 ln 2))``, a Gaussian contact of the full width w at half its height. A wheel that is
too large by dR leaves ``-dR`` everywhere, wear leaves material that grows along the path (lines along x,
from -y to +y), a warm spindle moves along z and dies out exponentially, a part that sits wrongly by (d,
theta) shows ``-(d + theta x p) . n``, and chance is a smooth field, new in every pass, with white noise on
top. Everything is seeded.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.fft import irfft2, rfft2
from scipy.interpolate import RBFInterpolator
from scipy.ndimage import map_coordinates, spline_filter

from cmm_align.surfaces.geometry import unit_normal
from cmm_align.surfaces.protocol import Array, Bounds, Surface
from cmm_align.virtual.form_error import motion_rows

Deviation = Callable[[Array, Array], Array]

_NEIGHBOURS: Final = 16
_SIDE: Final = 1
_NODES: Final = 192
"""Nodes along the longer side of the field that the transfer is made on."""
_SMOOTH_NODES: Final = 96
"""The same for chance, which has long waves only."""
_MARGIN: Final = 0.25
"""Their margin past the part, as a share of its diagonal."""
_LENGTHS_PER_DIAGONAL: Final = 12.0


@dataclass(frozen=True, slots=True)
class Grinder:
    """What a grinder does beside what it is told.

    Attributes
    ----------
    transfer : float
        c_0: share of a long wave that reaches the part.
    contact_mm : float
        w: full width of the contact at half its height; 0 for the same transfer of all waves.
    wheel_radius_error_mm : float
        How much larger the wheel is than the machine believes.
    wear_mm : float
        Radius that the wheel loses over one pass.
    drift_mm : float
        Growth of the spindle along -z of frame `surface` that is lost over one pass.
    decentre_mm, tilt_rad, clocking_rad : float
        Standard deviation of how the part sits, in x and y, about x and y, and about z; drawn anew in each
        pass.
    repeatability_mm : float
        Standard deviation of the smooth field that differs from pass to pass, rigid motions taken out.
    repeatability_length_mm : float
        Its correlation length: ``exp(-r^2 / (2 l^2))``; 0 for a twelfth of the diagonal.
    roughness_mm : float
        Standard deviation of what differs from place to place.
    """

    transfer: float = 0.96
    contact_mm: float = 0.0
    wheel_radius_error_mm: float = 0.0
    wear_mm: float = 0.0
    drift_mm: float = 0.0
    decentre_mm: float = 0.0
    tilt_rad: float = 0.0
    clocking_rad: float = 0.0
    repeatability_mm: float = 0.0008
    repeatability_length_mm: float = 0.0
    roughness_mm: float = 0.0


DEFAULT: Final = Grinder()


def grind(
    surface: Surface,
    process_error: Deviation,
    commanded_mm: Array | None,
    grinder: Grinder = DEFAULT,
    *,
    seed: int = 4,
) -> Deviation:
    """Return the deviation of a part after it was ground to a commanded surface.

    Parameters
    ----------
    surface : Surface
        Nominal, probe on its +z side.
    process_error : callable
        What the machine adds in every pass: deviation in mm at foot points (x, y).
    commanded_mm : ndarray, shape (n, 3), mm, frame `part`, or None
        Points of the commanded surface, as in the exported text; None for the nominal.
    grinder : Grinder
    seed : int
        Of the pass: chance and mounting.

    Returns
    -------
    callable
        Deviation in mm at foot points (x, y), positive = excess material.
    """
    rng = np.random.default_rng(seed)
    told = None if commanded_mm is None else _told(surface, commanded_mm, grinder)
    wander = _chance(surface, grinder, rng)
    mounting = _mounting(grinder, rng)
    phase = int(rng.integers(2**31))

    def deviation_at(x_mm: Array, y_mm: Array) -> Array:
        """Return the deviation of the new part."""
        along = _along_path(surface.bounds, x_mm, y_mm)
        jet = surface.jet(x_mm, y_mm)
        normals = unit_normal(jet, _SIDE)
        points = np.column_stack([x_mm, y_mm, jet.z])
        e = process_error(x_mm, y_mm) + wander(x_mm, y_mm)
        e = e - grinder.wheel_radius_error_mm + grinder.wear_mm * along
        e = e - grinder.drift_mm * (1.0 - np.exp(-3.0 * along)) * normals[:, 2]
        e = e - np.einsum("ij,ij->i", normals, np.cross(mounting[:3], points) + mounting[3:])
        if told is not None:
            e = e + told(x_mm, y_mm)
        if grinder.roughness_mm > 0.0:
            fresh = np.random.default_rng(phase)
            e = e + grinder.roughness_mm * fresh.standard_normal(len(x_mm))
        return np.asarray(e, dtype=np.float64)

    return deviation_at


def _told(surface: Surface, commanded_mm: Array, grinder: Grinder) -> Deviation:
    """Return what the process makes of the commanded change along the normal."""
    jet = surface.jet(commanded_mm[:, 0], commanded_mm[:, 1])
    # To first order in the correction, which is a thousand times smaller than the part's curvature radius.
    along_normal = (commanded_mm[:, 2] - jet.z) * unit_normal(jet, _SIDE)[:, 2]
    # A thin plate through the nearest nodes also carries on to the border, past the last node.
    change = RBFInterpolator(commanded_mm[:, :2], along_normal, neighbors=_NEIGHBOURS)
    if grinder.contact_mm <= 0.0:
        return lambda x, y: grinder.transfer * change(np.column_stack([x, y]))
    field = _Field(surface.bounds, _NODES)
    x, y = field.places
    b = surface.bounds
    held = np.column_stack([np.clip(x, b.x_min, b.x_max), np.clip(y, b.y_min, b.y_max)])
    values = change(held).reshape(field.shape)
    kept = np.exp(-((np.pi * field.frequency * grinder.contact_mm) ** 2) / (4.0 * np.log(2.0)))
    return field.at(grinder.transfer * field.filtered(values, kept))


def _chance(surface: Surface, grinder: Grinder, rng: np.random.Generator) -> Deviation:
    """Return a smooth normal random field of the wanted size, rigid motions taken out."""
    if grinder.repeatability_mm <= 0.0:
        return lambda x, y: np.zeros_like(x)
    field = _Field(surface.bounds, _SMOOTH_NODES)
    length = grinder.repeatability_length_mm or surface.bounds.diagonal_mm / _LENGTHS_PER_DIAGONAL
    spectrum = np.exp(-2.0 * (np.pi * length * field.frequency) ** 2)  # of exp(-r^2 / (2 l^2))
    spectrum /= field.mean(spectrum)
    values = field.filtered(rng.standard_normal(field.shape), np.sqrt(spectrum))  # of variance 1
    on_part = field.on_part
    x, y = (a[on_part.ravel()] for a in field.places)
    basis, triangle = np.linalg.qr(motion_rows(surface, x, y))
    motion = np.linalg.solve(triangle, basis.T @ values[on_part])
    left = 1.0
    for column in basis.T:
        mode = np.zeros(field.shape)
        mode[on_part] = column
        left -= float(column @ field.filtered(mode, spectrum)[on_part]) / len(column)
    smooth, size = field.at(values), grinder.repeatability_mm / np.sqrt(left)

    def wander(x_mm: Array, y_mm: Array) -> Array:
        """Return the field at places (x, y)."""
        raw = smooth(x_mm, y_mm) - motion_rows(surface, x_mm, y_mm) @ motion
        return np.asarray(size * raw, dtype=np.float64)

    return wander


class _Field:
    """A grid wider than the part, for fields that are made in the frequency domain."""

    def __init__(self, bounds: Bounds, nodes: int) -> None:
        margin = _MARGIN * bounds.diagonal_mm
        wide_x, wide_y = bounds.x_max - bounds.x_min + 2 * margin, bounds.y_max - bounds.y_min + 2 * margin
        self.step_mm = max(wide_x, wide_y) / nodes
        self.start = bounds.x_min - margin, bounds.y_min - margin
        self.shape = int(np.ceil(wide_y / self.step_mm)) + 1, int(np.ceil(wide_x / self.step_mm)) + 1
        ny, nx = self.shape
        self.frequency = np.hypot(
            np.fft.rfftfreq(nx, self.step_mm), np.fft.fftfreq(ny, self.step_mm)[:, None]
        )
        x, y = (s + self.step_mm * np.arange(n) for s, n in zip(self.start, (nx, ny), strict=True))
        grid = np.meshgrid(x, y)
        self.places = grid[0].ravel(), grid[1].ravel()
        b = bounds
        self.on_part = (
            (grid[0] >= b.x_min) & (grid[0] <= b.x_max) & (grid[1] >= b.y_min) & (grid[1] <= b.y_max)
        )

    def filtered(self, values: Array, gain: Array) -> Array:
        """Return values, shape (ny, nx), with every wave multiplied by its gain."""
        return np.asarray(irfft2(rfft2(values) * gain, s=self.shape), dtype=np.float64)

    def mean(self, spectrum: Array) -> float:
        """Return the mean of a spectrum over all modes: the variance that it gives white noise of one."""
        impulse = np.zeros(self.shape)
        impulse[0, 0] = 1.0
        return float(self.filtered(impulse, spectrum)[0, 0])

    def at(self, values: Array) -> Deviation:
        """Return values, shape (ny, nx), as a function of the place."""
        coefficients = spline_filter(values)

        def read(x_mm: Array, y_mm: Array) -> Array:
            """Return the field between its nodes, by a cubic spline."""
            row = (y_mm - self.start[1]) / self.step_mm
            column = (x_mm - self.start[0]) / self.step_mm
            return np.asarray(map_coordinates(coefficients, [row, column], prefilter=False))

        return read


def _mounting(grinder: Grinder, rng: np.random.Generator) -> Array:
    """Return how wrongly the part sits: a turn (rad) and a shift (mm), shape (6,)."""
    turn = np.array([grinder.tilt_rad, grinder.tilt_rad, grinder.clocking_rad])
    shift = np.array([grinder.decentre_mm, grinder.decentre_mm, 0.0])
    return np.asarray(np.concatenate([turn, shift]) * rng.standard_normal(6), dtype=np.float64)


def _along_path(bounds: Bounds, x_mm: Array, y_mm: Array) -> Array:
    """Return the share of the pass that is over at a place: lines along x, from -y to +y."""
    v = (y_mm - bounds.y_min) / (bounds.y_max - bounds.y_min)
    u = (x_mm - bounds.x_min) / (bounds.x_max - bounds.x_min)
    lines = 100.0
    return np.asarray((np.floor(v * lines) + u) / lines, dtype=np.float64).clip(0.0, 1.0)
