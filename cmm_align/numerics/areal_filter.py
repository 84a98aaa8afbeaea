"""Areal Gaussian regression filters on masked grids and on scattered points, and bands made of them.

The filtered value at a place is the constant of the polynomial of order 0 or 2 that fits the data around it
with Gaussian weights; where data end, the fit is one-sided and nothing is padded, so a constant (order 0) or
a quadratic (order 2) passes unchanged up to the border. In the interior a wave of length L keeps the share

    order 0: H = exp(-u),  order 2: H = (1 + u) exp(-u),  u = (2 pi s / L)^2 / 2,

s the standard deviation of the weights. Half is kept at L = Lc, so u(Lc) = ln 2 and s = 0.1874 Lc for
order 0. The kernel of order 2, ``g(r) (2 - r^2 / (2 s^2))``, has no second moment; (1 + u) exp(-u) = 1/2
gives u(Lc) = -1 - W(-1/(2e)) = 1.6783 on the lower branch of Lambert's W, and s = 0.2916 Lc:
for the same cutoff its weights must be 1.556 times as wide.

Sources: ISO 16610-61 (areal Gaussian filter), ISO 16610-31 and -71 (Gaussian regression; robust by the
biweight with 4.4478 times the median of the residuals); J. Fan, I. Gijbels, "Local polynomial modelling and
its applications", 1996, section 3.2.2 (equivalent kernels).
"""

from __future__ import annotations

from collections.abc import Callable
from math import log, pi, sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cmm_align.errors import GeometryError, UsageError
from cmm_align.numerics.local_gaussian import Order, gridded_polynomials, scattered_polynomials
from cmm_align.numerics.point_density import filled_box

Array = NDArray[np.float64]
Spacing = float | tuple[float, float]
"""Grid step in mm: of both axes, or along x and along y."""
LowPass = Callable[[Array, Spacing, float], Array]
"""A filter of (values, spacing_mm, cutoff_mm) that keeps long waves."""

SPACINGS_PER_CUTOFF: Final = 4.0
"""Shortest cutoff in grid steps: sampled weights of order 0 keep 50.2 % there, and 51.3 % at 3.5 steps."""

MAX_OWN_WEIGHT: Final = 0.9
"""A value that takes more than this share from its own place was not filtered: it stays unknown.

In the corner of a square at the shortest cutoff the share is 0.87 for order 2.
"""

BIWEIGHT: Final = 4.4478
"""Residuals past this many times their median have no weight: three standard deviations of normal noise."""

_EXPONENT_AT_CUTOFF: Final = {0: log(2.0), 2: 1.6783469900166605}
_SIGMA_PER_CUTOFF: Final = {order: sqrt(0.5 * u) / pi for order, u in _EXPONENT_AT_CUTOFF.items()}

_ROUNDS: Final = 50
_SETTLED: Final = 1e-3
"""The robust filter stops when no value moves by more than this share of the last residual with a weight."""


def gaussian_transmission(wavelength_mm: Array, cutoff_mm: float, order: Order = 2) -> Array:
    """Return the share of the amplitude of a wave that a Gaussian regression filter keeps.

    Parameters
    ----------
    wavelength_mm : ndarray, any shape, mm
        Greater than 0.
    cutoff_mm : float
    order : 0 or 2

    Returns
    -------
    ndarray, same shape
        1/2 at the cutoff, towards 1 for longer waves. Away from the border.
    """
    u = _EXPONENT_AT_CUTOFF[order] * (cutoff_mm / np.asarray(wavelength_mm)) ** 2
    kept = np.exp(-u) if order == 0 else (1.0 + u) * np.exp(-u)
    return np.asarray(kept, dtype=np.float64)


def band_transmission(
    wavelength_mm: Array,
    short_mm: float | None,
    long_mm: float | None,
    *,
    transmission: Callable[[Array, float], Array] = gaussian_transmission,
) -> Array:
    """Return the share of the amplitude of a wave that `band_pass` keeps.

    Parameters
    ----------
    wavelength_mm : ndarray, any shape, mm
    short_mm, long_mm : float or None
        As for `band_pass`.
    transmission : callable
        That of the low-pass filter, of (wavelength_mm, cutoff_mm).

    Returns
    -------
    ndarray, same shape
    """
    wavelength = np.asarray(wavelength_mm, dtype=np.float64)
    upper = np.ones_like(wavelength) if short_mm is None else transmission(wavelength, short_mm)
    lower = np.zeros_like(wavelength) if long_mm is None else transmission(wavelength, long_mm)
    return upper - lower


