"""Whether noise explains a difference of two maps: along its ladder, and band by band.

Three bands, told apart by shapes that are orthonormal on the known nodes, so that borders and holes disturb
none of them: the low orders of the ladder; the *middle*, products of Legendre's polynomials up to the degree
whose waves are still eight grid steps long (12 at most); the *fine* rest. Coefficients are tested over their
uncertainties (eq. (1) of `low_orders`, which holds for waves much longer than a window):
``mean (c_k/u_k)^2`` is distributed as F(m, nu_0) if nothing changed. What is finer has the mean square of the
noise at the nodes, V, over its power P by frequency (`node_noise`, mean 1), the longest waves left out, as
many as shapes were taken away:

    E = V mean(P),    nu = n mean(P)^2 / mean(P^2),    rms^2 / E ~ F(nu, nu_0).                           (1)

nu_0 is the freedom of V itself; as P is that of evenly spread points, it is never taken for more than that of
a noise known to 5 % (GUM G.4.2: ``nu = 1/2 (u/s)^-2``). What the rigid motion takes is tested against the
variance of six such shapes and that of both poses.

A rung of the ladder is *noise* if none of what lies beyond it stands out at 1 %, the number of tests counted
in (Bonferroni): a small change in few shapes is not drowned by the noise of all nodes.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.polynomial import legendre

from cmm_align.model import ChangeBand, ChangeRung
from cmm_align.model.low_orders import LowOrders
from cmm_align.numerics.aperture_basis import LEAST_NEW, orthonormalised
from cmm_align.numerics.node_noise import effective_number, noise_power, without_longest
from cmm_align.stages.common_grid import Pair
from cmm_align.stages.low_orders import LadderBase, low_orders
from cmm_align.surfaces.protocol import Array
from cmm_align.units import UM_PER_MM

LEVEL: Final = 0.01
"""Chance of calling noise a change, for each test of the whole."""
NOISE_KNOWN: Final = 0.05
"""Relative standard uncertainty of the noise's own size, at best."""
MEDIAN_SHARE: Final = 0.64
"""The scatter of a map is a median over its windows: worth 2/pi of a mean."""
FINE_STEPS: Final = 8.0
"""Waves shorter than so many grid steps are fine."""
LOW_DEGREE: Final = 7
"""Of the low orders: they follow waves of 2/7 of the extent."""
MOST_DEGREE: Final = 12
"""Of the middle band."""
LEAST_FREEDOM: Final = 10.0
"""Fewest independent values in the fine band."""
ROUNDING_UM: Final = 1e-6
"""Least uncertainty of a coefficient, and least noise: what writing and reading coordinates leaves."""
LOW: Final = "low orders"
_RIGID: Final = 6
_ROUNDING_MM2: Final = (ROUNDING_UM / UM_PER_MM) ** 2
_TAKEN: Final = (
    frozenset[str](),
    frozenset[str](),
    frozenset({"power"}),
    frozenset({"power", "astigmatism"}),
    frozenset({"power", "astigmatism", "coma", "trefoil"}),
)
"""Kinds that each rung before the last has taken away."""


class Tests(NamedTuple):
    """The low orders of a difference, and what noise does to them and to the rest."""

    orders: LowOrders
    kinds: tuple[str, ...]
    """First word of each term's name."""
    value_um: Array
    u_um: Array
    rest_mm2: float
    """Mean square that noise leaves beyond the last rung."""
    shape_mm2: float
    """Mean variance of a coefficient."""
    freedom: float
    """Of the noise's own size."""


