"""From a correction where it is known to one over the whole aperture, with the origin of every node.

Holes are bridged by a thin plate under tension. Beyond what was measured the plate carries the surface on
without a kink, and fades to nothing over the width of the wheel's contact (``cos^2``): there the machine is
told what it was told before. The same fading leads out of the region to correct. Continued values stay
within the range of those with data. Nodes with too few points to a cell count as unknown; a cell is a
square with half the shortest corrected wave for a side, the smallest thing that a correction draws.
"""

from __future__ import annotations

from math import pi, sqrt
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmm_align.config import CompensateConfig
from cmm_align.errors import InputError
from cmm_align.model import CorrectionStatus, DeviationMap
from cmm_align.numerics.smooth_extension import extended
from cmm_align.stages.map_grid import Places
from cmm_align.stages.map_noise import step_of
from cmm_align.surfaces.protocol import Array, Mask
from cmm_align.surfaces.region import Region
from cmm_align.units import MRAD_PER_RAD, UM_PER_MM

ROUNDING_MM: Final = 1e-9
"""Less than this is not called clipped."""


class Reach(NamedTuple):
    """A complete correction.

    `correction_mm` and `status` have shape (ny, nx).
    """

    correction_mm: Array
    status: NDArray[np.uint8]
    taper_mm: float


def too_few_points(deviation_map: DeviationMap, points: Places, low_pass_mm: float, least: int) -> Mask:
    """Return the nodes of a map whose cell holds fewer points than asked for, shape (ny, nx).

    Parameters
    ----------
    deviation_map : DeviationMap
    points : Places
    low_pass_mm : float
        Shortest corrected wave: half of it is the side of a cell.
    least : int
    """
    bins, windows = [], []
    for nodes, places in ((deviation_map.y_mm, points.y_mm), (deviation_map.x_mm, points.x_mm)):
        half = 0.5 * step_of(nodes)
        reach = max(round(0.25 * low_pass_mm / half), 1)
        bins.append(np.floor((places - nodes[0]) / half).astype(np.intp) + reach)
        windows.append((reach, 2 * len(nodes) + 2 * reach))
    inside = np.ones(len(points.x_mm), dtype=np.bool_)
    for place, (_, size) in zip(bins, windows, strict=True):
        inside &= (place >= 0) & (place < size)
    shape = windows[0][1], windows[1][1]
    flat = np.ravel_multi_index((bins[0][inside], bins[1][inside]), shape)
    counts = np.bincount(flat, minlength=shape[0] * shape[1]).reshape(shape)
    sums = np.pad(counts, ((1, 0), (1, 0))).cumsum(axis=0).cumsum(axis=1)
    (ry, _), (rx, _) = windows
    ny, nx = deviation_map.deviation_mm.shape
    rows, columns = 2 * np.arange(ny)[:, None], 2 * np.arange(nx)
    inside_cell = (
        sums[rows + 2 * ry, columns + 2 * rx]
        - sums[rows, columns + 2 * rx]
        - sums[rows + 2 * ry, columns]
        + sums[rows, columns]
    )
    return np.asarray(inside_cell < least) & np.isfinite(deviation_map.deviation_mm)


def region_mask(region: Region | None, x_mm: Array, y_mm: Array, known: Mask) -> Mask:
    """Return the nodes of a grid in the region to correct, shape (ny, nx).

    Parameters
    ----------
    region : Region or None
        None for everything.
    x_mm, y_mm : ndarray, shape (nx,), (ny,), mm, frame `surface`
    known : ndarray of bool, shape (ny, nx)

    Raises
    ------
    InputError
        If the map knows nothing in the region.
    """
    if region is None:
        return np.ones(known.shape, dtype=np.bool_)
    x, y = np.meshgrid(x_mm, y_mm)
    inside = region.contains(x.ravel(), y.ravel()).reshape(known.shape)
    if not (inside & known).any():
        iy, ix = np.nonzero(known)
        raise InputError(
            f"the region to correct ({region.words}) lies outside the map",
            expected=f"a region within x {x_mm[ix.min()]:.4g} to {x_mm[ix.max()]:.4g} mm, "
            f"y {y_mm[iy.min()]:.4g} to {y_mm[iy.max()]:.4g} mm",
            remedy="check --region",
        )
    return inside


