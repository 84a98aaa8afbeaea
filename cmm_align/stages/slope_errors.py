"""Slope errors: the gradient of the deviation along the surface.

The local polynomial behind each node has a gradient of its own, with the variance that noise gives it; no
difference of nodes is taken. Over the projection it is ``g = (de/dx, de/dy)``; along the surface, whose
metric is ``G = I + s s^T`` with the slope s of the nominal, its length is

    |grad e|^2 = g^T G^-1 g = |g|^2 - (g . s)^2 / (1 + |s|^2).                                       (1)

Noise adds ``tr(G^-1 C)`` to its mean square, C being the covariance of g; that share is taken out of the RMS.
What noise adds to the largest slope is that of `numerics.extreme_value`. On the border, where windows are
one-sided, slopes are known several times worse; such nodes are left out and counted. Where waves were
filtered away the gradient is the central difference of the nodes, two steps long, and noise is not taken out.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from cmm_align.model import SlopeError
from cmm_align.numerics.extreme_value import largest_excess
from cmm_align.numerics.grid_field import smoothed
from cmm_align.numerics.local_regression import reach_of
from cmm_align.stages.map_nodes import MapNodes
from cmm_align.stages.noise_shares import Measured
from cmm_align.surfaces.protocol import Array
from cmm_align.units import MRAD_PER_RAD

WORST: Final = 3.0
"""Nodes whose slope is known so many times worse than that of most, on the border, are left out."""
BY_REGRESSION: Final = "gradient of the local polynomials"
BY_DIFFERENCE: Final = "central difference of the filtered nodes, noise not taken out"


def slope_errors(m: Measured) -> SlopeError | None:
    """Return the slope errors of a map, or None where no node has a slope."""
    nodes, known = m.nodes, m.nodes.known
    gx, gy = _differences(m.deviation_mm, nodes) if m.filtered else m.fit.slope
    cxx, cyy, cxy = m.fit.slope_covariance[:, known]
    x, y = nodes.x_mm, nodes.y_mm
    jet = m.alignment.nominal.surface.jet(x, y)
    steep = 1.0 + jet.zx**2 + jet.zy**2

    def squared(along_x: Array, along_y: Array) -> Array:
        """Return eq. (1) at the known nodes."""
        p, q = along_x[known], along_y[known]
        return np.maximum(p**2 + q**2 - (p * jet.zx + q * jet.zy) ** 2 / steep, 0.0)

    square = squared(gx, gy)
    noise2 = cxx + cyy - (cxx * jet.zx**2 + 2.0 * cxy * jet.zx * jet.zy + cyy * jet.zy**2) / steep
    there = np.isfinite(square) & np.isfinite(noise2)
    if not there.any():
        return None
    there &= noise2 <= WORST**2 * np.median(noise2[there])
    form2 = squared(smoothed(gx), smoothed(gy))[there]
    square, noise2, x, y = (v[there] for v in (square, noise2, x, y))
    weight, size = nodes.weight[there], np.sqrt(square)
    rms2, added2 = (float(np.average(v, weights=weight)) for v in (square, noise2))
    kept2 = rms2 if m.filtered else max(rms2 - added2, 0.0)
    n_free = len(size) / nodes.alike
    sigma = np.sqrt(0.5 * noise2)
    form2 *= kept2 / rms2 if rms2 > 0.0 else 1.0
    largest = largest_excess(np.sqrt(form2 + sigma**2), sigma, alike=nodes.alike)
    at = int(np.argmax(size))
    added = max(largest.mean - float(np.sqrt(form2.max())), 0.0)
    turn = float(np.sqrt(np.diag(m.pose_covariance)[:2].max()))
    variance = added2 * (2.0 * kept2 + added2) / n_free  # of the mean of |g + noise|^2
    u_rms = 0.5 * (variance / max(kept2, added2)) ** 0.5 if max(kept2, added2) > 0.0 else 0.0
    return SlopeError(
        rms_mrad=kept2**0.5 * MRAD_PER_RAD,
        u_rms_mrad=float(np.hypot(u_rms, turn)) * MRAD_PER_RAD,
        noise_mrad=added2**0.5 * MRAD_PER_RAD,
        max_mrad=float(size[at]) * MRAD_PER_RAD,
        max_without_noise_mrad=(float(size[at]) - (0.0 if m.filtered else added)) * MRAD_PER_RAD,
        u_max_mrad=float(np.hypot(largest.sd, turn)) * MRAD_PER_RAD,
        max_at_mm=(float(x[at]), float(y[at])),
        n_left_out=int(np.count_nonzero(~there)),
        base_mm=2.0 * max(nodes.step_mm) if m.filtered else (2 * reach_of(m.window) + 1) * max(nodes.step_mm),
        method=BY_DIFFERENCE if m.filtered else BY_REGRESSION,
    )


def _differences(field: Array, nodes: MapNodes) -> tuple[Array, Array]:
    """Return central differences along x and y; NaN where a neighbour is unknown."""
    gx, gy = np.full_like(field, np.nan), np.full_like(field, np.nan)
    gx[:, 1:-1] = (field[:, 2:] - field[:, :-2]) / (2.0 * nodes.step_mm[0])
    gy[1:-1] = (field[2:] - field[:-2]) / (2.0 * nodes.step_mm[1])
    return gx, gy
