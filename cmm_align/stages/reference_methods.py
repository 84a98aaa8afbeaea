"""Reference methods for comparison: what is published and what shops use, beside which `align` must stand.

They share the points, the nominal and the start with `align`, and are given tight tolerances and all the
iterations they need. None of them rejects outliers or searches for a start: the published methods do not.

- ``icp``: every point to its nearest vertex of the equidistant surface.
- ``point-to-plane``: to the tangent plane of that vertex, with the exact normal of the nominal.
- ``facet``: to the triangle whose projection holds the point. The source paper, Photonics 2025, 12(5), 469,
  doi 10.3390/photonics12050469, section 2.
- ``xiong``: to the nominal straight below the point, minus the tip radius.
- ``estimated-normals``: the ball taken off along normals estimated from the cloud itself, then orthogonal
  feet on the nominal.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from cmm_align.config import ALIGN_CHOICES, AlignConfig
from cmm_align.errors import UsageError, WrongStageError
from cmm_align.model import MIN_POINTS, Nominal, PointKind, PointSet
from cmm_align.numerics.fit_steps import FitSettings
from cmm_align.numerics.icp_closest_point import IcpResult, point_to_point, tangent_plane_measure
from cmm_align.numerics.linearisation import Measure, Placement, moved
from cmm_align.numerics.local_normals import local_quadratic_normals
from cmm_align.numerics.reference_look_up import look_up_measure
from cmm_align.numerics.rigid_fit import fit
from cmm_align.numerics.triangle_net import TriangleNet, locate, triangle_net
from cmm_align.pose import Pose
from cmm_align.stages.plausibility import check_measured
from cmm_align.stages.way import COARSE_TOLERANCE
from cmm_align.surfaces.distance import facet_measure, smooth_measure
from cmm_align.surfaces.envelope import Reach
from cmm_align.surfaces.equidistant import limits_of
from cmm_align.surfaces.protocol import Array, Mask
from cmm_align.units import RAD_PER_DEG

METHODS: Final = ALIGN_CHOICES["method"][1:]
LEAST_ITERATIONS: Final = 500
"""Iterations every method may take at least in each round: point to point needs hundreds."""
ROUNDS: Final = 5
"""Rounds of fitting and of leaving out the points that came to lie off the nominal."""


@dataclass(frozen=True, slots=True)
class ReferenceFit:
    """What a reference method found.

    Attributes
    ----------
    method : str
    part_from_machine : Pose
    iterations : int
    converged : bool
    stop_reason : str
    own_rms_mm : float
        RMS of what the method itself minimised: to vertices, planes or facets, not to the surface.
    cost_history_mm2 : tuple of float
        Its mean square before each step, mm^2.
    """

    method: str
    part_from_machine: Pose
    iterations: int
    converged: bool
    stop_reason: str
    own_rms_mm: float
    cost_history_mm2: tuple[float, ...]


Run = Callable[[Placement, Mask], IcpResult]
"""Fit the points that count, from a placement."""


def reference_pose(
    method: str,
    measured: PointSet,
    nominal: Nominal,
    config: AlignConfig = AlignConfig(),
    *,
    start: Pose | None = None,
) -> ReferenceFit:
    """Lay measured points on a nominal by a reference method.

    Parameters
    ----------
    method : str
        One of `METHODS`.
    measured : PointSet
        Tip centres, mm, frame `machine`; contact points if their kind says so.
    nominal : Nominal
        With its equidistant net, whose spacing decides how exact vertices and facets are.
    config : AlignConfig
        Tolerance, iterations (at least `LEAST_ITERATIONS`) and largest rotation of a step.
    start : Pose, optional
        ``part_from_machine`` to start from; without it the machine's frame as it is.

    Returns
    -------
    ReferenceFit
        May be not converged, or have slid off the nominal: it says so, and the pose is what it is.

    Raises
    ------
    UsageError
        If the method is not known, or the net was not loaded.
    WrongStageError, GeometryError, UnitsError
        If the points cannot be a measurement of this nominal, or contact points are to lose a ball again.

    Notes
    -----
    Tested errors, as deviations over the part: ``facet`` and ``point-to-plane`` below ``h^2 k / 4`` for nodes
    h apart on curvature k, ``xiong`` below ``k r^2 tan(theta)^2 / 2``, ``estimated-normals`` second order in
    the error of the normals, ``icp`` exact on its vertices and a share of h anywhere else.
    """
    if method not in METHODS:
        raise UsageError(f"method {method!r}", expected=", ".join(METHODS))
    check_measured(measured, nominal)
    if nominal.equidistant is None:
        raise UsageError("the net of the nominal was not loaded", expected="a nominal with its equidistant")
    pose = nominal.surface_from_part @ (start or Pose.identity("part", "machine"))
    contact = measured.kind is PointKind.CONTACT
    points = measured.points_mm
    if method == "estimated-normals":
        if contact:
            raise WrongStageError(
                "these points are contact points", where=measured.source, expected="tip centres"
            )
        points = _without_the_ball(points, pose, nominal)
    on_the_part = contact or method == "estimated-normals"
    net = _net(nominal, on_the_part)
    centroid = points.mean(axis=0)
    centred = points - centroid
    run = _runner(method, centred, net, nominal, 0.0 if on_the_part else nominal.tip_radius_mm, config)
    end = _settled(run, Placement(pose.rotation, pose.apply(centroid[None])[0]), centred, net)
    shift = end.placement.position_mm - end.placement.rotation @ centroid
    surface_from_machine = Pose(end.placement.rotation, shift, "surface", "machine")
    return ReferenceFit(
        method=method,
        part_from_machine=nominal.surface_from_part.inverse() @ surface_from_machine,
        iterations=end.iterations,
        converged=end.converged,
        stop_reason=end.stop_reason,
        own_rms_mm=float(np.sqrt(end.costs_mm2[-1])),
        cost_history_mm2=end.costs_mm2,
    )


def _without_the_ball(points_mm: Array, surface_from_machine: Pose, nominal: Nominal) -> Array:
    """Take the ball off along estimated normals; the start tells which way is out."""
    normals = local_quadratic_normals(points_mm)
    upwards = surface_from_machine.rotate(normals)[:, 2:] * nominal.side
    return points_mm - nominal.tip_radius_mm * np.where(upwards < 0.0, -normals, normals)


def _net(nominal: Nominal, on_the_part: bool) -> TriangleNet:
    """Return the facets of the nominal, or of its equidistant surface, ready for location."""
    net = nominal.equidistant
    if net is None:
        raise UsageError("the net of the nominal was not loaded")
    points = net.nominal_points_mm if on_the_part else net.points_mm
    return triangle_net(nominal.surface_from_part.apply(points), net.triangles)


def _runner(
    method: str, centred: Array, net: TriangleNet, nominal: Nominal, radius: float, config: AlignConfig
) -> Run:
    """Return the method as a function of where to start and which points count."""
    size = nominal.surface.bounds.diagonal_mm
    settings = FitSettings(
        size_mm=size,
        length_mm=float(np.sqrt(np.mean(np.sum(centred**2, axis=1)))),
        tolerance=config.step_tolerance,
        max_iterations=max(config.max_iterations, LEAST_ITERATIONS),
        max_rotation_rad=config.max_rotation_step_deg * RAD_PER_DEG,
        min_observability=config.min_observability,
    )
    facets = facet_measure(net, nominal.side)
    if method == "facet":
        return _fitting(facets, centred, settings)
    if method == "xiong":
        surface = nominal.surface
        return _fitting(
            look_up_measure(surface.jet, nominal.side, radius, limits_of(surface)), centred, settings
        )
    if method == "estimated-normals":
        near = _fitting(facets, centred, replace(settings, tolerance=COARSE_TOLERANCE))
        exact = _fitting(smooth_measure(nominal.surface, nominal.side, radius), centred, settings)
        return lambda start, used: _after(near(start, used), exact, used)

    from scipy.spatial import cKDTree  # slow to import

    there, normals = _touched(nominal)
    tree = cKDTree(net.points_mm[there])
    if method == "icp":
        return lambda start, used: point_to_point(centred, tree, start, settings.max_iterations, used)
    return _fitting(tangent_plane_measure(tree, normals), centred, settings)


def _touched(nominal: Nominal) -> tuple[Mask, Array]:
    """Return which nodes the ball touches, and the normals there, frame `surface`."""
    net = nominal.equidistant
    if net is None:
        raise UsageError("the net of the nominal was not loaded")
    there = net.regular if net.reach is None else net.reach <= Reach.EDGE
    return there, nominal.surface_from_part.rotate(net.normals[there])


def _fitting(measure: Measure, centred: Array, settings: FitSettings) -> Run:
    """Return a Gauss-Newton fit (Newton's where the measure has second derivatives) as a run.

    Facets and vertices make kinks where points change their partner: a minimum may lie on one, and no step
    leads down from there.
    """

    def run(start: Placement, used: Mask) -> IcpResult:
        end = fit(measure, centred, start, settings, used=used)
        at_a_kink = measure.hessian is None and end.stop_reason == "no further decrease"
        costs = tuple(look.cost_mm2 for look in end.looks)
        return IcpResult(end.placement, end.iterations, end.stop_reason, end.converged or at_a_kink, costs)

    return run


def _after(first: IcpResult, run: Run, used: Mask) -> IcpResult:
    """Go on from where a run has ended; the iterations of both count."""
    then = run(first.placement, used)
    return then._replace(
        iterations=first.iterations + then.iterations, costs_mm2=first.costs_mm2 + then.costs_mm2
    )


def _settled(run: Run, start: Placement, centred: Array, net: TriangleNet) -> IcpResult:
    """Fit all points, then those that came to lie on the nominal, until these stay the same."""
    used = np.ones(len(centred), dtype=np.bool_)
    end = run(start, used)
    for _ in range(ROUNDS):
        place = moved(centred, end.placement)
        inside = locate(net, place[:, 0], place[:, 1])[1]
        if np.count_nonzero(inside) < MIN_POINTS:
            return end._replace(converged=False, stop_reason="slid off the nominal")
        if np.array_equal(inside, used):
            break
        used = inside
        end = _after(end, run, used)
    return end