def taper_width_mm(config: CompensateConfig, low_pass_mm: float, largest_mm: float) -> float:
    """Return the width over which a correction fades where it has no data.

    Parameters
    ----------
    config : CompensateConfig
        Its `edge_taper_mm` if given; else the length of the wheel's contact, ``2 sqrt(2 rho d)``, d the
        depth of cut or, where it is not known, the size of the correction; else the shortest corrected
        wave.
    low_pass_mm : float
    largest_mm : float
        Largest correction: the fading shall not reach the slope that is warned of.
    """
    if config.edge_taper_mm > 0.0:
        return config.edge_taper_mm
    depth = config.depth_of_cut_um / UM_PER_MM if config.depth_of_cut_um > 0.0 else largest_mm
    contact = 2.0 * sqrt(2.0 * config.wheel_radius_mm * depth)
    gentle = 0.5 * pi * largest_mm / (config.warn_slope_mrad / MRAD_PER_RAD)
    return max(contact if contact > 0.0 else low_pass_mm, gentle)


def completed(
    wanted: Array,
    few: Mask,
    inside: Mask,
    region: Mask,
    steps_mm: tuple[float, float],
    taper_mm: float,
) -> Reach:
    """Return a correction continued over the whole grid, with the origin of each node.

    Parameters
    ----------
    wanted : ndarray, shape (ny, nx), mm
        NaN where there are no data.
    few : ndarray of bool, shape (ny, nx)
        Nodes that were left out for too few points.
    inside : ndarray of bool, shape (ny, nx)
        The aperture.
    region : ndarray of bool, shape (ny, nx)
        Where to correct.
    steps_mm : pair of float
        Grid steps along x and y.
    taper_mm : float
    """
    from scipy.ndimage import distance_transform_edt

    known = np.isfinite(wanted)
    hole = _holes(~known & inside, inside)
    field = extended(wanted, taper_mm / max(steps_mm))
    low, high = float(wanted[known].min()), float(wanted[known].max())
    held = np.clip(field, low, high)
    sampling = steps_mm[::-1]
    beyond = ~known & ~hole
    fade = np.ones(field.shape)
    if beyond.any():
        fade *= _fading(distance_transform_edt(~(known | hole), sampling=sampling), taper_mm)
    if not region.all():
        fade *= _fading(distance_transform_edt(~region, sampling=sampling), taper_mm)
    status = np.zeros(field.shape, dtype=np.uint8)
    status[beyond] = CorrectionStatus.BEYOND
    status[hole] = CorrectionStatus.BRIDGED
    status[few & ~known] = CorrectionStatus.FEW_POINTS
    status[np.abs(held - field) * fade > ROUNDING_MM] = CorrectionStatus.CLIPPED
    status[~region] = CorrectionStatus.OUTSIDE_REGION
    return Reach(held * fade, status, taper_mm)


def _holes(unknown: Mask, inside: Mask) -> Mask:
    """Return the unknown nodes inside the aperture that known ones surround."""
    from scipy.ndimage import binary_dilation, label

    parts, count = label(unknown, structure=np.ones((3, 3)))
    outside = np.pad(~inside, 1, constant_values=True)
    open_to = np.unique(parts[binary_dilation(outside, np.ones((3, 3), dtype=np.bool_))[1:-1, 1:-1]])
    closed = np.ones(count + 1, dtype=np.bool_)
    closed[open_to] = False
    closed[0] = False
    return np.asarray(closed[parts], dtype=np.bool_)


def _fading(distance_mm: Array, taper_mm: float) -> Array:
    fade = np.cos(0.5 * np.pi * distance_mm / taper_mm) ** 2
    return np.asarray(np.where(distance_mm < taper_mm, fade, 0.0))
