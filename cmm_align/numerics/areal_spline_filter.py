"""Areal spline filter on a masked grid: no kernel, no padding, no end effects.

The long waves w of the values v minimise, with the tension 0,

    sum (v - w)^2 + sum (cx Dxx w)^2 + 2 cx cy (Dxy w)^2 + (cy Dyy w)^2,    c = 1 / (4 sin^2(pi d / Lc)),

the first sum over the known nodes, the others over the second differences inside the part: the known nodes
and the gaps between them up to a cutoff long, which the spline bridges. The border is free, and a plane costs
nothing. A wave of length L along an axis of step d keeps

    H = 1 / (1 + [sin(pi d / L) / sin(pi d / Lc)]^4),

half at the cutoff exactly. The discrete energy is not quite round: along a diagonal 0.447 is kept for a
cutoff of 4 steps, 0.492 for 10, 0.498 for 20. Where a share m of the nodes is missing, the others pull less:
(1 - m) / (2 - m) is kept at the cutoff, 0.474 for a tenth.

Sources: ISO 16610-22 (profile spline filter: the formula of H) and -62 (areal); M. Krystek, "Form filtering
by splines", Measurement 18, 1996, doi 10.1016/0263-2241(96)00039-5. Solved by conjugate gradients,
preconditioned by the cosine transform that solves the same problem with mirror borders.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from cmm_align.errors import NumericsError
from cmm_align.numerics.areal_filter import Spacing, cutoff_limits_mm, require_cutoff, spacings

if TYPE_CHECKING:
    from scipy.sparse import csr_array

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_STENCILS: Final = (
    (((0, 0), (0, 1), (0, 2)), (1.0, -2.0, 1.0)),
    (((0, 0), (1, 0), (2, 0)), (1.0, -2.0, 1.0)),
    (((0, 0), (0, 1), (1, 0), (1, 1)), (1.0, -1.0, -1.0, 1.0)),
)
"""Second differences along x, along y and mixed: steps (iy, ix) of their nodes, and the factors."""

_TOLERANCE: Final = 1e-10
"""Residual of the equations over their right side."""

_MAX_STEPS: Final = 2000


def spline_transmission(wavelength_mm: Array, cutoff_mm: float, spacing_mm: float) -> Array:
    """Return the share of the amplitude of a wave along an axis that the spline filter keeps.

    Parameters
    ----------
    wavelength_mm : ndarray, any shape, mm
        At least twice the spacing.
    cutoff_mm : float
    spacing_mm : float
        Along the wave.

    Returns
    -------
    ndarray, same shape
        1/2 at the cutoff, towards 1 for longer waves.
    """
    ratio = np.sin(np.pi * spacing_mm / np.asarray(wavelength_mm)) / np.sin(np.pi * spacing_mm / cutoff_mm)
    return np.asarray(1.0 / (1.0 + ratio**4), dtype=np.float64)


def spline_filter(values: Array, spacing_mm: Spacing, cutoff_mm: float) -> Array:
    """Return the long waves of a masked grid by the areal spline filter.

    Parameters
    ----------
    values : ndarray, shape (ny, nx)
        Any unit; NaN where unknown.
    spacing_mm : float or pair of float
        Of both axes, or along x and along y.
    cutoff_mm : float
        Wavelength that keeps half its amplitude.

    Returns
    -------
    ndarray, shape (ny, nx)
        Unit of `values`; NaN where these are unknown, or in no second difference with known ones.

    Raises
    ------
    UsageError
        If the cutoff is outside `cutoff_limits_mm`.
    GeometryError
        If nothing is known.
    NumericsError
        If the equations are not solved.

    Notes
    -----
    50 +- 0.5 % at the cutoff along an axis; a plane reproduced to 1e-12 at the border (tested).
    """
    require_cutoff(cutoff_mm, cutoff_limits_mm(values, spacing_mm))
    known = np.isfinite(values)
    dx, dy = spacings(spacing_mm)
    stiffness = [0.25 / np.sin(np.pi * step / cutoff_mm) ** 2 for step in (dx, dy)]
    plane = _plane(values, known)
    part = _without_gaps(known, (cutoff_mm / dx, cutoff_mm / dy))
    differences = _second_differences(part, stiffness)
    rest = np.where(known, values - plane, 0.0)[part]
    smooth = np.full(values.shape, np.nan)
    smooth[part] = _solved(differences, rest, known[part], part, stiffness)
    touched = np.zeros(values.shape)
    touched[part] = abs(differences).sum(axis=0)
    return np.where(known & (touched > 0.0), plane + smooth, np.nan)


def _without_gaps(known: Mask, longest: tuple[float, float]) -> Mask:
    """Return the known nodes, gaps up to two nodes wide, and holes no longer than so many nodes (x, y).

    A wider hole has a free border: nothing would hold the spline in its middle.
    """
    from scipy.ndimage import binary_closing, binary_fill_holes, find_objects, label

    square = np.ones((3, 3), dtype=np.bool_)
    closed = known | binary_closing(np.pad(known, 2), structure=square)[2:-2, 2:-2]
    holes, _ = label(binary_fill_holes(closed) & ~closed)
    for number, (rows, columns) in enumerate(find_objects(holes), start=1):
        if columns.stop - columns.start <= longest[0] and rows.stop - rows.start <= longest[1]:
            closed[rows, columns] |= holes[rows, columns] == number
    return np.asarray(closed, dtype=np.bool_)


def _second_differences(part: Mask, stiffness: list[float]) -> csr_array:
    """Return the weighted second differences inside the part, one a row."""
    from scipy.sparse import csr_array, vstack

    index = np.cumsum(part).reshape(part.shape) - 1
    cx, cy = stiffness
    n = int(np.count_nonzero(part))
    blocks = []
    for (steps, factors), weight in zip(_STENCILS, (cx, cy, (2.0 * cx * cy) ** 0.5), strict=True):
        ny, nx = (
            max(size - max(step), 0) for size, step in zip(part.shape, zip(*steps, strict=True), strict=True)
        )
        windows = [(slice(iy, iy + ny), slice(ix, ix + nx)) for iy, ix in steps]
        whole = np.logical_and.reduce([part[window] for window in windows])
        columns = np.stack([index[window][whole] for window in windows], axis=1)
        rows = np.repeat(np.arange(len(columns)), len(steps))
        entries = np.tile(weight * np.array(factors), len(columns))
        blocks.append(csr_array((entries, (rows, columns.ravel())), shape=(len(columns), n)))
    return csr_array(vstack(blocks))


def _plane(values: Array, known: Mask) -> Array:
    """Return the least-squares plane of the known values at all nodes: it passes the filter as it is."""
    iy, ix = np.indices(known.shape) - np.argwhere(known).mean(axis=0)[:, None, None]
    basis = np.stack([np.ones(known.shape), ix, iy], axis=-1)
    coefficients, *_ = np.linalg.lstsq(basis[known], values[known], rcond=None)
    return np.asarray(basis @ coefficients, dtype=np.float64)


def _solved(differences: csr_array, v: Array, weights: Mask, part: Mask, stiffness: list[float]) -> Array:
    """Return w of ``(diag(weights) + D^T D) w = v`` by preconditioned conjugate gradients."""
    from scipy.fft import dctn, idctn

    transposed = differences.T.tocsr()
    bending = sum(
        np.expand_dims(4.0 * c * np.sin(0.5 * np.pi * np.arange(n) / n) ** 2, axis)
        for n, c, axis in zip(part.shape[::-1], stiffness, (0, 1), strict=True)
    )
    mirror = 1.0 + np.asarray(bending) ** 2
    box = np.zeros(part.shape)

    def nearly_solved(r: Array) -> Array:
        box[part] = r
        return np.asarray(idctn(dctn(box) / mirror)[part], dtype=np.float64)

    w = np.zeros_like(v)
    residual = v.copy()
    goal = _TOLERANCE * float(np.linalg.norm(v))
    step = nearly_solved(residual)
    descent = float(residual @ step)
    for _ in range(_MAX_STEPS):
        if float(np.linalg.norm(residual)) <= goal:
            return w
        image = weights * step + transposed @ (differences @ step)
        length = descent / float(step @ image)
        w += length * step
        residual -= length * image
        better = nearly_solved(residual)
        previous, descent = descent, float(residual @ better)
        step = better + (descent / previous) * step
    raise NumericsError(
        f"the spline filter of {len(v)} nodes is not solved after {_MAX_STEPS} steps",
        remedy="choose a shorter cutoff, or the Gaussian filter",
    )
