"""What a form error consists of: what is left of a map without one low order after the other, and how sure.

The ladder is one basis, made orthonormal on the known nodes in the order in which its rungs remove it: the
rigid motions of the surface (columns ``n`` and ``(p - c) x n`` on the nominal itself), power, astigmatism,
coma and trefoil, and the rest of 36 polynomials. So the rungs are nested whatever the mask. A motion that the
surface cannot tell is no column: it would take away shape. One that the fit held on request is removed like
the others, for the ladder asks for the form; what the lock holds back is the step from the first rung to the
second. Nodes weigh by their area in the projection, as in the RMS of the map: a rung's RMS compares with it.

Coefficients are taken from the nodes, not fitted to the points. Fitted to points they depend on where points
happen to be dense, and what no low order follows leaks into them: with 20 000 points, 0.3 um of noise and a
form error of 27 um their 95 % intervals held the truth in 78 to 92 % of the cases, those from the nodes in 95
(`tests/bench/low_orders.py`). Nodes share points, so their noise is correlated; with h_i, what the noise of
the points hands to the sum of all nodes at node i (`handed_noise`), w_i the weight of a node (mean 1) and q_k
a shape,

    cov(c_k, c_l) = 1/n^2 sum_i w_i^2 q_k(i) h_i q_l(i).                                                  (1)

Where a Monte Carlo was asked for, what touches have in common by the machine's statement comes on top: not
from the spread of single points, which does not say how it is shared among shapes, but projected on them.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmm_align.model import Alignment
from cmm_align.model.low_orders import Kind, LowOrders, Rung, Term
from cmm_align.numerics.aperture_basis import (
    ANNULAR,
    KINDS,
    ROUND,
    Outline,
    low_order_shapes,
    orthonormalised,
    outline_of,
)
from cmm_align.numerics.chunked import chunks
from cmm_align.numerics.linearisation import even_sample
from cmm_align.numerics.machine_error import error_factors, machine_error
from cmm_align.stages.told_motions import motion_columns
from cmm_align.surfaces.geometry import unit_normal
from cmm_align.surfaces.protocol import Array, Mask
from cmm_align.units import DEG_PER_RAD, UM_PER_MM, parse_mpe

NODES_PER_TERM: Final = 3
"""Fewest nodes for each shape."""
DOMINANT: Final = 0.5
"""Share of the mean square beyond the rigid motion from which on a kind is what the form error mostly is."""
WORTH_NAMING: Final = 0.02
"""Least share of a kind that is named beside others."""
SAMPLE: Final = 4096
"""Nodes that what the machine's errors have in common is projected on."""

_RUNGS: Final = (
    ("+ power", 1),
    ("+ astigmatism", 3),
    ("+ coma and trefoil", 7),
    ("36 terms", 36),
)
"""What is removed beyond the rigid motion, and how many shapes that is."""
_DIRECTIONS: Final = {"astigmatism": ("axis", 180), "coma": ("towards", 360), "trefoil": ("lobe at", 120)}
"""What the direction of a kind is called, and after how many degrees it is the same again."""
_ROUNDING: Final = 1e-12


class _Nodes(NamedTuple):
    """The known nodes on the nominal, frame `surface`."""

    points_mm: Array
    """Shape (n, 3)."""
    normals: Array
    """Shape (n, 3)."""
    deviation_mm: Array
    """Shape (n,)."""
    weight: Array
    """Shape (n,), mean 1."""


class LadderBase(NamedTuple):
    """The shapes of the ladder on the known nodes."""

    nodes: _Nodes
    outline: Outline
    family: str
    """What the polynomials are."""
    names: tuple[str, ...]
    """Of the polynomials; the motions before them have none."""
    ends: tuple[int, ...]
    """How many shapes each rung removes, also of rungs that the nodes do not carry."""
    raw: Array
    """The shapes as they are, shape (n, m)."""
    q: Array
    """Orthonormal: ``mean(w q_i q_j) = delta_ij``, shape (n, m)."""
    fresh: Mask
    """Which of them are new, shape (m,)."""


