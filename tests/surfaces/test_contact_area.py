"""Areas of foot points: a quadrature over the measured part of the surface, however it was scanned."""

from __future__ import annotations

import numpy as np
import pytest
from closed_forms import Plane, Sphere
from relations import permuted
from scipy.spatial import cKDTree

from cmm_align.errors import GeometryError
from cmm_align.surfaces.contact_area import contact_areas
from cmm_align.surfaces.geometry import unit_normal

WIDTH_MM, HEIGHT_MM = 10.0, 6.0
MEAN_OF_X_SQUARED = WIDTH_MM**2 / 3.0


def flat(xy):
    """Areas of feet on a plane across the projection direction."""
    return contact_areas(xy[:, 0], xy[:, 1], np.tile([0.0, 0.0, 1.0], (len(xy), 1)))


def grid(nx, ny):
    """Feet on a grid over the rectangle, border included."""
    x, y = np.linspace(0.0, WIDTH_MM, nx), np.linspace(0.0, HEIGHT_MM, ny)
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def turned(xy, angle_rad):
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return xy @ np.array([[c, s], [-s, c]])


def rings(n_rings, n_spokes, radius_mm):
    """Feet on rings about a middle, far denser inside than outside."""
    r = radius_mm * (np.arange(1, n_rings + 1) / n_rings) ** 2
    phi = 2.0 * np.pi * np.arange(n_spokes) / n_spokes
    x, y = r[:, None] * np.cos(phi), r[:, None] * np.sin(phi)
    return np.concatenate([[[0.0, 0.0]], np.stack([x.ravel(), y.ravel()], axis=1)])


def uneven(rng, kind):
    """The rectangle scanned unevenly, the radius of the widest circle without a foot, and the scatter, mm."""
    sparse, line, fine = grid(11, 7), grid(201, 13), grid(101, 61)
    patch = rng.uniform([6.0, 2.0], [9.0, 5.0], (5000, 2))
    again, thrice = line + rng.normal(0.0, 0.01, line.shape), np.repeat(grid(21, 13), 3, axis=0)
    return {
        "patch in a sparse grid": (np.concatenate([sparse, patch]), np.sqrt(0.5), 0.0),
        "scan lines": (line, 0.26, 0.0),
        "lines scanned twice": (np.concatenate([line, again]), 0.26, 0.01),
        "touched three times": (thrice + rng.normal(0.0, 1e-3, thrice.shape), 0.36, 1e-3),
        "one half dense": (np.concatenate([sparse, fine[fine[:, 0] > 5.0]]), np.sqrt(0.5), 0.0),
    }[kind]


KINDS = (
    "patch in a sparse grid",
    "scan lines",
    "lines scanned twice",
    "touched three times",
    "one half dense",
)


@pytest.mark.parametrize("angle_rad", [0.0, 0.3])
def test_an_even_grid_has_the_areas_of_the_trapezoidal_rule(angle_rad):
    nx, ny = 21, 13
    ends = np.ones(nx), np.ones(ny)
    for end in ends:
        end[[0, -1]] = 0.5
    expected = 0.25 * np.outer(ends[1], ends[0]).ravel()

    found = flat(turned(grid(nx, ny), angle_rad))

    np.testing.assert_allclose(found, expected, rtol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_a_mean_over_an_uneven_scan_is_not_biased(rng, kind):
    xy, circle_mm, scatter_mm = uneven(rng, kind)
    f = xy[:, 0] ** 2
    outline = 4.0 * scatter_mm  # as far as the outline may stand out, or in, all along

    areas = flat(xy)

    assert (areas > 0.0).all()
    assert areas.sum() == pytest.approx(60.0, rel=1e-12, abs=outline * 2 * (WIDTH_MM + HEIGHT_MM))
    # Linear interpolation is off by R^2/2 times the second derivative (2) in a circle of radius R. Where the
    # rectangle is longer by a piece, what is there counts with its length over the whole one.
    allowed = circle_mm**2 + outline * (WIDTH_MM**2 - MEAN_OF_X_SQUARED) / WIDTH_MM
    assert np.sum(areas * f) / areas.sum() == pytest.approx(MEAN_OF_X_SQUARED, abs=allowed)


def test_the_area_of_a_point_is_that_of_all_that_is_nearer_to_it_than_to_others(rng):
    xy, circle_mm, _ = uneven(rng, "patch in a sparse grid")
    raster_mm = 0.01
    x, y = np.arange(0.5 * raster_mm, WIDTH_MM, raster_mm), np.arange(0.5 * raster_mm, HEIGHT_MM, raster_mm)
    nearest = cKDTree(xy).query(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2))[1]
    counted = np.bincount(nearest, minlength=len(xy)) * raster_mm**2

    # Squares on the border of a cell are counted on one side; the border is shorter than that of the circle
    # around the cell. Two places of the patch may be one (less than a hundredth of the mean distance apart).
    np.testing.assert_allclose(flat(xy), counted, atol=raster_mm * 2.0 * np.pi * circle_mm)


