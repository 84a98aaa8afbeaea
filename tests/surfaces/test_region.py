"""Regions of the plane: what a short text means, and the nominal's aperture less a margin."""

from __future__ import annotations

import numpy as np
import pytest
from closed_forms import Sphere
from scipy.spatial import cKDTree

from cmm_align.errors import MalformedInputError, UsageError
from cmm_align.numerics.triangle_net import grid_triangles
from cmm_align.surfaces.margin import RASTER
from cmm_align.surfaces.mesh import mesh_surface
from cmm_align.surfaces.prescription import prescription_from_toml
from cmm_align.surfaces.region import region_from_table, region_from_text
from cmm_align.virtual.window import window

SQUARE = Sphere(20.0, "prescription", 50.0)
TEXTS = {
    # text: words, places inside, places outside
    "circle:0,0,30": ("circle of radius 30 mm about (0, 0)", [(30, 0), (-21, 21)], [(30.1, 0), (22, 22)]),
    "circle: 1cm, -2 , 5mm": ("circle of radius 5 mm about (10, -2)", [(10, 3), (15, -2)], [(0, 0)]),
    "annulus:1,2,3,4": ("annulus of radii 3 and 4 mm about (1, 2)", [(4, 2), (1, 6)], [(1, 2), (5.1, 2)]),
    "Rectangle:0,1,60,4": ("rectangle of 60 x 4 mm about (0, 1)", [(30, 3), (-30, -1)], [(0, 3.1), (31, 1)]),
    "circle:0,0,1in": ("circle of radius 25.4 mm about (0, 0)", [(25.4, 0)], [(25.5, 0)]),
    "rectangle:0,0,600um,2": ("rectangle of 0.6 x 2 mm about (0, 0)", [(0.3, -1)], [(0.31, 0)]),
    "polygon:0,0,4,0,0,4": (
        "polygon of 3 corners within 4 x 4 mm about (2, 2)",
        [(1, 1), (2, 2), (0, 0)],
        [(2.1, 2), (-0.1, 1)],
    ),
}


@pytest.mark.parametrize("text", TEXTS)
def test_a_text_means_what_it_says(text):
    words, inside, outside = TEXTS[text]

    region = region_from_text(text, SQUARE)

    assert region.words == words
    assert region.contains(*np.array(inside, dtype=float).T).all()
    assert not region.contains(*np.array(outside, dtype=float).T).any()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("circel:0,0,3", "did you mean 'circle'"),
        ("", "is no region"),
        ("circle", "0 numbers in circle"),
        ("circle:0,0", "2 numbers in circle:0,0; expected circle:X,Y,R"),
        ("circle:0,0,3,4", "4 numbers"),
        ("circle:0,0,three", "'three' is not a length; expected circle:X,Y,R"),
        ("circle:0,0,3furlong", "unknown unit 'furlong'"),
        ("circle:0,0,0", "radius = 0.0; expected radius > 0"),
        ("circle:0,0,-3", "radius = -3.0"),
        ("annulus:0,0,4,3", "less than outer_radius"),
        ("rectangle:0,0,3,-1", "height = -1.0"),
        ("polygon:0,0,1,1", "4 numbers"),
        ("polygon:0,0,1,1,2", "5 numbers"),
        ("polygon:0,0,1,1,2,2", "no area"),
        ("aperture:2mm", "wider than the nominal; expected aperture:-2mm"),
        ("aperture:-21mm", "leaves nothing"),
        ("aperture:", "0 numbers"),
    ],
)
def test_a_wrong_text_is_refused_with_what_is_right(text, words):
    with pytest.raises(UsageError) as caught:
        region_from_text(text, SQUARE, "--report-region")

    assert str(caught.value).startswith("--report-region: ")
    assert words in caught.value.one_line()


def test_a_table_is_in_its_own_unit():
    table = {"shape": "rectangle", "centre": [1.0, 0.0], "width": 2.0, "height": 1.0}

    region = region_from_table(table, 25.4, where="clear.toml")

    assert region.words == "rectangle of 50.8 x 25.4 mm about (25.4, 0)"
    assert region.contains(np.array([0.0, 50.8, 51.0]), np.array([0.0, 12.7, 0.0])).tolist() == [
        True,
        True,
        False,
    ]
    with pytest.raises(MalformedInputError, match="unknown key 'heigth'"):
        region_from_table({"shape": "rectangle", "width": 2.0, "heigth": 1.0}, where="clear.toml")


