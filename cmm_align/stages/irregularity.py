"""A, B and C of ISO 10110-5 and its three RMS, for a surface of any form.

The standard subtracts from a wavefront: piston and tilt, then the best sphere, then the best rotationally
symmetric rest. On the deviations of a freeform "sphere" is a policy, not geometry; here

- piston and tilt are the rigid motions along z and about x and y (on a flat part: 1, x and y),
- the sphere is the normal offset of a small change of curvature, ``n_z (x^2 + y^2)``, fitted beside them,
- rotational symmetry is about the middle of the known nodes: polynomials of r^2 up to r^16.

All fits are least squares over the area that was measured: nodes weigh by what they stand for.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.polynomial import legendre

from cmm_align.model import Alignment, Irregularity
from cmm_align.numerics.aperture_basis import orthonormalised
from cmm_align.numerics.extreme_value import largest_excess
from cmm_align.numerics.grid_field import smoothed
from cmm_align.stages.map_nodes import MapNodes
from cmm_align.surfaces.geometry import unit_normal
from cmm_align.surfaces.protocol import Array
from cmm_align.units import UM_PER_MM

RADIAL_TERMS: Final = 9
"""Powers of r^2 from 0 to 8: what is rotationally symmetric, rings two thirds of a radius apart included."""
NODES_PER_TERM: Final = 3


def irregularity(alignment: Alignment, nodes: MapNodes, *, filtered: bool = False) -> Irregularity | None:
    """Return the indications of ISO 10110-5, or None with fewer than three nodes for each shape.

    Parameters
    ----------
    alignment : Alignment
    nodes : MapNodes
    filtered : bool
        Whether waves were taken away: the noise left in extremes is then not known.
    """
    if len(nodes.x_mm) < NODES_PER_TERM * (4 + RADIAL_TERMS):
        return None
    motions_and_power, radial = _shapes(alignment, nodes)
    q = _orthonormal(motions_and_power, nodes)
    c = np.array([nodes.mean(column * nodes.deviation_mm) for column in q.T])
    e_t = nodes.deviation_mm - q[:, :3] @ c[:3]
    e_i = e_t - q[:, 3] * c[3]
    rings = _orthonormal(radial, nodes)
    symmetric = rings @ np.array([nodes.mean(column * e_i) for column in rings.T])
    e_a = e_i - symmetric
    span = float(np.ptp(q[:, 3]))
    reach = rings[int(np.argmax(symmetric))] - rings[int(np.argmin(symmetric))]
    on_grid = np.full(nodes.known.shape, np.nan)
    on_grid[nodes.known] = e_i
    form = smoothed(on_grid)[nodes.known]
    high, low = (largest_excess(s * form, nodes.sigma_mm, alike=nodes.alike) for s in (1.0, -1.0))
    kept = 0.0 if filtered else nodes.mean(nodes.sigma_mm**2)
    u_b_mm = float(np.hypot(np.hypot(high.sd, low.sd), high.added + low.added))
    return Irregularity(
        a_um=float(c[3]) * span * UM_PER_MM,
        u_a_um=nodes.noise_of_mean(q[:, 3]) * span * UM_PER_MM,
        b_um=float(np.ptp(e_i)) * UM_PER_MM,
        u_b_um=None if filtered else u_b_mm * UM_PER_MM,
        c_um=float(np.ptp(symmetric)) * UM_PER_MM,
        u_c_um=nodes.noise_of_mean(rings @ reach) * UM_PER_MM,
        rms_t_um=_rms_without(nodes, e_t, kept) * UM_PER_MM,
        u_rms_t_um=nodes.noise_of_rms(e_t) * UM_PER_MM,
        rms_i_um=_rms_without(nodes, e_i, kept) * UM_PER_MM,
        u_rms_i_um=nodes.noise_of_rms(e_i) * UM_PER_MM,
        rms_a_um=_rms_without(nodes, e_a, kept) * UM_PER_MM,
        u_rms_a_um=nodes.noise_of_rms(e_a) * UM_PER_MM,
    )


def _rms_without(nodes: MapNodes, values: Array, noise_mm2: float) -> float:
    """Return the RMS of values, shape (n,), without the mean square of noise, mm."""
    return float(np.sqrt(max(nodes.rms(values) ** 2 - noise_mm2, 0.0)))


def _shapes(alignment: Alignment, nodes: MapNodes) -> tuple[Array, Array]:
    """Return piston, tilts and power, shape (n, 4), and the rotationally symmetric shapes, (n, 9)."""
    nominal = alignment.nominal
    x, y = (v - 0.5 * (v.min() + v.max()) for v in (nodes.x_mm, nodes.y_mm))
    radius = float(np.hypot(x, y).max()) or 1.0
    u, v = x / radius, y / radius
    jet = nominal.surface.jet(nodes.x_mm, nodes.y_mm)
    nx, ny, nz = unit_normal(jet, nominal.side).T
    z = (jet.z - nodes.mean(jet.z)) / radius
    square = u * u + v * v
    motions_and_power = np.column_stack([nz, v * nz - z * ny, z * nx - u * nz, np.abs(nz) * square])
    return motions_and_power, legendre.legvander(2.0 * square - 1.0, RADIAL_TERMS - 1)


def _orthonormal(columns: Array, nodes: MapNodes) -> Array:
    """Return columns with ``mean(w q_i q_j) = delta_ij``, each the given one less all before it."""
    root = np.sqrt(nodes.weight)[:, None]
    return np.asarray(orthonormalised(columns * root)[0] / root, dtype=np.float64)
