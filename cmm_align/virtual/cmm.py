"""A virtual coordinate measuring machine: scan lines over a part, reported as tip centres.

A deviation is defined along the nominal normal at the foot point, so a ball of radius r that touches
the part has its centre at ``P = s + (r + e) n``: the foot point of P on the nominal is s, exactly.
The noise is white, 0.3 um unless said otherwise, with an optional slow drift along the scan.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from cmm_align.pose import Pose, rotation_from_vector
from cmm_align.surfaces.geometry import unit_normal
from cmm_align.surfaces.protocol import Array, Bounds, Surface
from cmm_align.units import RAD_PER_DEG

NOISE_MM: Final = 0.0003
_MARGIN: Final = 0.006
"""Share of the part's size that the probe keeps from each border."""
_SIDE: Final = 1


def machine_from_part() -> Pose:
    """Return how the part sits on the table: 20, 10, 20 mm and 20, 10, 20 degrees about x, y, z."""
    rx, ry, rz = (rotation_from_vector(v) for v in np.diag([20.0, 10.0, 20.0]) * RAD_PER_DEG)
    return Pose(rz @ ry @ rx, np.array([20.0, 10.0, 20.0]), "machine", "part")


def scan_lines(bounds: Bounds, *, lines: int = 41, per_line: int = 161, seed: int = 2) -> tuple[Array, Array]:
    """Return where the probe touches: lines along x, back and forth, with uneven spacing.

    Parameters
    ----------
    bounds : Bounds
        Aperture of the part, mm.
    lines, per_line : int
        Number of lines, and of points on each.
    seed : int
        Chooses the unevenness.

    Returns
    -------
    x_mm, y_mm : ndarray, shape (lines * per_line,), mm, frame `part`
        In the order of the scan.
    """
    rng = np.random.default_rng(seed)
    margin_x = _MARGIN * (bounds.x_max - bounds.x_min)
    margin_y = _MARGIN * (bounds.y_max - bounds.y_min)
    rows = _uneven(rng, lines) * (bounds.y_max - bounds.y_min - 2.0 * margin_y) + bounds.y_min + margin_y
    x, y = [], []
    for number, row in enumerate(rows):
        along = _uneven(rng, per_line)
        if number % 2:
            along = along[::-1]
        x.append(along * (bounds.x_max - bounds.x_min - 2.0 * margin_x) + bounds.x_min + margin_x)
        y.append(np.full(per_line, row))
    return np.concatenate(x), np.concatenate(y)


def tip_centres(
    surface: Surface,
    deviation_at: Callable[[Array, Array], Array],
    x_mm: Array,
    y_mm: Array,
    tip_radius_mm: float,
    *,
    noise_mm: float = NOISE_MM,
    drift_mm: float = 0.0,
    pose: Pose | None = None,
    seed: int = 3,
) -> Array:
    """Return the tip centres that the machine reports.

    Parameters
    ----------
    surface : Surface
        Nominal, probe on its +z side.
    deviation_at : callable
        Deviation in mm at foot points (x, y), positive = excess material.
    x_mm, y_mm : ndarray, shape (n,), mm, frame `part`
        Places of the foot points, in the order of the scan.
    tip_radius_mm : float
        Radius of the ball, mm.
    noise_mm : float
        Standard deviation of the white noise along the normal, mm.
    drift_mm : float
        Standard deviation of a slow drift along the scan, mm.
    pose : Pose, optional
        ``machine_from_part``; the tilted one of `machine_from_part` unless given.
    seed : int
        Of noise and drift.

    Returns
    -------
    ndarray, shape (n, 3), mm, frame `machine`
    """
    rng = np.random.default_rng(seed)
    jet = surface.jet(x_mm, y_mm)
    height = tip_radius_mm + deviation_at(x_mm, y_mm) + noise_mm * rng.standard_normal(len(x_mm))
    if drift_mm > 0.0:
        height = height + drift_mm * _slow(rng, len(x_mm))
    centres = np.column_stack([x_mm, y_mm, jet.z]) + height[:, None] * unit_normal(jet, _SIDE)
    return (machine_from_part() if pose is None else pose).apply(centres)


def _uneven(rng: np.random.Generator, count: int) -> Array:
    """Return `count` rising numbers from 0 to 1 whose steps differ by up to a third."""
    steps = rng.uniform(0.75, 1.25, count - 1)
    places = np.concatenate([[0.0], np.cumsum(steps)])
    return np.asarray(places / places[-1], dtype=np.float64)


def _slow(rng: np.random.Generator, count: int) -> Array:
    """Return a slow wander of unit standard deviation: a few sines over the length of the scan."""
    time = np.linspace(0.0, 1.0, count)
    waves = [np.sin(2.0 * np.pi * (k * time + rng.uniform())) / k for k in range(1, 6)]
    wander = np.sum(waves, axis=0)
    return np.asarray((wander - wander.mean()) / wander.std(), dtype=np.float64)
