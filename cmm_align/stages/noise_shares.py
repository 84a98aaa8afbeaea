"""What noise adds to the RMS and to the extremes of a map, and what is left without it.

Noise is in every number of squares and of extremes, and only ever adds. Two levels of it are told: the
scatter of points about the map (noise, and waves that the grid does not carry) and the noise of neighbours
(`numerics.point_noise`), which such waves hardly touch. With w the area of a node, s its uncertainty from the
scatter, S the scatter (a median over windows), t >= 1 the mean square of residuals of single points over what
their median square says it is (scratches make it large), and s_n the noise of a point

    RMS0^2 = mean(w e^2) - mean(w s^2) + max(t S^2 - s_n^2, 0),                                      (1)

the last term only where it is beyond twice its uncertainty: form that single points show and the map does
not.

What noise adds to an extreme is the mean of its exact distribution (`numerics.extreme_value`) with a map
freed of noise in place of the truth (smoothed, and shrunk to its RMS without noise: the map as it is has its
noise in its extremes already); among N points each of n nodes stands for N / n. An extreme on the border of
the map lies up to half a step from where the data end: the slope there times that length is an open interval,
whose middle is added and whose spread goes to the uncertainty. Of map and single points the surer witness
counts; the points wherever they go beyond the map by more than twice the uncertainty of the difference. Nodes
on the border that the points do not determine are no part of the RMS; what it would be with the value of
their neighbours counts as uncertainty.

Standard uncertainties hold noise, pose and, with a Monte Carlo, what touches have in common by the machine's
statement. After a filter the noise that is left is not known: nothing is taken out, and all that noise could
have added is uncertainty.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from cmm_align.model import Alignment, IntArray, Statistics
from cmm_align.numerics.extreme_value import Extreme, largest_excess
from cmm_align.numerics.grid_field import interpolated, smoothed
from cmm_align.numerics.linearisation import even_sample
from cmm_align.numerics.local_regression import LocalFit
from cmm_align.numerics.point_noise import MEDIAN_CHI2, MEDIAN_SPREAD, near_sample, neighbour_noise
from cmm_align.stages.map_nodes import MapNodes, noise_of_pose, pose_rows, pose_share
from cmm_align.surfaces.protocol import Array, Mask

SAMPLE: Final = 20_000
"""Points whose residuals are taken."""
SEEN: Final = 2.0
"""Standard uncertainties from which on single points show something that the map does not."""


class PointNoise(NamedTuple):
    """What single points say beyond the map."""

    sd: float
    """Noise of a point, mm."""
    beyond: float
    """Mean square of form that single points show and the map does not, mm^2."""
    u_beyond: float
    """Its standard uncertainty."""


class Measured(NamedTuple):
    """A map and the points behind it, all that its numbers are taken from; lengths in mm."""

    alignment: Alignment
    axes_mm: tuple[Array, Array]
    deviation_mm: Array
    """Shape (ny, nx), NaN where unknown."""
    nodes: MapNodes
    fit: LocalFit
    window: float
    x_mm: Array
    """Places of the single points in frame `surface`, shape (N,)."""
    y_mm: Array
    points_mm: Array
    """Their deviations, shape (N,)."""
    statistics: Statistics
    point_statistics: Statistics
    filtered: bool
    inside: Mask
    """Nodes on the nominal, shape (ny, nx)."""
    common_mm: tuple[float, float] = (0.0, 0.0)
    """Standard uncertainty of RMS and PV from what touches have in common by the machine's statement, or from
    uncertainties of points that are stated larger than their scatter."""
    noise: PointNoise = PointNoise(0.0, 0.0, 0.0)
    form_mm: Array = np.zeros((1, 1))
    """The map freed of noise as far as may be, shape (ny, nx): what noise is added to."""
    centroid_mm: Array = np.zeros(3)
    """Of the tip centres, frame `part`: what the pose turns about."""
    pose_covariance: Array = np.zeros((6, 6))
    """Of the pose, from noise, shape (6, 6), rad and mm."""


class Told(NamedTuple):
    """A number as measured, without noise, and the standard uncertainty of the latter, mm."""

    measured: float
    value: float
    u: float


class Shares(NamedTuple):
    """Numbers freed of noise, mm."""

    scatter: float
    rms: Told
    pv: Told
    profile: Told
    lowest: Told
    highest: Told


def with_noise(m: Measured) -> Measured:
    """Return the same with the noise of its points told, and what that noise does to the pose."""
    smooth_mm = smoothed(m.fit.value if m.filtered else m.deviation_mm)
    told = _of_points(m, smooth_mm)
    square = m.statistics.rms_mm**2
    kept = 0.0 if m.filtered else m.nodes.mean(m.nodes.sigma_mm**2)
    shrunk = float(np.sqrt(max(1.0 - kept / square, 0.0))) if square > 0.0 else 1.0
    centroid = m.alignment.centroid_mm
    return m._replace(
        noise=told,
        centroid_mm=centroid,
        form_mm=shrunk * (smoothed(m.deviation_mm) if m.filtered else smooth_mm),
        pose_covariance=noise_of_pose(m.alignment, centroid, told.sd),
    )


def noise_shares(m: Measured) -> Shares:
    """Return RMS, PV, profile and both ends of a map with and without what noise adds.

    Returns
    -------
    Shares
        `measured` is the worse of nodes and single points, of the nodes alone after a filter; the ends are
        those of the nodes.
    """
    s, p = m.statistics, m.point_statistics
    u_rms_machine, u_pv_machine = m.common_mm
    ends = [_end(m, s, sign) for sign in (1.0, -1.0)]
    beside = [_single(m, sign) for sign in (1.0, -1.0)]
    rows = pose_rows(
        m.alignment.nominal, m.centroid_mm, *(np.array(v) for v in zip(s.max_at_mm, s.min_at_mm, strict=True))
    )
    u_pose = pose_share(m.pose_covariance, rows[0] - rows[1])
    pv = _worse(
        Told(s.pv_mm, ends[0].value + ends[1].value, _joined(ends[0].u, ends[1].u)),
        Told(p.pv_mm, beside[0].value + beside[1].value, _joined(beside[0].u, beside[1].u)),
        filtered=m.filtered,
    )
    u_place = [
        _joined(end.u, pose_share(m.pose_covariance, row), _machine_at(m, sign))
        for end, row, sign in zip(ends, rows, (1.0, -1.0), strict=True)
    ]
    half = over_band(m, 0.0, 0.0)
    return Shares(
        scatter=float(np.nan_to_num(m.fit.scatter)),
        rms=_rms(m, u_rms_machine),
        pv=pv._replace(u=_joined(pv.u, u_pose, u_pv_machine)),
        profile=Told(2.0 * half.measured, 2.0 * half.value, 2.0 * half.u),
        lowest=Told(s.min_mm, -ends[1].value, u_place[1]),
        highest=Told(s.max_mm, ends[0].value, u_place[0]),
    )


def _joined(*parts: float) -> float:
    """Return independent uncertainties in quadrature."""
    return float(np.sqrt(sum(part * part for part in parts)))


def _worse(nodes: Told, points: Told, *, filtered: bool) -> Told:
    """Return the worse as measured, and the surer value: that of the points where they go beyond the map."""
    if filtered:
        return nodes
    seen = points.value - nodes.value > SEEN * _joined(nodes.u, points.u)
    taken = points if seen or points.u < nodes.u else nodes
    return Told(max(nodes.measured, points.measured), taken.value, taken.u)


def _residuals(m: Measured, field: Array, at: IntArray) -> tuple[Array, Array, Array]:
    """Return x, y and residuals from a field, of the points `at` where it is known, each of shape (k,)."""
    r = m.points_mm[at] - interpolated(*m.axes_mm, field, m.x_mm[at], m.y_mm[at])
    known = np.isfinite(r)
    return m.x_mm[at][known], m.y_mm[at][known], r[known]


def _of_points(m: Measured, smooth_mm: Array) -> PointNoise:
    """Return the noise of a point, and what single points show beyond map and noise.

    Neighbours are freed of the form by a smoothed map: the map itself follows the noise of its few points,
    and residuals from it are too small. Noise is at most the scatter.
    """
    told = neighbour_noise(*_residuals(m, smooth_mm, near_sample(m.x_mm, m.y_mm)))
    scatter = float(np.nan_to_num(m.fit.scatter))
    own = m.fit.value if m.filtered else m.deviation_mm  # single points are never filtered
    r = _residuals(m, own, even_sample(len(m.x_mm), SAMPLE))[2]
    if not np.isfinite(told.sd) or len(r) == 0:
        return PointNoise(scatter, 0.0, scatter**2)
    middle = float(np.median(r**2))
    tails = max(1.0, float(np.mean(r**2)) * MEDIAN_CHI2 / middle) if middle > 0.0 else 1.0
    seen = scatter**2 * tails
    noise2 = min(told.sd, scatter) ** 2
    spread = _joined(told.relative_u * noise2, seen * MEDIAN_SPREAD / float(np.sqrt(len(r))))
    beyond = seen - noise2
    if beyond <= SEEN * spread:
        return PointNoise(noise2**0.5, 0.0, 0.0)
    return PointNoise(noise2**0.5, beyond, _joined(spread, 0.5 * beyond))


def _rms(m: Measured, u_machine: float) -> Told:
    """Return the RMS, eq. (1)."""
    nodes, s, p = m.nodes, m.statistics, m.point_statistics
    kept = nodes.mean(nodes.sigma_mm**2)
    square = s.rms_mm**2 if m.filtered else max(s.rms_mm**2 - kept, 0.0) + m.noise.beyond
    value = float(np.sqrt(square))
    size = max(value, float(np.sqrt(kept / len(nodes.weight))), 1e-300)
    u = _joined(
        nodes.noise_of_rms(nodes.deviation_mm),
        m.noise.u_beyond / (2.0 * size),
        (s.rms_mm - float(np.sqrt(max(s.rms_mm**2 - kept, 0.0)))) if m.filtered else 0.0,
        pose_share(m.pose_covariance, _rms_gradient(m)),
        _without_border(m),
        u_machine,
    )
    return Told(s.rms_mm if m.filtered else max(s.rms_mm, p.rms_mm), value, u)


def _without_border(m: Measured) -> float:
    """Return the standard uncertainty of the RMS from undetermined nodes beside known ones."""
    known = m.nodes.known
    open_nodes = m.inside & ~known
    if not open_nodes.any():
        return 0.0
    from scipy.ndimage import maximum_filter, minimum_filter  # slow to import

    field = np.where(known, m.deviation_mm, 0.0)
    high, low = maximum_filter(field, 3)[open_nodes], minimum_filter(field, 3)[open_nodes]
    neighbour = np.where(np.abs(high) > np.abs(low), high, low)
    s = m.statistics
    more = float(np.sum(neighbour**2))
    n_beside = int(np.count_nonzero(neighbour))
    total = len(m.nodes.x_mm)
    with_them = float(np.sqrt((s.rms_mm**2 * total + more) / (total + n_beside)))
    return abs(with_them - s.rms_mm) / float(np.sqrt(3.0))


def _rms_gradient(m: Measured) -> Array:
    """Return the change of the RMS with the pose, ``mean(w e J) / RMS``, shape (6,)."""
    at = even_sample(len(m.nodes.x_mm), SAMPLE)
    rows = pose_rows(m.alignment.nominal, m.centroid_mm, m.nodes.x_mm[at], m.nodes.y_mm[at])
    pull = m.nodes.weight[at] * m.nodes.deviation_mm[at]
    return np.asarray(pull @ rows / (len(at) * max(m.statistics.rms_mm, 1e-300)), dtype=np.float64)


def _end(m: Measured, s: Statistics, sign: float) -> Told:
    """Return the largest of the nodes (of their negatives for sign -1)."""
    nodes = m.nodes
    e = sign * nodes.deviation_mm
    at = int(np.argmax(e))
    form = sign * m.form_mm[nodes.known]
    return _of_node(m, at, float(e[at]), largest_excess(form, nodes.sigma_mm, alike=nodes.alike))


def _of_node(m: Measured, at: int, top: float, noisy: Extreme) -> Told:
    """Return the largest of the nodes, `top` at node `at`, and what it is without what noise adds."""
    if m.filtered:
        return Told(top, top, _joined(noisy.sd, noisy.added))
    beyond = _to_the_border(m, at)
    return Told(top, top - noisy.added + 0.5 * beyond, _joined(noisy.sd, beyond / float(np.sqrt(12.0))))


def _to_the_border(m: Measured, at: int) -> float:
    """Return how much higher the surface may rise between a node and where the data end, mm; 0 inside."""
    known = m.nodes.known
    iy, ix = (int(v[at]) for v in np.nonzero(known))
    ny, nx = known.shape
    inside = 0 < iy < ny - 1 and 0 < ix < nx - 1 and known[iy - 1 : iy + 2, ix - 1 : ix + 2].all()
    if inside:
        return 0.0
    slope = np.nan_to_num(m.fit.slope[:, iy, ix])
    return float(0.5 * np.hypot(slope[0] * m.nodes.step_mm[0], slope[1] * m.nodes.step_mm[1]))


def _single(m: Measured, sign: float) -> Told:
    """Return the largest of the single points, what noise adds being that on the map at their number."""
    found = largest_excess(sign * m.form_mm[m.nodes.known], m.noise.sd, alike=_nodes_a_point(m))
    top = m.point_statistics.max_mm if sign > 0.0 else -m.point_statistics.min_mm
    return Told(top, top - found.added, found.sd)


def _nodes_a_point(m: Measured) -> float:
    return len(m.nodes.x_mm) / len(m.points_mm)


def _machine_at(m: Measured, sign: float) -> float:
    """Return what touches have in common at the highest (lowest) node, mm."""
    return float(m.nodes.machine_mm[int(np.argmax(sign * m.nodes.deviation_mm))])


def over_band(m: Measured, lower_mm: float, upper_mm: float) -> Told:
    """Return the largest excess of nodes and single points over a band, mm; negative where all keep it."""
    nodes, form = m.nodes, m.form_mm[m.nodes.known]
    over = np.maximum(nodes.deviation_mm - upper_mm, lower_mm - nodes.deviation_mm)
    at = int(np.argmax(over))
    noisy = largest_excess(form, nodes.sigma_mm, lower_mm, upper_mm, alike=nodes.alike)
    among_points = largest_excess(form, m.noise.sd, lower_mm, upper_mm, alike=_nodes_a_point(m))
    top = float(np.max(np.maximum(m.points_mm - upper_mm, lower_mm - m.points_mm)))
    told = _worse(
        _of_node(m, at, float(over[at]), noisy),
        Told(top, top - among_points.added, among_points.sd),
        filtered=m.filtered,
    )
    row = pose_rows(m.alignment.nominal, m.centroid_mm, nodes.x_mm[at : at + 1], nodes.y_mm[at : at + 1])[0]
    return told._replace(u=_joined(told.u, pose_share(m.pose_covariance, row), float(nodes.machine_mm[at])))


def over_limits(m: Measured, lower_mm: Array, upper_mm: Array) -> Told:
    """Return the largest excess of single points over limits of their own, mm; nodes have none.

    Parameters
    ----------
    m : Measured
    lower_mm, upper_mm : ndarray, shape (N,), mm
    """
    on_map = interpolated(*m.axes_mm, m.form_mm, m.x_mm, m.y_mm)
    form = np.where(np.isfinite(on_map), on_map, m.points_mm)
    over = np.maximum(m.points_mm - upper_mm, lower_mm - m.points_mm)
    at = int(np.argmax(over))
    top = float(over[at])
    noisy = largest_excess(form, m.noise.sd, lower_mm, upper_mm)
    row = pose_rows(m.alignment.nominal, m.centroid_mm, m.x_mm[at : at + 1], m.y_mm[at : at + 1])[0]
    u = _joined(noisy.sd, pose_share(m.pose_covariance, row), float(m.nodes.machine_mm.max()))
    return Told(top, top - noisy.added, u)
