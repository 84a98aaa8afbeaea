"""Two measurements of one part on one grid, with their noise and their poses.

Both go from their points through one local regression on one grid: that of the later map, or a coarser one
where the earlier measurement carries no more. So both are seen with the same eyes: a form that the window
smooths is smoothed in both and falls out of the difference, nothing is interpolated between nodes, and a node
is known where points stand around it: nothing is extrapolated, holes stay holes.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from cmm_align.config import ErrorMapConfig
from cmm_align.model import Alignment, DeviationMap
from cmm_align.numerics.aperture_basis import node_widths
from cmm_align.numerics.handed_noise import handed_noise
from cmm_align.numerics.local_regression import local_regression
from cmm_align.stages.error_map import told_at, u_of_nodes
from cmm_align.stages.map_grid import Places, axis_over, places_of, step_of
from cmm_align.stages.map_nodes import pose_rows
from cmm_align.stages.report_region import reported_in
from cmm_align.surfaces.protocol import Array, Mask
from cmm_align.surfaces.region import region_from_text
from cmm_align.units import UM_PER_MM

COARSER: Final = 1.25
"""An earlier measurement whose own step is so many times larger sets the grid."""
WINDOW_FREEDOM: Final = 20.0
"""Degrees of freedom that the scatter of a window borrows from the whole map."""


class Side(NamedTuple):
    """One of two measurements on their common grid; arrays (ny, nx), NaN where not both are known."""

    alignment: Alignment
    deviation_mm: Array
    sigma_mm: Array
    """Standard uncertainty of a node: noise and simulated errors."""
    noise_mm: Array
    """The part of it that is noise."""
    pose_mm2: Array
    """Variance from the pose."""
    handed_mm2: Array
    """What noise hands to the sum of the nodes (`handed_noise`)."""
    freedom: Array
    """Of `noise_mm`."""
    spare: float
    """Points that are left to tell the noise of the whole map."""


class Pair(NamedTuple):
    """Two measurements on one grid, frame `surface`."""

    x_mm: Array
    y_mm: Array
    known: Mask
    """To both, shape (ny, nx)."""
    common: float
    """Share of the later one's area that both know."""
    weights: Array
    """Area of each node, in steps, shape (ny, nx)."""
    late: Side
    early: Side


def on_common_grid(after: DeviationMap, before: Alignment, config: ErrorMapConfig) -> Pair:
    """Return two measurements of one nominal on one grid.

    Parameters
    ----------
    after : DeviationMap
        The later one; its grid is taken unless the earlier one is coarser.
    before : Alignment
        Within the report region of the later one: windows on its border are then one-sided in both.
    config : ErrorMapConfig
        Its window is used for both.
    """
    region = after.alignment.report.report_region_text
    if region:
        before = reported_in(before, region_from_text(region, before.nominal.surface))
    places = places_of(after.alignment), places_of(before)
    axes = _common_axes(after, places, config)
    x_grid, y_grid = np.meshgrid(*axes)
    inside = told_at(after.alignment, x_grid.ravel(), y_grid.ravel()).reshape(x_grid.shape)
    late = _side(after.alignment, places[0], axes, config)
    early = _side(before, places[1], axes, config)
    of_late = inside & np.isfinite(late.deviation_mm)
    known = of_late & np.isfinite(early.deviation_mm)
    widths = [
        node_widths(nodes, float(p.min()), float(p.max()))
        for nodes, p in zip(axes, places[0][:2], strict=True)
    ]
    weights = np.asarray(np.outer(widths[1], widths[0]), dtype=np.float64)
    common = float(weights[known].sum() / max(float(weights[of_late].sum()), 1.0))
    return Pair(*axes, known, common, weights, _masked(late, known), _masked(early, known))


