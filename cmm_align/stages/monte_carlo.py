"""Monte Carlo of a measurement: how far pose and deviations would change if the machine measured again.

1. Take a sample of the points that steered the fit or count in the numbers, the highest and lowest of
   these among them.
2. Draw errors of the machine that just meet its MPE statement (`numerics.machine_error`), correlated over
   place and normal.
3. Fit each simulated measurement anew, by one step of the fit's own Newton method from the pose found:
   errors e along the normals move it by ``-(J^T W J + C)^-1 J^T W e`` in the observable motions, J being the
   change of the deviations with the pose, W the weights (zero for points that do not steer) and C the sum of
   weight times deviation times second derivative. That is exact in the first order of e (tested against full
   fits: 0.003 of an uncertainty); errors along the surface change no deviation in that order.
4. Collect the spread of each motion, PV, RMS and each deviation (JCGM 101:2008).

The measured deviations hold one set of the machine's errors already; a simulated measurement has one more.
By about as much as its PV is larger on average, the measured PV is larger than the part's.
"""

from __future__ import annotations

from functools import partial
from typing import Final, NamedTuple

import numpy as np
from numpy.random import default_rng
from numpy.typing import NDArray

from cmm_align.errors import GeometryError, UsageError
from cmm_align.model import MIN_POINTS, Alignment, frozen_array
from cmm_align.model.monte_carlo import MonteCarlo, PointSpread, Spread
from cmm_align.numerics.foot_point import Feet, distance_hessian
from cmm_align.numerics.linearisation import Evaluation, Placement, curvature_term, even_sample, rows_of
from cmm_align.numerics.machine_error import COVERAGE_FACTOR, PROBE_SHARE, error_factors, machine_error
from cmm_align.numerics.observability import Spectrum, solve_observable, spectrum, uncertain_axes
from cmm_align.stages.pose_uncertainty import pose_sigma, turned
from cmm_align.surfaces.protocol import Array
from cmm_align.units import UM_PER_MM, URAD_PER_RAD, parse_mpe

SAMPLE: Final = 20_000
"""Points in a simulated measurement."""
FEWEST: Final = 40
"""Simulations that put one beyond each end of a 95 % interval."""
AT_ONCE: Final = 32
"""Simulations in memory at once. Fixed, so that sums are reproducible."""
_TAILS: Final = (0.025, 0.975)
_ROUNDING: Final = 1e-14


class LinearRefit(NamedTuple):
    """One step of the fit, linear in the errors; all in frame `surface` but the last two."""

    push: Array
    """Shape (6, n): errors to the gradient, scaled."""
    response: Array
    """Shape (6, 6): gradient to motion, scaled."""
    rows: Array
    """Shape (6, n): motion to change of the deviations."""
    to_part: Array
    """Shape (6, 6): scaled motion to rad and mm, frame `part`."""
    spectral: Spectrum
    """Frame `part`."""


