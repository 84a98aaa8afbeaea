"""Power spectral density of a map, averaged over directions, with the noise floor of the measurement in it.

Convention: C(fx, fy) in mm^4 over both signs of both frequencies, so that its integral is a variance,

    C = dx dy |sum_j w_j e_j exp(-2 pi i f . x_j)|^2 / sum_j w_j^2,
    sum C dfx dfy = sum w^2 e^2 / sum w^2    (Parseval, exact over all modes),

and a ring of the frequency plane holds its mean C times its area. e are the values less their plane. The
window w rises from the border of what is known as ``sin^2(pi d / (2 t))`` with the distance d from the next
unknown node up to t, and is 1 inside; the division by sum w^2 is its correction. White noise of standard
deviation u a node is flat, ``C = u^2 dx dy``.

Sources: ISO 10110-8 (two-dimensional spectral density of optical surfaces); F. J. Harris, "On the use of
windows for harmonic analysis with the discrete Fourier transform", Proc. IEEE 66, 1978, doi
10.1109/PROC.1978.10837.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, nan
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cmm_align.errors import GeometryError, UsageError
from cmm_align.numerics.areal_filter import Spacing, spacings
from cmm_align.numerics.grid_field import continued

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MIN_NODES: Final = 8
"""Fewer known nodes than this along a side hold no spectrum."""


TIED_STEPS: Final = 3
"""Modes further apart than this along an axis count as independent: the window leaves under 1e-3 there."""


@dataclass(frozen=True, slots=True)
class RadialPsd:
    """A power spectral density averaged over directions; one entry a ring of the frequency plane.

    Attributes
    ----------
    frequency_per_mm : tuple of float
        Mean of the frequencies in the ring, 1/mm, ascending.
    psd_mm4 : tuple of float
        Mean of C(fx, fy) over the ring, mm^4, noise included.
    area_per_mm2 : tuple of float
        Area of the ring in the frequency plane, 1/mm^2: psd times area is the ring's share of the variance.
    edge_per_mm : tuple of float
        Borders of the rings, 1/mm; one more than rings.
    freedom : tuple of float
        Independent values in the ring, those that the window ties together counted once: the psd of noise
        scatters by ``sqrt(2 / freedom)`` of itself.
    noise_floor_mm4 : float
        C of the noise, the same at all frequencies, mm^4; NaN if no uncertainty is known.
    variance_mm2 : float
        Of the windowed map; the sum of psd times area.
    nyquist_per_mm : float
        Rings past it are not complete, 1/mm.
    taper_mm : float
        Width t of the rise of the window.
    bridged : int
        Unknown nodes within the map that were continued smoothly.
    """

    frequency_per_mm: tuple[float, ...]
    psd_mm4: tuple[float, ...]
    area_per_mm2: tuple[float, ...]
    edge_per_mm: tuple[float, ...]
    freedom: tuple[float, ...]
    noise_floor_mm4: float
    variance_mm2: float
    nyquist_per_mm: float
    taper_mm: float
    bridged: int


def radial_psd(
    values: Array, spacing_mm: Spacing, sigma_mm: Array | float = 0.0, *, taper: float = 0.5
) -> RadialPsd:
    """Return the power spectral density of a masked map, averaged over directions.

    Parameters
    ----------
    values : ndarray, shape (ny, nx), mm
        NaN where unknown. Gaps up to two nodes wide are bridged, wider holes are a border.
    spacing_mm : float or pair of float
        Of both axes, or along x and along y.
    sigma_mm : ndarray, shape (ny, nx), mm, or float
        Standard uncertainty of the nodes as if independent. Nodes that share points are not: for them give
        ``s / sqrt(n)``, s the scatter of a single point and n the points to a cell of the grid, which is
        their floor at the frequencies that the map resolves.
    taper : float
        Width of the rise of the window over the largest distance from the border, above 0, at most 1.

    Returns
    -------
    RadialPsd

    Raises
    ------
    GeometryError
        If fewer than `MIN_NODES` nodes are known along a side.
    UsageError
        If the taper is not a share.

    Notes
    -----
    A sine keeps its mean square over the window and white noise its level (tested); the window spreads each
    over about the inverse of the width of the map.
    """
    dx, dy = spacings(spacing_mm)
    rows, columns = _box(np.isfinite(values))
    field = values[rows, columns]
    known, bridged = _bridged(np.isfinite(field))
    if bridged:
        field = np.where(known, continued(field), np.nan)
    window, taper_mm = distance_window(known, (dx, dy), taper)
    squares = window**2
    e = np.where(known, field, 0.0) - _plane(np.where(known, field, 0.0), window)
    total = float(squares.sum())
    density = dx * dy * np.abs(np.fft.fft2(window * e)) ** 2 / total
    ny, nx = field.shape
    frequency = np.hypot(np.fft.fftfreq(nx, dx), np.fft.fftfreq(ny, dy)[:, None])
    step = max(1.0 / (nx * dx), 1.0 / (ny * dy))
    order = np.floor(frequency.ravel()[1:] / step + 0.5)  # the first mode is the mean: nothing is left there
    ring = np.maximum(order.astype(np.intp), 1) - 1
    modes = np.bincount(ring)
    cell = 1.0 / (nx * dx * ny * dy)
    sigma = np.broadcast_to(np.asarray(sigma_mm, dtype=np.float64), values.shape)[rows, columns]
    return RadialPsd(
        frequency_per_mm=_floats(np.bincount(ring, frequency.ravel()[1:]) / modes),
        psd_mm4=_floats(np.bincount(ring, density.ravel()[1:]) / modes),
        area_per_mm2=_floats(modes * cell),
        edge_per_mm=_floats(np.concatenate([[0.0], step * (np.arange(len(modes)) + 1.5)])),
        freedom=_floats(modes**2 / _tied_pairs(ring, squares)),
        noise_floor_mm4=dx * dy * _mean_square(sigma, squares),
        variance_mm2=float((squares * e**2).sum()) / total,
        nyquist_per_mm=0.5 / max(dx, dy),
        taper_mm=taper_mm,
        bridged=bridged,
    )


def band_rms_mm(psd: RadialPsd, short_mm: float, long_mm: float) -> tuple[float, float]:
    """Return the RMS of the waves between two lengths, and what noise alone has there, mm.

    Parameters
    ----------
    psd : RadialPsd
    short_mm, long_mm : float
        Wavelengths; 0 and infinity for all. A ring that is cut counts with its share of the area.

    Returns
    -------
    rms_mm, noise_rms_mm : float
        The measured RMS, noise included, and that of the noise floor: bands that meet add up in squares to
        `variance_mm2`.

    Raises
    ------
    UsageError
        If the wavelengths are not in ascending order.
    """
    if not 0.0 <= short_mm < long_mm:
        raise UsageError(
            f"a band from {short_mm:.4g} to {long_mm:.4g} mm", expected="the shorter wavelength first"
        )
    highest = 1.0 / short_mm if short_mm > 0.0 else inf
    edges = np.clip(psd.edge_per_mm, 1.0 / long_mm, highest) ** 2
    share = np.diff(edges) / np.diff(np.square(psd.edge_per_mm))
    area = share * np.array(psd.area_per_mm2)
    return float(area @ np.array(psd.psd_mm4)) ** 0.5, float(area.sum() * psd.noise_floor_mm4) ** 0.5


def distance_window(known: Mask, spacing_mm: Spacing, taper: float) -> tuple[Array, float]:
    """Return the window of a mask, and the width of its rise.

    Parameters
    ----------
    known : ndarray of bool, shape (ny, nx)
    spacing_mm : float or pair of float
    taper : float
        Width of the rise over the largest distance from the border, above 0, at most 1.

    Returns
    -------
    window : ndarray, shape (ny, nx)
        0 where unknown, 1 further than the rise from any unknown node; past the grid nothing is known.
    taper_mm : float

    Raises
    ------
    UsageError
        If the taper is not a share.
    """
    from scipy.ndimage import distance_transform_edt

    if not 0.0 < taper <= 1.0:
        raise UsageError(f"a taper of {taper:g} of the map", expected="above 0, at most 1")
    dx, dy = spacings(spacing_mm)
    distance = np.asarray(distance_transform_edt(np.pad(known, 1), sampling=(dy, dx)))[1:-1, 1:-1]
    taper_mm = taper * float(distance.max())
    window = np.sin(0.5 * np.pi * np.minimum(distance / taper_mm, 1.0)) ** 2
    return np.asarray(window, dtype=np.float64), taper_mm


def _box(known: Mask) -> tuple[slice, slice]:
    """Return the rows and columns from the first known node to the last."""
    sides = [np.flatnonzero(known.any(axis=axis)) for axis in (1, 0)]
    if min(len(side) for side in sides) < MIN_NODES:
        raise GeometryError(
            f"a map with values in {len(sides[0])} x {len(sides[1])} rows and columns has no spectrum",
            expected=f"at least {MIN_NODES} each",
            remedy="measure more densely, or give a smaller spacing",
        )
    rows, columns = (slice(int(side[0]), int(side[-1]) + 1) for side in sides)
    return rows, columns


def _bridged(known: Mask) -> tuple[Mask, int]:
    """Return the mask without gaps up to two nodes wide, and how many nodes they had."""
    from scipy.ndimage import binary_closing

    square = np.ones((3, 3), dtype=np.bool_)
    closed = known | binary_closing(np.pad(known, 2), structure=square)[2:-2, 2:-2]
    return closed, int(np.count_nonzero(closed & ~known))


def _plane(field: Array, window: Array) -> Array:
    """Return the plane that leaves ``window * (field - plane)`` without mean and tilt."""
    ny, nx = field.shape
    x, y = np.arange(nx) - 0.5 * (nx - 1), np.arange(ny) - 0.5 * (ny - 1)

    def moments(values: Array) -> Array:
        """Return the sums of the values times 1, x and y."""
        columns, rows = values.sum(axis=0), values.sum(axis=1)
        return np.array([columns.sum(), columns @ x, rows @ y])

    along_x, along_y = window.sum(axis=0) * x, window.sum(axis=1) * y
    mixed = y @ window @ x
    normal = np.array(
        [
            [window.sum(), along_x.sum(), along_y.sum()],
            [along_x.sum(), along_x @ x, mixed],
            [along_y.sum(), mixed, along_y @ y],
        ]
    )
    c = np.linalg.lstsq(normal, moments(window * field), rcond=None)[0]
    return np.asarray(c[0] + c[1] * x + c[2] * y[:, None], dtype=np.float64)


def _tied_pairs(ring: NDArray[np.intp], squares: Array) -> Array:
    """Return the number of pairs of modes of each ring, weighted with their squared correlation.

    White noise a step (p, q) apart correlates by |S(p, q)| / S(0, 0), S the transform of the squared window.
    A step and its opposite tie the same pairs, so half of them are counted, twice.
    """
    far, (ny, nx) = TIED_STEPS, squares.shape
    steps = np.arange(-far, far + 1)
    along_y, along_x = (np.exp(-2j * np.pi * np.outer(steps, np.arange(n)) / n) for n in (ny, nx))
    shares = np.abs(along_y @ squares @ along_x.T / squares.sum()) ** 2
    labels = np.concatenate([[-1], ring]).astype(np.int32).reshape(ny, nx)
    around = np.pad(labels, far, mode="wrap")
    around[around < 0] = -2  # the first mode is tied to none
    pairs = np.bincount(ring).astype(np.float64)
    for q in range(far + 1):
        for p in range(-far, far + 1):
            if q > 0 or p > 0:
                shifted = around[far + q : far + q + ny, far + p : far + p + nx]
                tied = np.bincount(labels[labels == shifted], minlength=len(pairs))
                pairs += 2.0 * shares[far + q, far + p] * tied
    return pairs


def _mean_square(sigma: Array, weights: Array) -> float:
    """Return the weighted mean square of what is known; NaN if nothing is."""
    heard = np.isfinite(sigma) & (weights > 0.0)
    return float(np.average(sigma[heard] ** 2, weights=weights[heard])) if heard.any() else nan


def _floats(numbers: Array) -> tuple[float, ...]:
    return tuple(float(n) for n in numbers)