def prescription(aperture):
    return prescription_from_toml(
        f'schema = "cmm-align/prescription/1"\nunits = "cm"\n[aperture]\n{aperture}\n'
        '[[term]]\nkind = "conic"\nradius = 90.0\nconic = 0.0\n',
        "p.toml",
    )


def mesh_of_a_ring():
    """A mesh over a square of 40 mm with a square hole of 20 mm."""
    x = np.linspace(-20.0, 20.0, 41)
    px, py = np.meshgrid(x, x)
    known = (np.abs(px) >= 10.0) | (np.abs(py) >= 10.0)
    points = np.stack([px[known], py[known], 1e-3 * px[known] ** 2], axis=1)
    surface, _, _ = mesh_surface(points, grid_triangles(known), "mesh")
    return surface


NOMINALS = {
    # nominal, distance from the border at places inside, radius of its sharpest smooth border
    "square": (SQUARE, lambda x, y: 20.0 - np.maximum(np.abs(x), np.abs(y)), np.inf),
    "circle": (prescription('shape = "circle"\nradius = 2.0'), lambda x, y: 20.0 - np.hypot(x, y), 20.0),
    "annulus": (
        prescription('shape = "annulus"\ninner_radius = 0.5\nouter_radius = 2.0'),
        lambda x, y: np.minimum(20.0 - np.hypot(x, y), np.hypot(x, y) - 5.0),
        5.0,
    ),
    "triangle": (
        prescription('shape = "polygon"\ncorners = [[-2.0, -2.0], [2.0, -2.0], [-2.0, 2.0]]'),
        lambda x, y: np.minimum(np.minimum(x, y) + 20.0, -(x + y) / np.sqrt(2.0)),
        np.inf,
    ),
}


@pytest.mark.parametrize("margin_mm", [0.05, 2.0])
@pytest.mark.parametrize("name", NOMINALS)
def test_a_margin_keeps_its_distance_from_the_border(rng, name, margin_mm):
    surface, room, sharpest = NOMINALS[name]
    x, y = rng.uniform(-20.5, 20.5, (2, 40_000))
    step = 40.0 / RASTER

    region = region_from_text(f"aperture:-{1000 * margin_mm:g}um", surface)

    assert region.words == f"the aperture less {margin_mm:g} mm all round"
    wrong = region.contains(x, y) != (room(x, y) >= margin_mm)
    # The border is drawn with straight pieces of up to sqrt(2) steps: off by their sagitta.
    allowed = 2.0 * step**2 / (8.0 * sharpest) + 1e-9
    if margin_mm > 2.0 * step:  # nearer to a corner than that, it is cut off by less than a step
        assert np.abs(room(x, y)[wrong] - margin_mm).max(initial=0.0) <= allowed
    assert np.abs(room(x, y)[wrong] - margin_mm).max(initial=0.0) <= step


def test_a_margin_of_a_mesh_is_kept_from_its_hole_too(rng):
    surface = mesh_of_a_ring()
    raster_mm, step = 0.05, 40.0 / RASTER
    fine = np.arange(-21.0, 21.0, raster_mm)
    px, py = (p.ravel() for p in np.meshgrid(fine, fine))
    outside = ~surface.contains(px, py)
    x, y = rng.uniform(-20.0, 20.0, (2, 5000))
    away = cKDTree(np.stack([px[outside], py[outside]], axis=1)).query(np.stack([x, y], axis=1))[0]
    away *= surface.contains(x, y)

    inside = region_from_text("aperture:-2mm", surface).contains(x, y)

    assert inside[away >= 2.0 + step + raster_mm].all()
    assert not inside[away < 2.0 - step - raster_mm].any()
    assert 0.3 < inside.mean() < 0.8


def test_no_margin_is_the_whole_aperture():
    region = region_from_text("aperture:-0mm", SQUARE)

    assert region.words == "the whole aperture"
    assert region.contains(np.array([20.0, 20.1]), np.zeros(2)).tolist() == [True, False]


@pytest.mark.parametrize(
    "text",
    ["circle:1,2,3mm", "annulus:0,0,5,10", "rectangle:1,2,30,20", "polygon:0,0,30,0,0,0.02m", "aperture:-2"],
)
def test_a_region_knows_itself_as_text(rng, text):
    surface = window()
    region = region_from_text(text, surface)
    again = region_from_text(region.text, surface)
    x, y = rng.uniform(-60, 60, 5000), rng.uniform(-40, 40, 5000)
    assert np.array_equal(again.contains(x, y), region.contains(x, y))
    assert (again.words, again.text) == (region.words, region.text)
