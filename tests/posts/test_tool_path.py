"""Rasters and spirals: every node once, spacings kept, the tool lifted where the part ends."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from truth_corrections import Bowl, Rippled, correction_to

from cmm_align.config import ExportConfig
from cmm_align.errors import UsageError
from cmm_align.numerics.wheel import Wheel, centre_from_contact
from cmm_align.posts.tool_path import raster, spiral

BOWL = Bowl(60.0, 10.0, 6.0)
ROUND = Bowl(60.0, 10.0, 10.0, round=True)


def nodes_only(**settings):
    """Settings that put no points between nodes."""
    return ExportConfig(chord_um=100.0, **settings)


def with_hole(correction):
    hole = np.hypot(*np.meshgrid(correction.x_mm - 3.0, correction.y_mm)) < 2.0
    return replace(correction, commanded_z_mm=np.where(hole, np.nan, correction.commanded_z_mm))


@pytest.mark.parametrize("along", ["x", "y"])
@pytest.mark.parametrize("surface", [BOWL, ROUND], ids=["rectangle", "circle"])
def test_a_raster_takes_every_node_once(surface, along):
    c = with_hole(correction_to(surface, step_mm=0.5))
    path = raster(c, nodes_only(raster_along=along))
    xg, yg = np.meshgrid(c.x_mm, c.y_mm)
    inside = np.isfinite(c.commanded_z_mm)
    expected = np.column_stack([xg[inside], yg[inside], c.commanded_z_mm[inside]])
    np.testing.assert_array_equal(
        path.points_mm[np.lexsort(path.points_mm.T)], expected[np.lexsort(expected.T)]
    )
    assert path.starts[0] == 0
    assert path.lifted[0]
    np.testing.assert_array_equal(path.up, [0.0, 0.0, 1.0])


def test_lines_run_to_and_fro_and_are_joined_without_lifting():
    path = raster(correction_to(BOWL, step_mm=0.5), nodes_only())
    assert path.lifted.tolist() == [True] + 24 * [False]
    direction = np.sign(path.points_mm[path.starts + 1, 0] - path.points_mm[path.starts, 0])
    np.testing.assert_array_equal(direction, np.resize([1.0, -1.0], 25))


def test_no_cutting_move_crosses_a_hole_or_leaves_the_part():
    c = with_hole(correction_to(ROUND, step_mm=0.25))
    for path in (
        raster(c, nodes_only(line_spacing_mm=1.0)),
        spiral(c, nodes_only(line_spacing_mm=1.0)),
    ):
        cutting = np.ones(len(path.points_mm), np.bool_)
        cutting[path.starts[path.lifted]] = False
        middle = 0.5 * (path.points_mm[1:] + path.points_mm[:-1])[cutting[1:]]
        assert np.hypot(middle[:, 0] - 3.0, middle[:, 1]).min() > 1.7
        assert np.hypot(middle[:, 0], middle[:, 1]).max() <= 10.0


def test_spacings_are_never_wider_than_asked_for():
    path = raster(
        correction_to(BOWL, step_mm=0.5),
        nodes_only(line_spacing_mm=1.7, point_spacing_mm=1.2),
    )
    assert np.diff(np.unique(path.points_mm[:, 1])).max() <= 1.7
    assert np.diff(np.unique(path.points_mm[:, 0])).max() <= 1.2
    assert path.points_mm[:, :2].max(axis=0).tolist() == [10.0, 6.0]


def test_a_spiral_has_its_pitch_and_step_and_lies_on_the_surface():
    corrected = Rippled(BOWL, 0.005, 20.0)
    c = correction_to(corrected, BOWL, step_mm=0.5)
    path = spiral(
        c,
        nodes_only(line_spacing_mm=0.7, point_spacing_mm=0.3, spiral_direction="outwards"),
    )
    x, y, z = path.points_mm.T
    radius, angle = np.hypot(x, y), np.unwrap(np.arctan2(y, x))
    first = slice(1, path.starts[1] if len(path.starts) > 1 else None)
    np.testing.assert_allclose(np.diff(radius[first]), 0.7 / (2 * np.pi) * np.diff(angle[first]), atol=1e-9)
    way = np.hypot(np.diff(x[first]), np.diff(y[first]))
    # The chord of an arc of 0.3 mm; near the middle, where the path turns sharply, it is shorter.
    np.testing.assert_allclose(way[10:], 0.3, rtol=0.02)
    jet = corrected.jet(x, y)
    # a spline of degree five: the ripple has 40 steps to a wave, (k h)^6 / 100 of 5 um
    np.testing.assert_allclose(z, jet.z, atol=1e-9)
    inwards = spiral(c, nodes_only(line_spacing_mm=0.7, point_spacing_mm=0.3))
    np.testing.assert_allclose(inwards.points_mm[::-1], path.points_mm, atol=1e-12)


@pytest.mark.parametrize("make", [raster, spiral])
@pytest.mark.parametrize("radius", [-60.0, 100.0], ids=["dome", "bowl"])
def test_chords_of_the_tool_centre_stay_within_the_tolerance(make, radius):
    """Independent of the path: half way between two points, against the sphere of the tool's centres."""
    wheel, bowl = Wheel(30.0), Bowl(radius, 10.0, 6.0)
    path = make(correction_to(bowl, step_mm=1.0), ExportConfig(chord_um=0.1), wheel)
    centres = path.points_mm + centre_from_contact(wheel, path.normals)
    cutting = np.ones(len(centres), np.bool_)
    cutting[path.starts] = False
    middle = 0.5 * (centres[1:] + centres[:-1])[cutting[1:]]
    away = np.linalg.norm(middle - [0.0, 0.0, radius], axis=1) - abs(abs(radius) - np.sign(radius) * 30.0)
    assert 0.02e-3 < np.abs(away).max() <= 0.13e-3  # of steps that grow with the slope, to 1 / cos
    np.testing.assert_allclose(
        np.linalg.norm(path.points_mm - [0.0, 0.0, radius], axis=1), abs(radius), atol=1e-9
    )


@pytest.mark.parametrize(
    ("make", "settings", "words"),
    [
        (raster, {"raster_along": "z"}, "along 'z'"),
        (spiral, {"spiral_direction": "x"}, "a spiral 'x'"),
        (spiral, {"line_spacing_mm": 1e-4, "point_spacing_mm": 1e-4}, "at most 20000000"),
    ],
)
def test_a_path_that_cannot_be_is_refused(make, settings, words):
    with pytest.raises(UsageError, match=words):
        make(correction_to(BOWL), nodes_only(**settings))