class _Fit(NamedTuple):
    """The map in orthonormal shapes."""

    names: tuple[str, ...]
    raw: Array
    """The polynomials as they are, shape (n, m)."""
    q: Array
    """Orthonormal: ``mean(w q_i q_j) = delta_ij``, shape (n, m)."""
    weight: Array
    """Of the nodes, shape (n,), mean 1."""
    fresh: Mask
    n_rigid: int
    coefficient_mm: Array
    """Shape (m,)."""
    covariance_mm2: Array
    """Shape (m, m)."""


def low_orders(
    alignment: Alignment,
    x_mm: Array,
    y_mm: Array,
    deviation_mm: Array,
    noise_mm2: Array,
    weights: Array | None = None,
) -> LowOrders:
    """Return the low orders of a deviation map.

    Parameters
    ----------
    alignment : Alignment
        The points behind the map: its nominal, its free and locked motions, its Monte Carlo.
    x_mm, y_mm : ndarray, shape (nx,), (ny,), mm, frame `surface`
        Evenly spaced, ascending.
    deviation_mm : ndarray, shape (ny, nx), mm
        Along the normal, positive = excess material, NaN where unknown; at least one node is known.
    noise_mm2 : ndarray, shape (ny, nx), mm^2
        What the noise of the points hands to the sum of the nodes, node by node: `handed_noise`.
    weights : ndarray, shape (ny, nx), optional
        Area of each node, any unit, positive: products of `node_widths`; without it, all alike.

    Returns
    -------
    LowOrders
        A map too small for all shapes (three nodes each) has fewer rungs, and the 36 terms of PVr
        (C. J. Evans, Opt. Eng. 48, 2009, doi 10.1117/1.3119307) are then those that it carries.

    Notes
    -----
    Uncertainties are to first order, from noise and (with a Monte Carlo) from the machine; the smoothing of
    the map is not in them. The pose is not either: the shapes hold nothing that a motion could change.
    """
    base = ladder_base(alignment, x_mm, y_mm, deviation_mm, weights)
    nodes, n, n_rigid = base.nodes, len(base.nodes.deviation_mm), base.ends[1]
    coefficients, covariance = _coefficients(base.q, nodes, noise_mm2[np.isfinite(deviation_mm)])
    covariance += _common_covariance(alignment, nodes, base.q)  # eq. (1)
    fit = _Fit(base.names, base.raw, base.q, nodes.weight, base.fresh, n_rigid, coefficients, covariance)
    rungs = _rungs(fit, nodes.deviation_mm, [end for end in base.ends if end <= base.q.shape[1]])
    kinds = _kinds(fit, rungs)
    return LowOrders(
        basis=base.family,
        shape=base.outline.shape,
        normalisation=_normalisation(base.outline),
        rigid=_rigid_words(alignment, n_rigid),
        n_nodes=n,
        terms=_terms(fit),
        kinds=kinds,
        rungs=rungs,
        words=_words(kinds, rungs),
    )


def ladder_base(
    alignment: Alignment, x_mm: Array, y_mm: Array, deviation_mm: Array, weights: Array | None = None
) -> LadderBase:
    """Return the shapes of the ladder, orthonormal on the known nodes; as many as these carry.

    Parameters
    ----------
    alignment, x_mm, y_mm, deviation_mm, weights
        As for `low_orders`; deviations and weights of shape (ny, nx).
    """
    known = np.isfinite(deviation_mm)
    nodes = _on_nominal(
        alignment, x_mm, y_mm, deviation_mm, np.ones(known.shape) if weights is None else weights
    )
    outline = outline_of(x_mm, y_mm, known)
    motions = motion_columns(alignment, nodes.points_mm, nodes.normals)
    n, n_rigid = len(nodes.deviation_mm), motions.shape[1]
    ends = (0, n_rigid, *(n_rigid + count for _, count in _RUNGS))
    carried = max(end for end in ends if end * NODES_PER_TERM <= n)
    raw = np.empty((n, carried))
    raw[:, :n_rigid] = motions[:, :carried]
    for part in chunks(n):
        shapes = low_order_shapes(outline, *nodes.points_mm[part, :2].T)
        raw[part, n_rigid:] = shapes.columns[:, : max(carried - n_rigid, 0)]
    q, fresh = orthonormalised(raw, weights=nodes.weight)
    return LadderBase(nodes, outline, shapes.family, shapes.names, ends, raw, q, fresh)