def monte_carlo(
    alignment: Alignment,
    mpe: str,
    n: int,
    seed: int = 1,
    *,
    motions: Array | None = None,
    weights: Array | None = None,
    probe_share: float = PROBE_SHARE,
    coverage_factor: float = COVERAGE_FACTOR,
    sample: int = SAMPLE,
) -> tuple[MonteCarlo, PointSpread]:
    """Measure an aligned part again n times, with errors that just meet the machine's MPE statement.

    Parameters
    ----------
    alignment : Alignment
        By least squares.
    mpe : str
        Maximum permissible error of length, um, such as ``0.7+L/400`` with L in mm.
    n : int
        Simulated measurements, `FEWEST` or more.
    seed : int
        The same seed gives the same bits.
    motions : ndarray, shape (6, k), rad and mm, frame `part`, optional
        One column (rx, ry, rz, tx, ty, tz) about the centroid for each motion that is not locked; without
        it, all. Those that the alignment could not observe are found among them.
    weights : ndarray, shape (N,), optional
        What the squares of the deviations were multiplied by in the fit; without it, all alike.
    probe_share, coverage_factor
        As for `machine_error`.
    sample : int
        At most so many points (and the two extreme ones) are simulated.

    Returns
    -------
    MonteCarlo
        Uncertainties of pose, PV and RMS.
    PointSpread
        Standard deviation of each simulated point's deviation.

    Raises
    ------
    UsageError
        If n is too small, the seed negative, or the pose is not one of least squares.
    UnitsError
        If the statement cannot be read.
    GeometryError
        If fewer than six points steered the fit.

    Notes
    -----
    Sign: an error is positive along the outward normal; the fit follows, so one that all touches share moves
    the part against its normal. A statement of lengths says nothing of where a single point is: translations
    are relative to what the machine reads at the centroid. Of more than `sample` points the pose is as
    uncertain as that of the sample: the white part, which more points would average, is small there. PV is
    that of `n_points` deviations. Datum terms beside the points and a free scale are not in it.
    """
    if n < FEWEST or seed < 0:
        raise UsageError(f"{n} simulations, seed {seed}", expected=f"{FEWEST} or more, and a seed from 0")
    if alignment.report.criterion != "least-squares":
        raise UsageError(
            f"the pose was found by {alignment.report.criterion}",
            expected="a least-squares alignment",
            remedy="align with --criterion least-squares",
        )
    constant_um, divisor = parse_mpe(mpe)
    error = machine_error(
        constant_um / UM_PER_MM,
        1.0 / (UM_PER_MM * divisor),
        probe_share=probe_share,
        coverage_factor=coverage_factor,
    )
    index = _sampled(alignment, sample)
    deviation, normals = alignment.deviation_mm[index], alignment.normals[index]
    arm = alignment.tip_centre_part_mm[index] - alignment.centroid_mm
    weight = np.where(alignment.used[index], 1.0 if weights is None else weights[index], 0.0)
    refit = linear_refit(alignment, index, weight, motions)
    factors, sigma = error_factors(error, arm, normals)
    counts = np.flatnonzero(alignment.judged[index])

    random = default_rng(seed)
    motion, pv, rms = np.empty((n, 6)), np.empty(n), np.empty(n)
    squares = np.zeros(len(index))
    for first in range(0, n, AT_ONCE):
        now = slice(first, min(first + AT_ONCE, n))
        shared = random.standard_normal((now.stop - first, len(factors)))
        errors = random.standard_normal((now.stop - first, len(index)))
        errors *= sigma
        errors += shared @ factors
        step = errors @ refit.push.T @ refit.response.T
        motion[now] = step @ refit.to_part.T
        errors += step @ refit.rows
        squares += np.einsum("ij,ij->j", errors, errors)
        errors += deviation
        judged = errors if len(counts) == len(index) else errors[:, counts]
        pv[now] = np.ptp(judged, axis=1)
        rms[now] = _rms(judged)
    covariance = motion.T @ motion / n  # the errors have no mean
    found = MonteCarlo(
        mpe=mpe,
        coverage_factor=coverage_factor,
        probe_share=probe_share,
        n=n,
        seed=seed,
        n_points=len(counts),
        pose_sigma=pose_sigma(covariance, refit.spectral),
        pose_interval=_intervals(motion, refit.spectral),
        covariance=tuple(tuple(float(c) for c in row) for row in covariance),
        pv=_spread(float(np.ptp(deviation[counts])), pv),
        rms=_spread(float(_rms(deviation[counts])), rms),
    )
    return found, PointSpread(frozen_array(index, np.int64), frozen_array(np.sqrt(squares / n)))


def _sampled(alignment: Alignment, most: int) -> NDArray[np.intp]:
    """Return an even sample of the points that steer or count, the two extremes of the latter among them."""
    known = np.isfinite(alignment.deviation_mm)
    steers, counts = alignment.used & known, np.flatnonzero(alignment.judged & known)
    if np.count_nonzero(steers) < MIN_POINTS or len(counts) == 0:
        raise GeometryError(
            f"{np.count_nonzero(steers)} points steered the fit, {len(counts)} count in the numbers",
            expected=f"{MIN_POINTS} or more",
            remedy="look at the alignment with cmm-align info",
        )
    deviation = alignment.deviation_mm[counts]
    extreme = counts[[int(np.argmin(deviation)), int(np.argmax(deviation))]]
    either = np.flatnonzero((alignment.used | alignment.judged) & known)
    return np.union1d(either[even_sample(len(either), most)], extreme)