def test_the_plain_mean_is_biased_by_what_the_patch_adds(rng):
    sparse, patch = grid(21, 13), rng.uniform([6.0, 2.0], [9.0, 5.0], (20_000, 2))
    xy = np.concatenate([sparse, patch])
    areas = flat(xy)
    of_patch = (9.0**3 - 6.0**3) / (3.0 * 3.0)
    of_grid = np.mean(sparse[:, 0] ** 2)
    share = len(patch) / len(xy)
    expected = share * (of_patch - MEAN_OF_X_SQUARED) + (1.0 - share) * (of_grid - MEAN_OF_X_SQUARED)

    plain = np.mean(xy[:, 0] ** 2) - MEAN_OF_X_SQUARED
    weighted = np.sum(areas * xy[:, 0] ** 2) / areas.sum() - MEAN_OF_X_SQUARED

    # The mean of x^2 over 20 000 random places has sigma 13 / sqrt(20 000).
    assert plain == pytest.approx(expected, abs=4.0 * 13.0 / np.sqrt(20_000))
    assert expected > 20.0
    assert abs(weighted) < 0.125  # R^2 of the grid of 0.5 mm


def test_a_cap_of_a_sphere_converges_to_its_area_and_mean_height():
    bowl, radius_mm = Sphere(20.0, "prescription", 50.0), 30.0
    height = 50.0 - np.sqrt(50.0**2 - radius_mm**2)
    area = 2.0 * np.pi * 50.0 * height
    errors = []
    for n in (20, 40, 80):
        x, y = rings(n, 3 * n, radius_mm).T
        jet = bowl.jet(x, y)
        found = contact_areas(x, y, unit_normal(jet, -1))
        mean = np.sum(found * jet.z) / found.sum()  # equal slices of a sphere have equal areas: half way up
        errors.append((abs(found.sum() / area - 1.0), abs(mean / (0.5 * height) - 1.0)))

    ratios = np.array(errors[:-1]) / np.array(errors[1:])
    assert max(errors[-1]) < 2e-3
    assert ratios.min() > 3.0  # second order: 4


def test_a_tilted_plane_has_the_area_of_the_plane_not_of_its_shadow():
    x, y = grid(15, 9).T
    jet = Plane(20.0, "prescription", 0.7, -0.4).jet(x, y)

    found = contact_areas(x, y, unit_normal(jet, 1))

    assert found.sum() == pytest.approx(60.0 * np.sqrt(1.0 + 0.7**2 + 0.4**2), rel=1e-12)


@pytest.mark.parametrize("kind", [*KINDS, "rings"])
def test_the_order_of_the_points_changes_nothing(rng, kind):
    xy = rings(12, 30, 10.0) if kind == "rings" else uneven(rng, kind)[0]
    shuffled, order = permuted(xy, rng)

    # On rings and grids the triangulation is a matter of chance, and the areas are not.
    np.testing.assert_allclose(flat(shuffled), flat(xy)[order], rtol=1e-6)