def _on_nominal(
    alignment: Alignment, x_mm: Array, y_mm: Array, deviation_mm: Array, weights: Array
) -> _Nodes:
    """Return the known nodes as places on the nominal."""
    nominal, known = alignment.nominal, np.isfinite(deviation_mm)
    x, y = (grid[known] for grid in np.meshgrid(x_mm, y_mm))
    jet = nominal.surface.jet(x, y)
    return _Nodes(
        np.stack([x, y, jet.z], axis=1),
        unit_normal(jet, nominal.side),
        deviation_mm[known],
        weights[known] / weights[known].mean(),
    )


def _coefficients(q: Array, nodes: _Nodes, noise_mm2: Array) -> tuple[Array, Array]:
    """Return the coefficients of the shapes, mm, and their covariance from the noise of the points, mm^2."""
    n, m = q.shape
    coefficients, covariance = np.zeros(m), np.zeros((m, m))
    for part in chunks(n):
        pull = q[part].T * (nodes.weight[part] / n)
        coefficients += pull @ nodes.deviation_mm[part]
        covariance += (pull * noise_mm2[part]) @ pull.T
    return coefficients, covariance


def _common_covariance(alignment: Alignment, nodes: _Nodes, q: Array) -> Array:
    """Return the covariance from what touches have in common by the machine's statement, (m, m), mm^2."""
    simulated = alignment.report.monte_carlo
    if simulated is None:
        return np.zeros((q.shape[1], q.shape[1]))
    constant_um, divisor = parse_mpe(simulated.mpe)
    error = machine_error(
        constant_um / UM_PER_MM,
        1.0 / (UM_PER_MM * divisor),
        probe_share=simulated.probe_share,
        coverage_factor=simulated.coverage_factor,
    )
    pick = even_sample(len(q), SAMPLE)
    tips = nodes.points_mm[pick] + alignment.nominal.tip_radius_mm * nodes.normals[pick]
    centre = alignment.nominal.surface_from_part.apply(alignment.centroid_mm[None])[0]
    factors, _ = error_factors(error, tips - centre, nodes.normals[pick])
    root = np.sqrt(nodes.weight[pick])[:, None]
    response = np.linalg.lstsq(q[pick] * root, factors.T * root, rcond=None)[0]
    return np.asarray(response @ response.T, dtype=np.float64)


def _rungs(fit: _Fit, deviation_mm: Array, ends: list[int]) -> tuple[Rung, ...]:
    """Return what is left beyond each number of shapes."""
    names = ("nothing", "rigid motion", *(name for name, _ in _RUNGS))
    rest = deviation_mm - fit.q @ fit.coefficient_mm
    rest_rms = _rms(rest, fit.weight)
    rungs = []
    for name, end in zip(names, ends, strict=False):
        low = fit.q[:, end:] @ fit.coefficient_mm[end:]
        left = (low + rest) * UM_PER_MM
        pvr = (float(np.ptp(low)) + 3.0 * rest_rms) * UM_PER_MM
        rungs.append(Rung(name, float(np.ptp(left)), _rms(left, fit.weight), pvr))
    return tuple(rungs)


def _rms(values: Array, weight: Array) -> float:
    return float(np.sqrt(np.mean(weight * values**2)))


def _terms(fit: _Fit) -> tuple[Term, ...]:
    """Return the coefficients of the shapes that the nodes can tell."""
    sigma = np.sqrt(np.maximum(np.diag(fit.covariance_mm2), 0.0)) * UM_PER_MM
    value = fit.coefficient_mm * UM_PER_MM
    columns = range(fit.n_rigid, len(value))
    return tuple(
        Term(fit.names[k - fit.n_rigid], float(value[k]), float(sigma[k])) for k in columns if fit.fresh[k]
    )


def _kinds(fit: _Fit, rungs: tuple[Rung, ...]) -> tuple[Kind, ...]:
    """Return the kinds that the nodes carry and can tell."""
    beyond_um2 = rungs[1].rms_um ** 2 if len(rungs) > 1 else 0.0
    kinds = []
    first = fit.n_rigid
    for name, members in KINDS:
        columns = np.arange(first, first + len(members))
        first += len(members)
        if first <= len(fit.coefficient_mm) and fit.fresh[columns].all():
            kinds.append(_kind(name, members[0][1], fit, columns, beyond_um2))
    return tuple(kinds)