def cutoff_limits_mm(values: Array, spacing_mm: Spacing) -> tuple[float, float]:
    """Return the shortest and the longest cutoff that a masked grid can carry, mm.

    Parameters
    ----------
    values : ndarray, shape (ny, nx)
        NaN where unknown.
    spacing_mm : float or pair of float
        Of both axes, or along x and along y.

    Returns
    -------
    shortest_mm, longest_mm : float
        Four grid steps, and the longer side of what is known.

    Raises
    ------
    GeometryError
        If nothing is known.
    """
    known = np.isfinite(values)
    if not known.any():
        raise GeometryError("a map without a single value cannot be filtered", remedy="check mask and region")
    dx, dy = spacings(spacing_mm)
    sides = [step * np.ptp(np.flatnonzero(known.any(axis=axis))) for axis, step in ((0, dx), (1, dy))]
    return SPACINGS_PER_CUTOFF * max(dx, dy), float(max(sides))


def spacings(spacing_mm: Spacing) -> tuple[float, float]:
    """Return the steps along x and along y, mm."""
    return spacing_mm if isinstance(spacing_mm, tuple) else (spacing_mm, spacing_mm)


def require_cutoff(cutoff_mm: float, limits_mm: tuple[float, float]) -> None:
    """Refuse a cutoff outside the limits.

    Raises
    ------
    UsageError
        If the cutoff is under the sampling limit, over the part, or no number.
    """
    low, high = limits_mm
    if not low <= cutoff_mm <= high:
        raise UsageError(
            f"a filter with a cutoff of {cutoff_mm:.4g} mm",
            expected=f"{low:.4g} mm (sampling: {SPACINGS_PER_CUTOFF:g} spacings) to {high:.4g} mm (the part)",
            remedy="choose a cutoff within the limits" if low <= high else "measure more densely",
        )


def gaussian_regression(
    values: Array, spacing_mm: Spacing, cutoff_mm: float, *, order: Order = 2, robust: bool = False
) -> Array:
    """Return the long waves of a masked grid by areal Gaussian regression.

    Parameters
    ----------
    values : ndarray, shape (ny, nx)
        Any unit; NaN where unknown.
    spacing_mm : float or pair of float
        Of both axes, or along x and along y.
    cutoff_mm : float
        Wavelength that keeps half its amplitude.
    order : 0 or 2
        Of the polynomial: 0 lets a constant pass unchanged, 2 a quadratic.
    robust : bool
        Give outliers no weight: spikes and pits then leave the result alone. It is no linear filter, so the
        transmission holds only where the residuals look like noise.

    Returns
    -------
    ndarray, shape (ny, nx)
        Unit of `values`; NaN where these are unknown or too few lie around (`MAX_OWN_WEIGHT`).

    Raises
    ------
    UsageError
        If the cutoff is outside `cutoff_limits_mm`.
    GeometryError
        If nothing is known.

    Notes
    -----
    50 +- 0.5 % at the cutoff; a constant (order 0) and a quadratic (order 2) of unit size reproduced to 1e-12
    at the border and beside holes (tested).
    """
    require_cutoff(cutoff_mm, cutoff_limits_mm(values, spacing_mm))
    known = np.isfinite(values)
    offset = float(values[known].mean())
    z = np.where(known, values - offset, 0.0)
    dx, dy = spacings(spacing_mm)
    sigma = _SIGMA_PER_CUTOFF[order] * cutoff_mm
    widths = (sigma / dx, sigma / dy)
    smooth, leverage = gridded_polynomials(known.astype(np.float64), z, widths, order)
    supported = known & (leverage <= MAX_OWN_WEIGHT)
    if robust and supported.any():
        smooth = _without_outliers(smooth, z, supported, known, widths, order)
    return np.where(supported, smooth + offset, np.nan)