def change_bands(pair: Pair, base: LadderBase, window: float) -> tuple[tuple[ChangeBand, ...], Tests]:
    """Return the bands of a difference, from the longest waves to the finest, and its low orders.

    Parameters
    ----------
    pair : Pair
    base : LadderBase
        The shapes of the ladder on the common nodes, with the difference.
    window : float
        Half width of the window of the local regression, in grid steps.
    """
    known, difference = pair.known, pair.late.deviation_mm - pair.early.deviation_mm
    handed = pair.late.handed_mm2 + pair.early.handed_mm2
    n = int(np.count_nonzero(known))
    w, e = base.nodes.weight, base.nodes.deviation_mm
    noise = float(np.mean(w * (pair.late.noise_mm**2 + pair.early.noise_mm**2)[known]))
    power = noise_power(known.shape, half_width=window)
    finer = without_longest(power, np.count_nonzero(base.fresh) * known.size / n)
    orders = low_orders(pair.late.alignment, pair.x_mm, pair.y_mm, difference, handed, pair.weights)
    tests = Tests(
        orders,
        tuple(term.name.split()[0] for term in orders.terms),
        np.array([term.coefficient_um for term in orders.terms]),
        _term_uncertainties(pair, orders),
        noise * float(np.mean(finer)),
        float(np.mean(w**2 * handed[known])) / n,
        min(MEDIAN_SHARE * (pair.late.spare + pair.early.spare), 0.5 / NOISE_KNOWN**2),
    )
    extent = max(float(np.ptp(pair.x_mm)), float(np.ptp(pair.y_mm)))
    finest = 2.0 * min(float(a[1] - a[0]) for a in (pair.x_mm, pair.y_mm))
    reach = 2.0 * extent / LOW_DEGREE
    bands = []
    if tests.kinds:
        bands.append(_of_shapes(LOW, (reach, np.inf), tests.value_um, tests.u_um, tests.freedom))
    rest = e - base.q @ (base.q.T @ (w * e) / n)
    degree = _middle_degree(pair)
    if degree > LOW_DEGREE and len(orders.rungs) == len(_TAKEN) + 1:
        q = _middle_shapes(base, degree)
        pull = q * w[:, None] / n
        value = pull.T @ rest
        u = np.sqrt(np.einsum("nk,n,nk->k", pull, handed[known], pull))
        shorter = 2.0 * extent / degree
        bands.append(_of_shapes("middle", (shorter, reach), value * UM_PER_MM, u * UM_PER_MM, tests.freedom))
        rest, reach = rest - q @ value, shorter
        finer = without_longest(power, (np.count_nonzero(base.fresh) + q.shape[1]) * known.size / n)
    freedom = effective_number(finer, n)
    if freedom >= LEAST_FREEDOM:
        square = float(np.mean(w * rest**2))
        expected = noise * float(np.mean(finer)) + _ROUNDING_MM2
        chance = _chance(square, expected, freedom, tests.freedom)
        bands.append(
            ChangeBand(
                name="fine",
                shortest_mm=finest,
                longest_mm=reach,
                rms_um=square**0.5 * UM_PER_MM,
                expected_rms_um=expected**0.5 * UM_PER_MM,
                freedom=freedom,
                p_value=chance,
                significant=chance < LEVEL,
            )
        )
    return tuple(bands), tests


def change_rungs(pair: Pair, bands: tuple[ChangeBand, ...], tests: Tests) -> tuple[ChangeRung, ...]:
    """Return the ladder of a difference: what is left, what noise would leave, and whether that is all.

    Parameters
    ----------
    pair : Pair
    bands : tuple of ChangeBand
    tests : Tests
    """
    finer = [band.p_value for band in bands if band.name != LOW]
    found = tests.orders.rungs
    rigid_mm2 = (
        _RIGID * tests.shape_mm2
        + _ROUNDING_MM2
        + float(np.mean((pair.late.pose_mm2 + pair.early.pose_mm2)[pair.known]))
    )
    rungs = []
    for k, rung in enumerate(found):
        taken = _TAKEN[k] if k < len(_TAKEN) else frozenset(tests.kinds)
        left = np.array([kind not in taken for kind in tests.kinds], dtype=np.bool_)
        expected = tests.rest_mm2 + float(np.sum((tests.u_um[left] / UM_PER_MM) ** 2))
        chances = list(finer)
        if left.any():
            chances.append(_shapes_chance(tests.value_um[left], tests.u_um[left], tests.freedom))
        if k == 0 and len(found) > 1:
            expected += rigid_mm2
            moved_um2 = rung.rms_um**2 - found[1].rms_um ** 2
            chances.append(_chance(moved_um2 / UM_PER_MM**2, rigid_mm2, _RIGID, tests.freedom))
        chance = min(1.0, len(chances) * min(chances, default=1.0))
        rungs.append(
            ChangeRung(
                removed=rung.removed,
                pv_um=rung.pv_um,
                rms_um=rung.rms_um,
                expected_rms_um=expected**0.5 * UM_PER_MM,
                p_value=chance,
                noise=chance >= LEVEL,
            )
        )
    return tuple(rungs)


