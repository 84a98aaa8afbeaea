"""Errors of a measuring machine that just meet its statement of length error, place and normal in hand.

A statement MPE(L) = a + b L limits the error of a length (ISO 10360-2); it is no sigma of a point. A length L
along the unit vector u lies between touches with outward normals -u and u. With e the error of a touch along
its own normal, the error of the length is ``e1 + e2``. It shall have the standard deviation MPE(L) / k (k = 2
where 95 % of the lengths keep the limit), for every L, place and direction:

    (a^2 + 2 a b L + b^2 L^2) / k^2 = var(e1 + e2).                                                  (1)

Each term on the left is one physical part on the right, independent of the others, for a touch at p
(about a fixed origin) with normal n:

- *White*, variance w per touch: gives 2 w.
- *Lobing*, a function of the normal alone: spherical harmonics of degrees 0 (tip radius), 2 and 3 (two and
  three lobes) with the same variance s each. By the addition theorem its covariance is ``s (1 + P2(c) +
  P3(c))``, c = n.n'. Even degrees add up in a length from opposite touches, odd ones cancel: it gives 8 s.
  Degree 1 is a shift of the stylus, which no length and no fit sees.
- *Drift with place*, n.B(p): three independent components, each Brownian in space (Levy's field, zero at the
  origin): ``cov(B(p), B(q)) = g/2 (|p| + |q| - |p-q|)``. Its increments have the variance g L everywhere;
  components being alike and independent, so has their projection on any u: it gives g L. A linear
  variogram is admissible in space (Matheron 1973, doi 10.2307/1425829).
- *Scale and squareness*, n.(S p): a random symmetric matrix, variance 2 t on and t off the diagonal, which
  looks the same from all sides: ``u.(S u)`` has variance 2 t for every u, and this gives 2 t L^2. The
  covariance is ``t [(n.n')(p.q) + (n.q)(n'.p)]``.

So w = (1 - f) a^2 / 2k^2, s = f a^2 / 8k^2, g = 2 a b / k^2, t = b^2 / 2k^2, where f is the share of
lobing in the constant part, which a statement of lengths leaves open. (1) then holds exactly. Of where a
single point is, such a statement says nothing: drift and scale are errors relative to the origin, and another
origin shifts all points alike. Gaussian processes for place and probe compared with an MPE: Forbes 2025,
doi 10.3390/app15010271.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmm_align.errors import UsageError
from cmm_align.numerics.linearisation import even_sample

Array = NDArray[np.float64]

COVERAGE_FACTOR: Final = 2.0
"""Standard deviations from zero to the limit: 95 % of the lengths keep it."""
PROBE_SHARE: Final = 0.5
"""Share of lobing in the variance of the constant part."""
MOST_FACTORS: Final = 300
"""Independent random numbers for what touches have in common."""
REMAINDER: Final = 0.01
"""What they leave out of a touch's variance, as a share of that of the shortest length."""
CANDIDATES: Final = 4096
"""Touches among which the factors are chosen."""
_AT_ONCE: Final = 256
"""Touches at once: temporaries stay in cache."""
_ROUNDING: Final = 1e-12


class MachineError(NamedTuple):
    """Variances of the four parts."""

    white_mm2: float
    """w, of each touch."""
    lobe_mm2: float
    """s, of each of the degrees 0, 2 and 3."""
    drift_mm2_per_mm: float
    """g, of the difference of two places, per distance."""
    strain: float
    """t, of an off-diagonal element of the scale matrix."""


def machine_error(
    constant_mm: float,
    slope: float,
    *,
    probe_share: float = PROBE_SHARE,
    coverage_factor: float = COVERAGE_FACTOR,
) -> MachineError:
    """Return the errors whose lengths just meet ``MPE(L) = constant + slope L``.

    Parameters
    ----------
    constant_mm : float
        a, mm.
    slope : float
        b, mm of error per mm of length.
    probe_share : float
        f, 0 to 1: lobing in the variance of the constant part; the rest is white.
    coverage_factor : float
        k: the limit in standard deviations.

    Raises
    ------
    UsageError
        If a number is out of its range.
    """
    if not (constant_mm >= 0.0 and slope >= 0.0 and np.isfinite(constant_mm + slope)):
        raise UsageError(
            f"an MPE of {constant_mm:g} mm + {slope:g} L", expected="numbers that are not negative"
        )
    if not (0.0 <= probe_share <= 1.0 and 0.0 < coverage_factor < np.inf):
        raise UsageError(
            f"probe share {probe_share:g}, coverage factor {coverage_factor:g}",
            expected="a share from 0 to 1 and a positive factor",
        )
    a2, k2 = constant_mm**2, coverage_factor**2
    return MachineError(
        white_mm2=(1.0 - probe_share) * a2 / (2.0 * k2),
        lobe_mm2=probe_share * a2 / (8.0 * k2),
        drift_mm2_per_mm=2.0 * constant_mm * slope / k2,
        strain=slope**2 / (2.0 * k2),
    )