def linear_refit(
    alignment: Alignment, index: NDArray[np.intp], weight: Array, motions: Array | None = None
) -> LinearRefit:
    """Linearise the fit of some of the points at the pose found.

    Parameters
    ----------
    alignment : Alignment
    index : ndarray of int, shape (n,)
        The points.
    weight : ndarray, shape (n,)
        Of each in the fit; zero for those that do not steer it.
    motions : ndarray, shape (6, k), rad and mm, frame `part`, optional
        As for `monte_carlo`. As many of them as the alignment could not observe, the weakest, are held.
    """
    nominal = alignment.nominal
    surface_from_part, part_from_surface = nominal.surface_from_part, nominal.surface_from_part.inverse()
    deviation, normals = alignment.deviation_mm[index], surface_from_part.rotate(alignment.normals[index])
    foot = surface_from_part.apply(alignment.contact_part_mm[index]) - deviation[:, None] * normals
    feet = Feet(foot[:, 0], foot[:, 1], deviation, normals)
    tips = surface_from_part.apply(alignment.tip_centre_part_mm[index])
    centre = surface_from_part.apply(alignment.centroid_mm[None])[0]
    length = float(np.sqrt(np.mean(np.sum((tips - centre) ** 2, axis=1))))
    placement = Placement(np.eye(3), centre)
    rows = rows_of(tips, placement, feet, length)[:6]
    push = rows * (weight / weight.sum())
    normal_matrix = push @ rows.T
    scale = np.array([length] * 3 + [1.0] * 3)
    allowed = np.eye(6)
    if motions is not None:
        turn = np.kron(np.eye(2), surface_from_part.rotation)
        allowed = np.linalg.qr((turn @ motions) * scale[:, None])[0]
    spectral = spectrum(normal_matrix, _ROUNDING, allowed)
    named = np.arange(len(spectral.free)) < len(alignment.report.unobservable)
    spectral = spectral._replace(free=spectral.free | named)
    bend = None
    if alignment.report.distance == "smooth":  # facets are plane
        steers = weight > 0.0
        look = Evaluation(feet, steers, steers, normal_matrix, push @ deviation, 0.0)
        hessian = partial(distance_hessian, nominal.surface.jet, nominal.side)
        bend = curvature_term(hessian, tips - centre, placement, look, length, weight)
    response = np.stack([solve_observable(spectral, pull, bend) for pull in np.eye(6)], axis=1)
    to_part = np.kron(np.eye(2), part_from_surface.rotation) / scale
    return LinearRefit(push, response, rows, to_part, turned(spectral, part_from_surface))


def _rms(deviations_mm: Array) -> Array:
    """Return the root of the mean square along the last axis."""
    squares = np.einsum("...j,...j->...", deviations_mm, deviations_mm)
    return np.asarray(np.sqrt(squares / deviations_mm.shape[-1]), dtype=np.float64)


def _intervals(motion: Array, spectral: Spectrum) -> dict[str, tuple[float, float]]:
    """Return where the middle 95 % of each motion lie, in the units of `pose_sigma`."""
    low, high = np.quantile(motion, _TAILS, axis=0)
    free = uncertain_axes(spectral)
    low, high = np.where(free, -np.inf, low), np.where(free, np.inf, high)
    names = ("rx_urad", "ry_urad", "rz_urad", "tx_um", "ty_um", "tz_um")
    units = (URAD_PER_RAD,) * 3 + (UM_PER_MM,) * 3
    return {k: (float(a * u), float(b * u)) for k, a, b, u in zip(names, low, high, units, strict=True)}


def _spread(measured_mm: float, simulated_mm: Array) -> Spread:
    """Return the numbers of one simulated quantity."""
    low, high = np.quantile(simulated_mm, _TAILS)
    in_mm = (measured_mm, np.mean(simulated_mm), np.std(simulated_mm, ddof=1), low, high)
    return Spread(*(float(value) * UM_PER_MM for value in in_mm))
