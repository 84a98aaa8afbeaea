"""The demo window is what the demo says it is."""

from __future__ import annotations

import numpy as np

from cmm_align.surfaces.geometry import principal_curvatures, slope, unit_normal
from cmm_align.virtual.window import HEIGHT_MM, TIP_RADIUS_MM, WIDTH_MM, window, window_grid

SIDE = 1


def places(step_mm: float = 0.5) -> tuple[np.ndarray, np.ndarray]:
    grid = window_grid(step_mm)
    return grid[:, 0], grid[:, 1]


def test_size_is_102_by_62() -> None:
    bounds = window().bounds

    assert bounds.x_max - bounds.x_min == WIDTH_MM == 102.0
    assert bounds.y_max - bounds.y_min == HEIGHT_MM == 62.0


def test_steepest_slope_is_about_45_degrees() -> None:
    steepest_deg = np.degrees(np.arctan(slope(window().jet(*places())).max()))

    assert 44.0 < steepest_deg < 47.0


def test_the_ball_fits_everywhere() -> None:
    most = principal_curvatures(window().jet(*places()), SIDE).most.max()

    assert TIP_RADIUS_MM * most < 0.5


def test_all_six_motions_leave_a_trace() -> None:
    x, y = places(2.0)
    jet = window().jet(x, y)
    normals = unit_normal(jet, SIDE)
    points = np.column_stack([x, y, jet.z])
    arms = (points - points.mean(axis=0)) / WIDTH_MM
    rows = np.hstack([np.cross(arms, normals), normals])
    singular = np.linalg.svd(rows / np.sqrt(len(rows)), compute_uv=False)

    assert singular[-1] > 1e-3 * singular[0]


def test_the_grid_lies_on_the_window_and_reaches_its_border() -> None:
    grid = window_grid(1.0)

    assert grid.shape == (103 * 63, 3)
    assert (grid[:, 0].min(), grid[:, 0].max()) == (-51.0, 51.0)
    np.testing.assert_array_equal(window().jet(grid[:, 0], grid[:, 1]).z, grid[:, 2])