def _middle_degree(pair: Pair) -> int:
    """Return the degree of the polynomials whose waves are still eight steps long along both axes."""
    waves = min(float(np.ptp(a)) / float(a[1] - a[0]) for a in (pair.x_mm, pair.y_mm)) / FINE_STEPS
    return min(int(2.0 * waves), MOST_DEGREE)


def _middle_shapes(base: LadderBase, degree: int) -> Array:
    """Return the shapes of the middle band, orthonormal to the ladder and to each other, shape (n, m)."""
    outline, weight = base.outline, base.nodes.weight
    x, y = base.nodes.points_mm[:, 0], base.nodes.points_mm[:, 1]
    p = legendre.legvander((x - outline.centre[0]) / outline.half[0], degree)
    q = legendre.legvander((y - outline.centre[1]) / outline.half[1], degree)
    first = LOW_DEGREE + 1 if base.family.startswith("Legendre") else 5  # Zernike's: some of those
    pairs = [(d - j, j) for d in range(first, degree + 1) for j in range(d + 1)]
    columns = np.stack([p[:, i] * q[:, j] for i, j in pairs]).T
    size = np.sqrt(np.mean(weight[:, None] * columns**2, axis=0))
    for _ in range(2):
        columns -= base.q @ (base.q.T @ (weight[:, None] * columns) / len(weight))
    new = np.sqrt(np.mean(weight[:, None] * columns**2, axis=0)) > LEAST_NEW * size
    shapes, fresh = orthonormalised(columns[:, new], weights=weight)
    return np.asarray(shapes[:, fresh], dtype=np.float64)


def _term_uncertainties(pair: Pair, orders: LowOrders) -> Array:
    """Return the standard uncertainties of the terms, um, with what both machines' statements add."""
    u = np.array([term.u_um for term in orders.terms])
    if pair.early.alignment.report.monte_carlo is None:
        return u
    nothing = np.zeros_like(pair.early.handed_mm2)
    difference = pair.late.deviation_mm - pair.early.deviation_mm
    again = low_orders(pair.early.alignment, pair.x_mm, pair.y_mm, difference, nothing, pair.weights)
    common = {term.name: term.u_um for term in again.terms}
    more = np.array([common.get(term.name, 0.0) for term in orders.terms])
    return np.asarray(np.hypot(u, more), dtype=np.float64)


def _of_shapes(
    name: str, limits: tuple[float, float], value_um: Array, u_um: Array, freedom: float
) -> ChangeBand:
    """Return a band of orthonormal shapes by their coefficients."""
    chance = _shapes_chance(value_um, u_um, freedom)
    return ChangeBand(
        name=name,
        shortest_mm=limits[0],
        longest_mm=limits[1],
        rms_um=float(np.linalg.norm(value_um)),
        expected_rms_um=float(np.linalg.norm(u_um)),
        freedom=float(len(value_um)),
        p_value=chance,
        significant=chance < LEVEL,
    )


def _shapes_chance(value_um: Array, u_um: Array, freedom: float) -> float:
    """Return the chance that noise alone gives coefficients as large."""
    u = np.maximum(u_um, ROUNDING_UM)
    return _chance(float(np.mean((value_um / u) ** 2)), 1.0, float(len(u)), freedom)


def _chance(square: float, expected: float, nu: float, freedom: float) -> float:
    """Return the chance of a mean square of `nu` values as large, its noise being known with a freedom."""
    from scipy.special import fdtrc

    if square <= 0.0:
        return 1.0
    return float(fdtrc(nu, freedom, square / expected)) if expected > 0.0 else 0.0
