"""The part on the grinder: what a wrong seat costs, and the pose from a few touches."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from truth_maps import WINDOW, Quadric, aligned, form_error_mm, random_places

from cmm_align.errors import GeometryError, NumericsError
from cmm_align.model import PointKind, PointSet
from cmm_align.pose import Pose, rotation_from_vector
from cmm_align.stages.compensate import compensate
from cmm_align.stages.error_map import error_map
from cmm_align.stages.remount import ARCSEC_RAD, remount_sensitivity
from cmm_align.stages.seat import placed, refuse_unknown, seat_of
from cmm_align.surfaces.geometry import unit_normal

POSE = Pose(
    rotation_from_vector(np.array([0.02, -0.03, 0.05])), np.array([120.0, -40.0, 35.0]), "machine", "part"
)
RADIUS_MM = 2.5
BOWL = Quadric(30.0, 30.0, c=0.01, d=0.01, round=True)


def measured(surface, form):
    return error_map(aligned(surface, form, random_places(surface, 4000), noise_mm=1e-5))


@pytest.fixture(scope="module")
def window():
    deviation_map = measured(WINDOW, form_error_mm)
    return deviation_map, compensate(deviation_map)


def touched(surface, form, *, n=12, noise_mm=0.0, bump_mm=0.0, pose=POSE, radius_mm=RADIUS_MM):
    """Touches on an uneven net over the part, in the frame of the grinder."""
    rng = np.random.default_rng(5)
    u = np.array([(i, j) for i in (-0.8, -0.3, 0.25, 0.75) for j in (-0.7, 0.05, 0.65)])[:n]
    x, y = (u + rng.uniform(-0.05, 0.05, u.shape)).T * 0.9 * np.array([[surface.half_x], [surface.half_y]])
    if surface.round:
        x, y = 0.75 * x, 0.75 * y
    jet = surface.jet(x, y)
    off = radius_mm + form(x, y) + noise_mm * rng.standard_normal(len(x))
    off[4] += bump_mm
    points = np.column_stack([x, y, jet.z]) + off[:, None] * unit_normal(jet, 1)
    return PointSet.of(pose.apply(points), kind=PointKind.TIP_CENTRE, source="touches.csv")


def displaced_mm(seat, surface):
    """How far points of the part lie off their place along the normal, with the pose that was found."""
    found = Pose.from_matrix(np.array(seat.grinder_from_part), "machine", "part")
    x, y = random_places(surface, 500)
    jet = surface.jet(x, y)
    points = np.column_stack([x, y, jet.z])
    return np.einsum("ij,ij->i", POSE.inverse().apply(found.apply(points)) - points, unit_normal(jet, 1))


def test_a_known_pose_comes_back_and_form_error_does_not_move_it(window):
    deviation_map, correction = window
    seat = seat_of(touched(WINDOW, form_error_mm), RADIUS_MM, deviation_map, correction)
    assert seat.held == ()
    assert seat.doubtful == ()
    # The form error has a PV of 25 um; what is left is that of the map between its nodes.
    assert np.abs(displaced_mm(seat, WINDOW)).max() < 5e-4
    assert seat.rms_mm < 2e-4


def test_the_edge_is_known_as_well_as_is_said(window):
    deviation_map, correction = window
    off, said = [], []
    for shift in range(6):
        touches = touched(WINDOW, form_error_mm, noise_mm=0.002)
        noise = 0.002 * np.random.default_rng(shift).standard_normal(touches.points_mm.shape)
        seat = seat_of(
            PointSet.of(touches.points_mm + noise, kind=PointKind.TIP_CENTRE),
            RADIUS_MM,
            deviation_map,
            correction,
        )
        off.append(np.abs(displaced_mm(seat, WINDOW)).max())
        said.append(seat.u_edge_mm)
    assert max(off) < 2.0 * max(said)
    assert np.mean(off) > 0.1 * np.mean(said)


def test_a_bump_on_one_touch_is_told(window):
    deviation_map, correction = window
    touches = touched(WINDOW, form_error_mm, noise_mm=0.0005, bump_mm=0.05)
    seat = seat_of(touches, RADIUS_MM, deviation_map, correction)
    assert seat.doubtful[0].number == 5
    assert seat.doubtful[0].off_mm == pytest.approx(0.05, rel=0.1)
    assert len(seat.doubtful) == 1


def test_too_few_touches_and_touches_of_something_else_are_refused(window):
    deviation_map, correction = window
    touches = touched(WINDOW, form_error_mm, n=6)
    with pytest.raises(GeometryError, match="7 or more"):
        seat_of(touches, RADIUS_MM, deviation_map, correction)
    junk = PointSet.of(np.random.default_rng(1).uniform(-40.0, 40.0, (9, 3)), kind=PointKind.TIP_CENTRE)
    with pytest.raises((NumericsError, GeometryError)):
        seat_of(junk, RADIUS_MM, deviation_map, correction)


def symmetric(x, y):
    return 0.004 * np.cos(0.15 * np.hypot(x, y))


def skew(x, y):
    return 0.004 * np.cos(0.15 * x)


@pytest.mark.parametrize(("form", "matters"), [(symmetric, False), (skew, True)])
def test_of_a_round_part_clocking_is_held_told_and_refused_where_it_matters(form, matters):
    deviation_map = measured(BOWL, form)
    correction = compensate(deviation_map)
    level = Pose(np.eye(3), np.array([5.0, -4.0, 30.0]), "machine", "part")
    seat = seat_of(touched(BOWL, form, pose=level), RADIUS_MM, deviation_map, correction)
    assert len(seat.held) == 1
    assert "rotation" in seat.held[0]
    found = Pose.from_matrix(np.array(seat.grinder_from_part), "machine", "part")
    assert abs(found.rotation_vector_rad()[2]) < 1e-6
    if matters:
        with pytest.raises(GeometryError, match="cannot tell"):
            refuse_unknown(seat, correction, "touches.csv")
    else:
        refuse_unknown(seat, correction, "touches.csv")


def test_what_is_placed_lies_where_the_part_lies(window):
    deviation_map, correction = window
    seat = seat_of(touched(WINDOW, form_error_mm), RADIUS_MM, deviation_map, correction)
    there = placed(correction, seat).nominal.surface_from_part
    assert (there.target, there.source) == ("surface", "grinder")
    points = np.array([[10.0, 5.0, 2.0], [-3.0, 7.0, 1.0]])
    grinder = Pose.from_matrix(np.array(seat.grinder_from_part), "grinder", "part").apply(points)
    np.testing.assert_allclose(there.apply(grinder), points, atol=1e-10)


def test_a_wrong_seat_costs_what_the_closed_form_says():
    nominal = replace(aligned(BOWL, symmetric, random_places(BOWL, 10)).nominal)
    by = {one.motion: one for one in remount_sensitivity(nominal)}
    slope = 0.02 * 30.0  # at the edge
    sine = slope / np.hypot(1.0, slope)
    assert by["decentre x"].pv_um == pytest.approx(2.0 * sine, rel=1e-3)
    assert by["decentre y"].max_um in (pytest.approx(sine, rel=1e-3), pytest.approx(-sine, rel=1e-3))
    assert by["height z"].pv_um == pytest.approx(1.0 - 1.0 / np.hypot(1.0, slope), rel=1e-3)
    assert by["clocking about z"].pv_um == pytest.approx(0.0, abs=1e-9)
    # Independent: turn the points about the middle and see how far they leave the surface.
    one = by["tilt about x"]
    x, y = np.meshgrid(np.linspace(-30.0, 30.0, 201), np.linspace(-30.0, 30.0, 201))
    inside = BOWL.contains(x, y)
    x, y = x[inside], y[inside]
    points = np.column_stack([x, y, BOWL.jet(x, y).z])
    turned = Pose(rotation_from_vector(np.array([ARCSEC_RAD * 100.0, 0.0, 0.0])), np.zeros(3), "part", "part")
    moved = turned.apply(points - points.mean(axis=0)) + points.mean(axis=0)
    jet = BOWL.jet(moved[:, 0], moved[:, 1])
    e = (moved[:, 2] - jet.z) * unit_normal(jet, 1)[:, 2] * 10.0  # um for 1 arcsec
    assert one.pv_um == pytest.approx(np.ptp(e), rel=2e-3)
