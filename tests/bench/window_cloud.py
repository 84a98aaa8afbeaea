"""Points over the virtual window whose foot, normal and deviation are known, and its nominal on a grid."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

import cmm_align as ca
from cmm_align.model import Nominal, PointKind, PointSet
from cmm_align.pose import Pose, rotation_from_vector
from cmm_align.surfaces.distance import smooth_measure
from cmm_align.surfaces.geometry import unit_normal
from cmm_align.virtual.cmm import scan_lines
from cmm_align.virtual.form_error import form_error
from cmm_align.virtual.window import TIP_RADIUS_MM, window

SURFACE = window()
PAPER_NODES = (1021, 1241)
"""Along x and y: 0.1 x 0.05 mm apart."""
NOISE_MM = 3e-4
INSIDE = 0.985
"""Share of the half width that the probe keeps to."""


class Cloud(NamedTuple):
    """Tip centres in the part's own frame, with what is true of them."""

    feet_mm: np.ndarray
    normals: np.ndarray
    deviation_mm: np.ndarray
    centres_mm: np.ndarray


def cloud(x, y, deviation=0.0) -> Cloud:
    """Tip centres over known places with known deviations."""
    jet = SURFACE.jet(x, y)
    normals = unit_normal(jet, 1)
    feet = np.stack([x, y, jet.z], axis=1)
    deviation = np.broadcast_to(np.asarray(deviation, dtype=float), x.shape)
    return Cloud(feet, normals, deviation, feet + (TIP_RADIUS_MM + deviation)[:, None] * normals)


def places(n: int, seed: int):
    """Random places on the window, none of them a node."""
    b = SURFACE.bounds
    u = INSIDE * np.random.default_rng(seed).uniform(-1.0, 1.0, (2, n))
    return u[0] * b.x_max, u[1] * b.y_max


def scanned(n: int, seed: int):
    """About n places in the order of a scan: lines along x, back and forth, unevenly spaced."""
    lines = max(2, round(np.sqrt(n * 62 / 102)))
    return scan_lines(SURFACE.bounds, lines=lines, per_line=round(n / lines), seed=seed)


def formed(n: int, seed: int, pv_mm: float = 0.027, noise_mm: float = 0.0, unseen: int = 5000):
    """Two clouds with one form error: about n to align, in the order of a scan, and more that no method sees.

    The part of the form error that a rigid motion of the n points could take away is taken out: least
    squares of all of them finds the identity, exactly.
    """
    x, y = (np.r_[a, b] for a, b in zip(scanned(n, seed), places(unseen, seed), strict=True))
    n = len(x) - unseen
    deviation = form_error(SURFACE, pv_mm=pv_mm).at(x, y) if pv_mm else np.zeros(len(x))
    bare = cloud(x, y, deviation)
    rows = np.hstack([np.cross(bare.centres_mm, bare.normals), bare.normals])
    deviation = deviation - rows @ np.linalg.lstsq(rows[:n], deviation[:n], rcond=None)[0]
    noise = noise_mm * np.random.default_rng(seed + 1).standard_normal(n)
    return cloud(x[:n], y[:n], deviation[:n] + noise), cloud(x[n:], y[n:], deviation[n:])


def grid_points(nodes=PAPER_NODES):
    """Points of the window on a grid, row by row."""
    b = SURFACE.bounds
    x, y = np.meshgrid(np.linspace(b.x_min, b.x_max, nodes[0]), np.linspace(b.y_min, b.y_max, nodes[1]))
    x, y = x.ravel(), y.ravel()
    return np.stack([x, y, SURFACE.jet(x, y).z], axis=1)


def grid_nominal(nodes=PAPER_NODES) -> Nominal:
    """The nominal that is known by its points alone."""
    return ca.offset(PointSet.of(grid_points(nodes), kind=PointKind.NOMINAL, frame="part"), TIP_RADIUS_MM)


def start(mm: float, deg: float, seed: int | None = None) -> Pose:
    """A part laid off by a length and an angle: along the space diagonal, or in a random direction."""
    if seed is None:
        turn, shift = np.ones((2, 3)) / np.sqrt(3.0)
    else:
        turn, shift = np.random.default_rng(seed).standard_normal((2, 3))
        turn, shift = turn / np.linalg.norm(turn), shift / np.linalg.norm(shift)
    return Pose(rotation_from_vector(np.radians(deg) * turn), mm * shift, "machine", "part")


def laid(points: Cloud, pose: Pose) -> PointSet:
    """The points as the machine reports them."""
    return PointSet.of(pose.apply(points.centres_mm), kind=PointKind.TIP_CENTRE)


class Judgement(NamedTuple):
    """How far deviations at points that no method saw are from the truth, mm."""

    pv_mm: float
    rms_mm: float
    worst_mm: float


def judged(part_from_machine: Pose, pose: Pose, unseen: Cloud) -> Judgement:
    """Judge a pose by smooth deviations on the true surface; a point laid beside it counts as far off."""
    there = (part_from_machine @ pose).apply(unseen.centres_mm)
    found = smooth_measure(SURFACE, 1, TIP_RADIUS_MM).distance(there, None)[0].distance_mm
    error = np.where(np.isfinite(found), found - unseen.deviation_mm, 1e3)
    return Judgement(float(np.ptp(error)), float(np.sqrt(np.mean(error**2))), float(np.abs(error).max()))