def u_rms(pair: Pair, side: Side) -> float:
    """Return the standard uncertainty of the RMS of one side over the common nodes, mm.

    In quadrature: its noise, what the noise that the nodes keep adds to it, the pose, and what a Monte Carlo
    found.

    Parameters
    ----------
    pair : Pair
    side : Side
        One of the two.
    """
    e, w = side.deviation_mm[pair.known], pair.weights[pair.known]
    w = w / w.mean()
    rms = float(np.sqrt(np.mean(w * e**2)))
    added = float(np.mean(w * side.noise_mm[pair.known] ** 2))
    if rms == 0.0:
        return float(added**0.5)
    noise = float(np.mean((w * e) ** 2 * side.handed_mm2[pair.known])) / (len(e) * rms**2)
    x, y = (grid[pair.known] for grid in np.meshgrid(pair.x_mm, pair.y_mm))
    gradient = (w * e) @ pose_rows(side.alignment.nominal, side.alignment.centroid_mm, x, y) / (len(e) * rms)
    pose = max(float(gradient @ _covariance(side.alignment) @ gradient), 0.0)
    simulated = side.alignment.report.monte_carlo
    machine = 0.0 if simulated is None else simulated.rms.std_um / UM_PER_MM
    return float(np.sqrt(noise + (added / (2.0 * rms)) ** 2 + pose + machine**2))


def _common_axes(
    after: DeviationMap, places: tuple[Places, Places], config: ErrorMapConfig
) -> tuple[Array, Array]:
    """Return the grid of the later map, or a coarser one where the earlier measurement carries no more."""
    own_mm = step_of(places[1], replace(config, spacing_mm=0.0))
    if own_mm <= COARSER * after.spacing_mm:
        return after.x_mm, after.y_mm
    late = places[0]
    return axis_over(late.x_mm, own_mm, exact=False), axis_over(late.y_mm, own_mm, exact=False)


def _side(alignment: Alignment, places: Places, axes: tuple[Array, Array], config: ErrorMapConfig) -> Side:
    """Return one measurement on the common grid, where it is known."""
    x, y, deviation, _ = places
    fit = local_regression(x, y, deviation, *axes, half_width=config.window)
    known = np.isfinite(fit.value)
    sigma = u_of_nodes(alignment, places, fit, axes, config)
    noise = fit.sigma if alignment.report.monte_carlo is not None else sigma
    raised = noise[known] / np.where(fit.sigma[known] > 0.0, fit.sigma[known], np.inf)
    lift = (
        float(np.median(raised)) if raised.size else 1.0
    )  # where uncertainties are stated, larger than seen
    handed = handed_noise(fit, known, half_width=config.window) * lift**2
    places_x, places_y = (grid.ravel() for grid in np.meshgrid(*axes))
    rows = pose_rows(alignment.nominal, alignment.centroid_mm, places_x, places_y)
    pose = np.einsum("ni,ij,nj->n", rows, _covariance(alignment), rows).reshape(known.shape)
    cells = (2 * max(1, int(config.window)) + 1) ** 2
    spare = max(len(x) - 6.0 * np.count_nonzero(known) / cells, 1.0)
    return Side(
        alignment=alignment,
        deviation_mm=fit.value,
        sigma_mm=sigma,
        noise_mm=noise,
        pose_mm2=np.maximum(pose, 0.0),
        handed_mm2=handed,
        freedom=WINDOW_FREEDOM + np.maximum(fit.count - 6.0, 0.0),
        spare=float(spare),
    )


def _masked(side: Side, known: Mask) -> Side:
    """Return a side without the nodes that are not common."""
    return side._replace(
        deviation_mm=np.where(known, side.deviation_mm, np.nan),
        sigma_mm=np.where(known, side.sigma_mm, np.nan),
        noise_mm=np.where(known, side.noise_mm, np.nan),
        pose_mm2=np.where(known, side.pose_mm2, np.nan),
        freedom=np.where(known, side.freedom, np.nan),
    )


def _covariance(alignment: Alignment) -> Array:
    """Return the covariance of the pose, nothing for motions that are free: they change no deviation."""
    return np.nan_to_num(alignment.covariance, nan=0.0, posinf=0.0, neginf=0.0)
