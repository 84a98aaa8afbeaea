"""The parts that the cases are made on, and how a part is laid on the table."""

from __future__ import annotations

from typing import Final

import numpy as np

from cmm_align.config import OffsetConfig
from cmm_align.model import PointKind, PointSet
from cmm_align.pose import Pose, rotation_from_vector
from cmm_align.surfaces.geometry import unit_normal
from cmm_align.surfaces.prescription import PrescriptionSurface, prescription_from_toml
from cmm_align.surfaces.protocol import Array, Surface
from cmm_align.units import NM_PER_MM, RAD_PER_DEG

TIP_RADIUS_MM: Final = 1.5
FEW_NODES: Final = OffsetConfig(nodes=10_000)
"""A net that is enough for a formula, and quickly made."""
GOLDEN_RAD: Final = float(np.pi * (3.0 - np.sqrt(5.0)))
_HEAD: Final = 'schema = "cmm-align/prescription/1"\n[aperture]\n'
_PLASTIC: Final = 1.324717957244746
"""Root of x^3 = x + 1: its powers give points that fill a square evenly, without chance."""


def part(aperture: str, *terms: str) -> PrescriptionSurface:
    """Return a surface from the lines of its aperture and of its terms."""
    text = _HEAD + aperture + "".join(f"\n[[term]]\n{term}" for term in terms) + "\n"
    return prescription_from_toml(text, where="self-test")


def even_places(n: int, half_x_mm: float, half_y_mm: float) -> tuple[Array, Array]:
    """Return places that fill a rectangle evenly (M. Roberts' R2 sequence).

    Returns
    -------
    x_mm, y_mm : ndarray, shape (n,), mm
    """
    k = np.arange(1, n + 1)
    u, v = np.modf(0.5 + k / _PLASTIC)[0], np.modf(0.5 + k / _PLASTIC**2)[0]
    return (2.0 * u - 1.0) * half_x_mm, (2.0 * v - 1.0) * half_y_mm


def feet_of(surface: Surface, x_mm: Array, y_mm: Array) -> tuple[Array, Array]:
    """Return foot points and normals, each of shape (n, 3), mm, over places of shape (n,), probe on +z."""
    jet = surface.jet(x_mm, y_mm)
    return np.stack([x_mm, y_mm, jet.z], axis=1), unit_normal(jet, 1)


def laid() -> Pose:
    """Return how the part lies on the table: the paper's 20, 10, 20 mm and 20, 10, 20 degrees."""
    rx, ry, rz = (rotation_from_vector(v) for v in np.diag([20.0, 10.0, 20.0]) * RAD_PER_DEG)
    return Pose(rz @ ry @ rx, np.array([20.0, 10.0, 20.0]), "machine", "part")


def measured(tip_centres_mm: Array, pose: Pose) -> PointSet:
    """Return tip centres of shape (n, 3), mm, frame `part`, as the machine would report them."""
    return PointSet.of(pose.apply(tip_centres_mm), kind=PointKind.TIP_CENTRE, source="self-test")


def pose_error(found: Pose, truth: Pose, points_mm: Array) -> tuple[float, float]:
    """Return the largest movement of points of shape (n, 3), nm, and the angle, rad, between two poses.

    Parameters
    ----------
    found : Pose
        ``part_from_machine``.
    truth : Pose
        ``machine_from_part``.
    points_mm : ndarray, shape (n, 3), mm, frame `part`
    """
    left = found @ truth
    moved = float(np.abs(left.apply(points_mm) - points_mm).max()) * NM_PER_MM
    return moved, float(np.linalg.norm(left.rotation_vector_rad()))
