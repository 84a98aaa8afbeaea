"""The known nodes of a map as plain columns, with what noise and pose do to sums and extremes of them."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from cmm_align.model import Alignment, Nominal
from cmm_align.numerics.linearisation import even_sample
from cmm_align.numerics.local_regression import LocalFit
from cmm_align.surfaces.geometry import unit_normal
from cmm_align.surfaces.protocol import Array, Mask

POSE_SAMPLE: Final = 20_000
"""Points that tell how strongly the pose is held."""


class MapNodes(NamedTuple):
    """Known nodes of a map, frame `surface`, each array of shape (n,) unless said."""

    x_mm: Array
    y_mm: Array
    deviation_mm: Array
    weight: Array
    """Area, mean 1."""
    sigma_mm: Array
    """Standard uncertainty from the scatter of the points."""
    machine_mm: Array
    """Standard uncertainty beyond that: what touches have in common where it was simulated, or what stated
    uncertainties are larger than the scatter; else 0."""
    handed_mm2: Array
    """What the noise of the points hands to a sum of nodes: `handed_noise`."""
    known: Mask
    """Shape (ny, nx)."""
    step_mm: tuple[float, float]
    """Of the grid, along x and y."""

    @property
    def alike(self) -> float:
        """How many neighbouring nodes stand for one independent value; at least 1."""
        noise = float(np.mean(self.sigma_mm**2))
        return max(1.0, float(np.mean(self.handed_mm2)) / noise) if noise > 0.0 else 1.0

    def mean(self, values: Array) -> float:
        """Return the mean of values, shape (n,), by area."""
        return float(np.mean(self.weight * values))

    def rms(self, values: Array) -> float:
        """Return the root mean square of values, shape (n,), by area."""
        return float(np.sqrt(self.mean(values**2)))

    def noise_of_mean(self, pull: Array) -> float:
        """Return the standard uncertainty of the mean of pull, shape (n,), times deviation."""
        return float(np.sqrt(np.sum((self.weight * pull) ** 2 * self.handed_mm2))) / len(self.weight)

    def noise_of_rms(self, values: Array) -> float:
        """Return the standard uncertainty that noise gives to the RMS of values, shape (n,)."""
        rms = self.rms(values)
        return self.noise_of_mean(values / rms) if rms > 0.0 else self.noise_of_mean(np.ones_like(values))


def map_nodes(
    axes_mm: tuple[Array, Array],
    deviation_mm: Array,
    fit: LocalFit,
    sigma_mm: Array,
    handed_mm2: Array,
    weights: Array,
) -> MapNodes:
    """Return the known nodes of a map.

    Parameters
    ----------
    axes_mm : pair of ndarray, shape (nx,) and (ny,), mm, frame `surface`
    deviation_mm : ndarray, shape (ny, nx), mm
        NaN where unknown.
    fit : LocalFit
        What gave the nodes.
    sigma_mm : ndarray, shape (ny, nx), mm
        Standard uncertainty of all causes.
    handed_mm2 : ndarray, shape (ny, nx), mm^2
    weights : ndarray, shape (ny, nx)
        Area of each node, any unit.
    """
    known = np.isfinite(deviation_mm)
    x, y = (grid[known] for grid in np.meshgrid(*axes_mm))
    scatter = np.nan_to_num(fit.sigma[known])
    machine = np.sqrt(np.maximum(np.nan_to_num(sigma_mm[known]) ** 2 - scatter**2, 0.0))
    return MapNodes(
        x,
        y,
        deviation_mm[known],
        weights[known] / weights[known].mean(),
        scatter,
        machine,
        np.nan_to_num(handed_mm2[known]),
        known,
        (float(axes_mm[0][1] - axes_mm[0][0]), float(axes_mm[1][1] - axes_mm[1][0])),
    )


def pose_rows(nominal: Nominal, centroid_mm: Array, x_mm: Array, y_mm: Array) -> Array:
    """Return how small motions change deviations: ``[(p - c) x n, n]``, shape (k, 6), frame `part`.

    Parameters
    ----------
    nominal : Nominal
    centroid_mm : ndarray, shape (3,), mm, frame `part`
        What the motions turn about: `Alignment.centroid_mm`.
    x_mm, y_mm : ndarray, shape (k,), mm, frame `surface`
    """
    jet = nominal.surface.jet(x_mm, y_mm)
    back = nominal.surface_from_part.inverse()
    normals = back.rotate(unit_normal(jet, nominal.side))
    arms = back.apply(np.stack([x_mm, y_mm, jet.z], axis=1)) - centroid_mm
    return np.hstack([np.cross(arms, normals), normals])


def noise_of_pose(alignment: Alignment, centroid_mm: Array, noise_mm: float) -> Array:
    """Return the part of the covariance of the pose that noise of the points makes, shape (6, 6), rad and mm.

    Parameters
    ----------
    alignment : Alignment
        Its covariance tells where the part is: it is raised where form error lets neighbours err alike. The
        form that is left after a best fit does not depend on that; what moves it is noise.
    centroid_mm : ndarray, shape (3,), mm, frame `part`
        Of its tip centres.
    noise_mm : float
        Of a single point.

    Returns
    -------
    ndarray, shape (6, 6)
        ``C s_n^2 rank / tr(C J^T J)``; all of C where datum points hold the pose.
    """
    whole = np.nan_to_num(alignment.covariance, posinf=0.0)
    used = np.flatnonzero(alignment.used)
    if alignment.report.n_fiducials or len(used) == 0:
        return whole
    at = used[even_sample(len(used), POSE_SAMPLE)]
    normals = alignment.normals[at]
    rows = np.hstack([np.cross(alignment.tip_centre_part_mm[at] - centroid_mm, normals), normals])
    told = float(np.trace(whole @ (rows.T @ rows))) * len(used) / len(at)
    rank = int(np.linalg.matrix_rank(whole)) if told > 0.0 else 0
    if rank == 0:
        return np.zeros((6, 6))
    return np.asarray(whole * min(1.0, noise_mm**2 * rank / told), dtype=np.float64)


def pose_share(covariance: Array, gradient: Array) -> float:
    """Return the standard uncertainty from the pose in what changes by `gradient` with it.

    Parameters
    ----------
    covariance : ndarray, shape (6, 6), rad and mm
    gradient : ndarray, shape (6,)
    """
    return float(np.sqrt(max(float(gradient @ covariance @ gradient), 0.0)))