def test_a_shift_changes_nothing_and_a_scale_goes_in_squared(rng):
    xy = rng.uniform(0.0, 10.0, (500, 2))
    areas = flat(xy)

    np.testing.assert_allclose(flat(xy + np.array([300.0, -200.0])), areas, rtol=1e-8)
    np.testing.assert_allclose(flat(25.0 * xy), 625.0 * areas, rtol=1e-8)


def test_points_in_one_place_share_its_area(rng):
    xy = rng.uniform(0.0, 10.0, (300, 2))
    copies = rng.integers(1, 5, 300)
    single = flat(xy)

    found = flat(np.repeat(xy, copies, axis=0))

    np.testing.assert_allclose(found, np.repeat(single / copies, copies), rtol=1e-8)


def test_a_wide_hole_belongs_to_nobody_and_a_missing_point_to_its_neighbours():
    nodes, step = grid(101, 61), 0.1
    away = np.hypot(nodes[:, 0] - 5.0, nodes[:, 1] - 3.0)
    holed, pricked = flat(nodes[away > 1.5]), flat(nodes[away > 0.5 * step])

    # The rim follows the grid: half a step more or less all round.
    assert holed.sum() == pytest.approx(60.0 - np.pi * 1.5**2, abs=0.5 * step * 2.0 * np.pi * 1.5)
    assert holed.max() < 2.0 * step**2
    assert pricked.sum() == pytest.approx(60.0, rel=1e-12)


def test_a_ring_has_no_area_inside_and_a_bay_none_outside():
    r, phi = np.meshgrid(np.linspace(9.0, 10.0, 6), np.linspace(0.0, 1.5 * np.pi, 240))
    arc = np.stack([(r * np.cos(phi)).ravel(), (r * np.sin(phi)).ravel()], axis=1)

    # The outer chord is inside its arc by half a width cubed over 12 radii; the two ends are straight.
    assert flat(arc).sum() == pytest.approx(0.75 * np.pi * (10.0**2 - 9.0**2), rel=5e-3)


def test_a_lone_point_in_a_hole_stands_for_what_is_around_it():
    nodes = grid(51, 31)
    around = nodes[np.hypot(nodes[:, 0] - 5.0, nodes[:, 1] - 3.0) > 2.0]

    areas = flat(np.concatenate([around, [[5.0, 3.0]]]))

    assert (areas > 0.0).all()
    assert areas.sum() == pytest.approx(60.0, rel=1e-12)
    # Nearer to it than to the rim: about a disc of half its radius, which is 2 mm to 2 mm and a step.
    assert np.pi * 1.0**2 < areas[-1] < np.pi * 1.1**2 * (4.0 / np.pi)
    assert areas.argmax() == len(around)


def test_boxes_of_many_points_keep_the_quadrature(rng):
    xy = np.concatenate([grid(201, 121), rng.uniform([6.0, 2.0], [9.0, 5.0], (20_000, 2))])
    up = np.tile([0.0, 0.0, 1.0], (len(xy), 1))
    most = 2000
    box_mm = np.sqrt(60.0 / most)

    areas = contact_areas(xy[:, 0], xy[:, 1], up, most_places=most)

    assert (areas > 0.0).all()
    # Places are the middles of what their boxes hold: the outline draws in by less than half a box.
    assert areas.sum() == pytest.approx(60.0, abs=0.5 * box_mm * 32.0)
    inside = np.sum(areas * (xy[:, 0] - 5.0) ** 2) / areas.sum()
    assert inside == pytest.approx(WIDTH_MM**2 / 12.0, rel=2.0 * box_mm / WIDTH_MM + box_mm**2)


@pytest.mark.parametrize(
    ("xy", "words"),
    [
        ([[0.0, 0.0], [1.0, 1.0], [np.nan, 2.0], [3.0, 1.0]], "not finite"),
        ([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [3.0, 0.0]], "one line"),
        ([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0], [4.0, 4.0]], "one line"),
        ([[1.0, 2.0]] * 5, "one line"),
    ],
)
def test_points_without_area_are_refused(xy, words):
    with pytest.raises(GeometryError, match=words):
        flat(np.array(xy))
