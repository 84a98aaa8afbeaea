"""Continuing a field: what it reproduces, and that it has no kink."""

import numpy as np
import pytest

from cmm_align.errors import GeometryError
from cmm_align.numerics import smooth_extension
from cmm_align.numerics.grid_field import continued
from cmm_align.numerics.smooth_extension import extended


def wavy(ny=40, nx=60):
    x, y = np.meshgrid(np.linspace(-30.0, 30.0, nx), np.linspace(-20.0, 20.0, ny))
    return x, y, 10.0 * np.cos(x / 9.0) * np.cos(y / 7.0)


def test_without_tension_a_plane_is_carried_on_exactly_and_known_nodes_stay():
    x, y, _ = wavy()
    plane = 1.0 + 0.3 * x - 0.2 * y
    holed = np.where((np.abs(x) > 22.0) | (np.hypot(x, y) < 6.0), np.nan, plane)
    result = extended(holed, 1e9)
    np.testing.assert_allclose(result, plane, atol=1e-6)
    known = np.isfinite(holed)
    np.testing.assert_array_equal(result[known], plane[known])


def test_a_hole_is_bridged_far_better_than_by_a_membrane():
    x, y, field = wavy()
    hole = np.hypot(x - 4.0, y) < 5.0
    holed = np.where(hole, np.nan, field)
    plate, membrane = (np.abs(f - field)[hole].max() for f in (extended(holed, 20.0), continued(holed)))
    assert plate < 0.2 * membrane


def test_the_border_has_no_kink():
    x, _, field = wavy()
    holed = np.where(x > 15.0, np.nan, field)
    bend = np.abs(np.diff(extended(holed, 10.0), 2, axis=1)).max()
    assert bend < 3.0 * np.abs(np.diff(field, 2, axis=1)).max()
    assert bend < 0.5 * np.abs(np.diff(continued(holed), 2, axis=1)).max()


def test_by_way_of_a_coarser_grid_the_same_comes_out(monkeypatch):
    x, y, field = wavy()
    holed = np.where((np.abs(y) > 14.0) | (np.hypot(x, y) < 6.0), np.nan, field)
    direct = extended(holed, 8.0)
    monkeypatch.setattr(smooth_extension, "MOST_DIRECT", 50)
    assert np.abs(extended(holed, 8.0) - direct).max() < 0.02 * np.ptp(field)


def test_nothing_known_is_refused_and_nothing_unknown_is_returned():
    _, _, field = wavy()
    np.testing.assert_array_equal(extended(field, 5.0), field)
    with pytest.raises(GeometryError, match="without a single value"):
        extended(np.full((4, 5), np.nan), 5.0)