def gaussian_regression_scattered(
    x_mm: Array,
    y_mm: Array,
    values: Array,
    at_x_mm: Array,
    at_y_mm: Array,
    cutoff_mm: float,
    *,
    order: Order = 2,
) -> Array:
    """Return the long waves of scattered values at given places by areal Gaussian regression.

    Parameters
    ----------
    x_mm, y_mm : ndarray, shape (N,), mm
        Places of the points.
    values : ndarray, shape (N,)
        Any unit, finite.
    at_x_mm, at_y_mm : ndarray, shape (M,), mm
        Where the result is wanted.
    cutoff_mm : float
        Wavelength that keeps half its amplitude.
    order : 0 or 2

    Returns
    -------
    ndarray, shape (M,)
        Unit of `values`; NaN where no point lies within a quarter of the cutoff, or too few do around.

    Raises
    ------
    GeometryError
        If the points span no area.
    UsageError
        If the cutoff is under four times the spacing (`filled_box`), or over the longer side of the cloud.

    Notes
    -----
    Every point within five standard deviations of the weights counts: the time grows with the number of
    places, the density of the points and the square of the cutoff.
    """
    sides = sorted((float(np.ptp(x_mm)), float(np.ptp(y_mm)))) if len(x_mm) else [0.0, 0.0]
    if sides[0] <= 1e-9 * sides[1] or sides[1] == 0.0:
        raise GeometryError(f"the {len(x_mm)} points span no area", expected="points spread over an area")
    box = filled_box(x_mm, y_mm, sides[1] / 4096.0, 0.5 * sides[0])
    require_cutoff(cutoff_mm, (SPACINGS_PER_CUTOFF * box, sides[1]))
    sigma = _SIGMA_PER_CUTOFF[order] * cutoff_mm
    offset = float(values.mean())
    places = np.column_stack([x_mm, y_mm]) / sigma
    at = np.column_stack([at_x_mm, at_y_mm]) / sigma
    smooth, leverage, nearest = scattered_polynomials(places, values - offset, at, order)
    near = nearest * sigma <= cutoff_mm / SPACINGS_PER_CUTOFF
    return np.where(near & (leverage <= MAX_OWN_WEIGHT), smooth + offset, np.nan)


def band_pass(
    values: Array,
    spacing_mm: Spacing,
    short_mm: float | None,
    long_mm: float | None,
    *,
    low_pass: LowPass = gaussian_regression,
) -> Array:
    """Return the waves of a masked grid between two cutoffs: a low, high or band pass.

    Parameters
    ----------
    values : ndarray, shape (ny, nx)
        NaN where unknown.
    spacing_mm : float or pair of float
    short_mm : float or None
        Take shorter waves away; None keeps them (a high pass).
    long_mm : float or None
        Take longer waves away; None keeps them (a low pass).
    low_pass : callable
        `gaussian_regression`, `spline_filter`, or one of them with its settings bound.

    Returns
    -------
    ndarray, shape (ny, nx)
        Unit of `values`. Bands that meet at their cutoffs add up to the values.

    Raises
    ------
    UsageError
        If the cutoffs are not in ascending order, or one is outside its limits.
    """
    if short_mm is not None and long_mm is not None and not short_mm < long_mm:
        raise UsageError(
            f"a band from {short_mm:.4g} to {long_mm:.4g} mm", expected="the shorter wavelength first"
        )
    upper = values if short_mm is None else low_pass(values, spacing_mm, short_mm)
    lower = 0.0 if long_mm is None else low_pass(values, spacing_mm, long_mm)
    return np.asarray(upper - lower, dtype=np.float64)


def _without_outliers(
    smooth: Array,
    z: Array,
    supported: NDArray[np.bool_],
    known: NDArray[np.bool_],
    widths: tuple[float, float],
    order: Order,
) -> Array:
    """Return the regression with biweights of its own residuals (ISO 16610-71), until it settles."""
    floor = float(np.finfo(np.float64).eps * np.abs(z).max())
    for _ in range(_ROUNDS):
        residual = np.where(supported, np.abs(z - smooth), 0.0)
        limit = BIWEIGHT * float(np.median(residual[supported]))
        if limit <= BIWEIGHT * floor:  # most values lie on a polynomial exactly
            break
        weights = np.where(known, np.maximum(1.0 - (residual / limit) ** 2, 0.0) ** 2, 0.0)
        again, _ = gridded_polynomials(weights, z, widths, order)
        again = np.where(np.isfinite(again), again, smooth)
        moved = float(np.abs(again - smooth)[supported].max())
        smooth = again
        if moved <= _SETTLED * limit:
            break
    return smooth