def _kind(name: str, order: int, fit: _Fit, columns: NDArray[np.intp], beyond_um2: float) -> Kind:
    """Return one kind; its PV is ``g . c``, g being the difference of its shapes between the two extremes."""
    q, c = fit.q[:, columns], fit.coefficient_mm[columns]
    covariance = fit.covariance_mm2[np.ix_(columns, columns)]
    field = q @ c
    g = q[int(np.argmax(field))] - q[int(np.argmin(field))]
    sign = 1.0 if order else float(np.sign(c[0]))
    triangle = (q * fit.weight[:, None]).T @ fit.raw[:, columns] / len(q)
    angle, u_angle = _angle(order, triangle, c, covariance) if order else (None, None)
    rms = float(np.linalg.norm(c)) * UM_PER_MM
    return Kind(
        name=name,
        amplitude_um=sign * float(g @ c) * UM_PER_MM,
        u_um=float(np.sqrt(g @ covariance @ g)) * UM_PER_MM,
        angle_deg=angle,
        u_angle_deg=u_angle,
        rms_um=rms,
        share=rms**2 / beyond_um2 if beyond_um2 > 0.0 else 0.0,
    )


def _angle(order: int, triangle: Array, c: Array, covariance: Array) -> tuple[float, float]:
    """Return the direction of ``a cos(m t) + b sin(m t)`` and its standard uncertainty, deg."""
    back = np.linalg.inv(triangle)
    (a, b), spread = back @ c, back @ covariance @ back.T
    period = 360.0 / order
    square = float(a * a + b * b)
    unknown = period / np.sqrt(12.0)
    if square == 0.0:
        return 0.0, float(unknown)
    across = np.array([-b, a]) / (square * order)
    sigma = float(np.sqrt(across @ spread @ across)) * DEG_PER_RAD
    angle = float(np.arctan2(b, a)) * DEG_PER_RAD / order % period
    return angle, float(np.minimum(sigma, unknown))


def _normalisation(outline: Outline) -> str:
    """Write what the polynomials are counted over."""
    about = "about ({:.4g}, {:.4g})".format(*(value + 0.0 for value in outline.centre))
    if outline.shape in {ROUND, ANNULAR}:
        return f"circle of radius {outline.radius:.4g} mm {about}"
    return f"rectangle of {2 * outline.half[0]:.4g} x {2 * outline.half[1]:.4g} mm {about}"


def _rigid_words(alignment: Alignment, n_rigid: int) -> str:
    """Write which motions the ladder removes."""
    words = (
        "all six motions" if n_rigid == 6 else f"{n_rigid} of six motions; the others do not change the form"
    )
    if alignment.report.locked:
        words += f"; the fit held {', '.join(alignment.report.locked)}, the ladder does not"
    return words


def _words(kinds: tuple[Kind, ...], rungs: tuple[Rung, ...]) -> str:
    """Say what the form error mostly is."""
    if len(rungs) < 3:
        return "too few nodes for a word on the form"
    beyond = rungs[1].rms_um
    if beyond <= _ROUNDING * rungs[0].rms_um:
        return "nothing beyond the rigid motion"
    largest = max(kinds, key=lambda kind: kind.share)
    if largest.share > DOMINANT:
        where = ""
        if largest.angle_deg is not None:
            axis, period = _DIRECTIONS[largest.name]
            where = f", {axis} {round(largest.angle_deg) % period} deg"
        return f"mostly {largest.name}, {_in_um(largest.amplitude_um)} um{where}"
    rest = 1.0 - sum(kind.share for kind in kinds)
    if rest > DOMINANT:
        return f"mostly finer than the low orders, {_in_um(beyond * rest**0.5)} um RMS"
    ranked = sorted(kinds, key=lambda kind: -kind.share)
    listed = [f"{k.name} {_in_um(k.amplitude_um)}" for k in ranked if k.share >= WORTH_NAMING]
    return f"no single kind dominates: {', '.join(listed)} um"


def _in_um(value: float) -> str:
    """Write a length in um with a sensible number of digits."""
    return f"{value:.1f}" if abs(value) >= 1.0 else f"{value:.2g}"