def common_covariance(
    error: MachineError, points_mm: Array, normals: Array, other_points_mm: Array, other_normals: Array
) -> Array:
    """Return the covariance of what touches have in common: all but the white part.

    Parameters
    ----------
    error : MachineError
    points_mm, normals : ndarray, shape (n, 3), mm
        Places about the origin of the machine's errors, and unit normals, in any one frame.
    other_points_mm, other_normals : ndarray, shape (m, 3), mm
        The same of other touches.

    Returns
    -------
    ndarray, shape (n, m), mm^2
    """
    cosine = normals @ other_normals.T
    inner = points_mm @ other_points_mm.T
    size2 = np.einsum("ij,ij->i", points_mm, points_mm)[:, None]
    other2 = np.einsum("ij,ij->i", other_points_mm, other_points_mm)
    covariance: Array = np.sqrt(np.maximum(size2 + other2 - 2.0 * inner, 0.0))
    np.subtract(np.sqrt(size2) + np.sqrt(other2), covariance, out=covariance)
    covariance *= 0.5 * error.drift_mm2_per_mm
    covariance += error.strain * inner
    covariance *= cosine
    covariance += error.strain * (normals @ other_points_mm.T) * (points_mm @ other_normals.T)
    # 1 + P2 + P3, with P2 = (3 c^2 - 1) / 2 and P3 = (5 c^3 - 3 c) / 2
    covariance += error.lobe_mm2 * (0.5 + cosine * (-1.5 + cosine * (1.5 + 2.5 * cosine)))
    return covariance


def error_factors(
    error: MachineError, points_mm: Array, normals: Array, *, most: int = MOST_FACTORS
) -> tuple[Array, Array]:
    """Return what turns independent standard normal numbers into errors of the touches.

    Errors are ``z @ factors + y * sigma``, with a number z for each factor and a number y for each touch.

    Parameters
    ----------
    error : MachineError
    points_mm, normals : ndarray, shape (n, 3), mm
        As for `common_covariance`.
    most : int
        At most so many factors.

    Returns
    -------
    factors : ndarray, shape (r, n), mm
    sigma_mm : ndarray, shape (n,), mm
        Standard deviation of the independent part: white, and what the factors leave out.

    Notes
    -----
    Pivoted partial Cholesky decomposition (Harbrecht, Peters, Schneider 2012,
    doi 10.1016/j.apnum.2011.10.001): of an even sample, the touch that is known least becomes the next
    factor, until every remainder is below `REMAINDER`. The variance of each touch is exact; the covariance of
    two is wrong by ``sqrt(r_i r_j)`` at most, r being the remainders, for these form a covariance themselves.
    """
    from scipy.linalg import solve_triangular  # slow to import

    sample = even_sample(len(points_mm), CANDIDATES)
    chosen, triangle = _pivots(error, points_mm[sample], normals[sample], most)
    points, there = points_mm[sample][chosen], normals[sample][chosen]
    factors = np.empty((len(chosen), len(points_mm)))
    for first in range(0, len(points_mm), _AT_ONCE):
        part = slice(first, first + _AT_ONCE)
        shared = common_covariance(error, points, there, points_mm[part], normals[part])
        factors[:, part] = solve_triangular(triangle, shared, trans="T")
    left = _variance(error, points_mm, normals) - np.einsum("ij,ij->j", factors, factors)
    return factors, np.sqrt(np.maximum(left, 0.0) + error.white_mm2)


def _variance(error: MachineError, points_mm: Array, normals: Array) -> Array:
    """Return the diagonal of the common covariance, shape (n,), mm^2."""
    along = np.einsum("ij,ij->i", points_mm, normals)
    size2 = np.einsum("ij,ij->i", points_mm, points_mm)
    place = error.drift_mm2_per_mm * np.sqrt(size2) + error.strain * (size2 + along**2)
    return np.asarray(3.0 * error.lobe_mm2 + place, dtype=np.float64)


def _pivots(
    error: MachineError, points_mm: Array, normals: Array, most: int
) -> tuple[NDArray[np.intp], Array]:
    """Return the touches that say most of all others, and the Cholesky triangle of their covariance."""
    left = _variance(error, points_mm, normals)
    shortest = 8.0 * error.lobe_mm2 + 2.0 * error.white_mm2
    enough = max(REMAINDER * shortest, _ROUNDING * float(left.max(initial=0.0)))
    factors = np.empty((min(most, len(left)), len(left)))
    chosen: list[int] = []
    for k in range(len(factors)):
        pivot = int(np.argmax(left))
        if left[pivot] <= enough:
            break
        row = common_covariance(error, points_mm[[pivot]], normals[[pivot]], points_mm, normals)[0]
        row -= factors[:k, pivot] @ factors[:k]
        row /= np.sqrt(left[pivot])
        factors[k] = row
        left = np.maximum(left - row**2, 0.0)
        left[[*chosen, pivot]] = 0.0
        chosen.append(pivot)
    index = np.array(chosen, dtype=np.intp)
    return index, np.triu(factors[: len(index)][:, index])
