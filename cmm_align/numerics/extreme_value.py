"""What noise adds to the largest of many values.

A largest value picks out noise that happens to point its way: the largest of n values f_i with independent
normal noise s_i has, exactly, the distribution

    P(largest <= t) = prod_i Phi((t - f_i) / s_i).                                                    (1)

Its mean less the largest f_i is what noise adds; its standard deviation is what a repetition changes. With
limits on both sides the largest excess ``max_i max(f_i - u_i, l_i - f_i)`` has

    P(excess <= t) = prod_i [Phi((u_i + t - f_i) / s_i) - Phi((l_i - t - f_i) / s_i)].                (2)

Neighbouring nodes of a map share points. Where k of them stand for one independent value, the product is
raised to 1 / k: the count matters little to a largest value (it goes with the root of its logarithm).

Source: order statistics of independent, not identical variables, as in H. A. David, H. N. Nagaraja, "Order
Statistics", 3rd ed. 2003, section 5.2.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_REACH: Final = 6.0
"""Standard deviations beyond which a value has no say: 1e-9."""
_SINGLY: Final = 512
"""Values nearest to the limits, taken one by one."""
_GROUPS: Final = 512
"""Groups of the others, each of neighbours in rank."""
_STEPS: Final = 200
"""Places at which the distribution is taken."""


class Extreme(NamedTuple):
    """The largest of many noisy values, in their unit."""

    bare: float
    """Without noise."""
    mean: float
    sd: float

    @property
    def added(self) -> float:
        """What noise adds on average."""
        return self.mean - self.bare


def largest_excess(
    field: Array,
    sigma: Array | float,
    lower: Array | float = -np.inf,
    upper: Array | float = 0.0,
    *,
    alike: float = 1.0,
) -> Extreme:
    """Return mean and standard deviation of the largest excess over limits that noise makes of a field.

    Parameters
    ----------
    field : ndarray, shape (n,)
        Values without noise, any unit; n >= 1.
    sigma : ndarray, shape (n,), or float
        Standard deviation of the noise of each, same unit, not negative.
    lower, upper : ndarray, shape (n,), or float
        Limits; infinite where there is none. The defaults give the largest value itself.
    alike : float
        How many neighbours stand for one independent value.

    Returns
    -------
    Extreme
        By quadrature of (2); no random numbers. Values that neither they nor their noise can make the largest
        are left out, the others grouped by rank (tested to 1 % of sigma against simulation).
    """
    from scipy.special import log_ndtr, ndtr  # slow to import

    bare = np.maximum(field - upper, lower - field)
    top = float(bare.max())
    s = np.broadcast_to(np.asarray(sigma, dtype=np.float64), bare.shape)
    reach = bare + _REACH * s
    candidates = np.flatnonzero(reach >= top)
    widest = float(s[candidates].max())
    if widest == 0.0:
        return Extreme(top, top, 0.0)
    pick, weight = _ranked(reach, candidates)
    f = field[pick]
    sharp = np.maximum(s[pick], 1e-9 * widest)
    low, high = (np.broadcast_to(np.asarray(v, dtype=np.float64), bare.shape)[pick] for v in (lower, upper))
    t = np.linspace(top - _REACH * widest, float(reach.max()), _STEPS)[:, None]
    above: Array = (high + t - f) / sharp
    below: Array = (low - t - f) / sharp
    one_sided = bool(np.isneginf(low).all())
    between = np.asarray(ndtr(above)) - np.asarray(ndtr(below))
    log_cdf: Array = np.asarray(log_ndtr(above)) if one_sided else np.log(np.clip(between, 1e-300, 1.0))
    cdf: Array = np.exp((log_cdf @ weight) / alike)
    mass = np.diff(np.concatenate([[0.0], cdf, [1.0]]))
    ends = t[:, 0]
    places = np.concatenate([ends[:1], 0.5 * (ends[1:] + ends[:-1]), ends[-1:]])
    mean = float(mass @ places)
    variance = float(mass @ (places - mean) ** 2)
    return Extreme(top, mean, max(variance, 0.0) ** 0.5)


def _ranked(reach: Array, candidates: NDArray[np.intp]) -> tuple[NDArray[np.intp], Array]:
    """Return the foremost candidates one by one, the others one for each group, and how many each is."""
    if len(candidates) <= _SINGLY + _GROUPS:
        return candidates, np.ones(len(candidates))
    order = candidates[np.argsort(-reach[candidates], kind="stable")]
    edges = np.unique(np.linspace(_SINGLY, len(order), _GROUPS + 1).astype(np.intp))
    middle = (edges[:-1] + edges[1:]) // 2
    pick = np.concatenate([order[:_SINGLY], order[middle]])
    return pick, np.concatenate([np.ones(_SINGLY), np.diff(edges).astype(np.float64)])
