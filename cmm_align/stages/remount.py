"""What a part that sits wrongly on the grinder does to the map: um for each um, um for each arcsecond.

A part that is displaced by d and turned by theta about c shows, along its normals, the deviation

    e = -(d + theta x (p - c)) . n,

so each motion has a map of its own. The sizes are those of these maps over the nominal. A best fit to the
next measurement takes the motion away again: it does not see it, datums do.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from cmm_align.model import Nominal
from cmm_align.surfaces.geometry import unit_normal
from cmm_align.surfaces.protocol import Array
from cmm_align.units import RAD_PER, UM_PER_MM

_NODES: Final = 201
"""Places along each side."""
MOTIONS: Final = ("decentre x", "decentre y", "height z", "tilt about x", "tilt about y", "clocking about z")
ARCSEC_RAD: Final = RAD_PER["arcsec"]


@dataclass(frozen=True, slots=True)
class Sensitivity:
    """The map of one motion; a turn is about the middle of the part.

    Attributes
    ----------
    motion : str
    unit : str
        um (of the motion) or arcsec.
    pv_um, rms_um : float
        Of its map, for one unit.
    max_um : float
        Largest deviation, with its sign.
    at_mm : tuple of float
        Where that is, (x, y) in frame `surface`.
    """

    motion: str
    unit: str
    pv_um: float
    rms_um: float
    max_um: float
    at_mm: tuple[float, float]


def remount_sensitivity(nominal: Nominal) -> tuple[Sensitivity, ...]:
    """Return what 1 um or 1 arcsec of each motion of the part does to its deviations.

    Parameters
    ----------
    nominal : Nominal

    Returns
    -------
    tuple of Sensitivity
        Motions along and about the axes of frame `part`, in the order of `MOTIONS`.
    """
    points, normals = spread(nominal)
    part_from_surface = nominal.surface_from_part.inverse()
    p, n = part_from_surface.apply(points), part_from_surface.rotate(normals)
    rows = np.hstack([n, np.cross(p - p.mean(axis=0), n)])
    found = []
    for k, motion in enumerate(MOTIONS):
        one_um = 1.0 if k < 3 else ARCSEC_RAD * UM_PER_MM
        e = -one_um * rows[:, k]
        worst = int(np.argmax(np.abs(e)))
        found.append(
            Sensitivity(
                motion,
                "um" if k < 3 else "arcsec",
                float(np.ptp(e)),
                float(np.sqrt(np.mean(e**2))),
                float(e[worst]),
                (float(points[worst, 0]), float(points[worst, 1])),
            )
        )
    return tuple(found)


def spread(nominal: Nominal) -> tuple[Array, Array]:
    """Return points and normals spread over the nominal, frame `surface`, its border included."""
    b = nominal.surface.bounds
    x, y = (
        a.ravel()
        for a in np.meshgrid(np.linspace(b.x_min, b.x_max, _NODES), np.linspace(b.y_min, b.y_max, _NODES))
    )
    inside = nominal.surface.contains(x, y)
    jet = nominal.surface.jet(x[inside], y[inside])
    return np.column_stack([x[inside], y[inside], jet.z]), unit_normal(jet, nominal.side)
