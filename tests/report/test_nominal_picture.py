"""The maps of a nominal and its plan: drawn for every kind of surface, the same bytes each time."""

from dataclasses import replace

import numpy as np
import pytest

from cmm_align.model import PointKind, PointSet
from cmm_align.report.nominal_picture import draw_nominal
from cmm_align.report.plan_picture import draw_plan
from cmm_align.stages.offset import offset
from cmm_align.surfaces.prescription import prescription_from_toml
from cmm_align.virtual.window import window

PLANE = """
schema = "cmm-align/prescription/1"
units = "mm"
[aperture]
shape = "annulus"
outer_radius = 20.0
inner_radius = 6.0
[[term]]
kind = "xy_polynomial"
coefficients = { "1,0" = 0.1 }
"""


def groove():
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(-6, 6, 61), np.linspace(-4, 4, 41)))
    z = -0.8 * np.exp(-((x / 0.9) ** 2))
    return PointSet.of(np.stack([x, y, z], axis=1), kind=PointKind.NOMINAL, frame="part")


@pytest.mark.parametrize(
    "source",
    [window(), prescription_from_toml(PLANE, "plane.toml"), groove()],
    ids=["window", "plane ring", "groove"],
)
def test_maps_are_drawn_and_the_same_each_time(source, tmp_path):
    nominal = offset(source, 1.5)

    draw_nominal(nominal, tmp_path / "a.png", "A $ title")
    draw_nominal(nominal, tmp_path / "b.png", "A $ title")

    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")


def test_a_nominal_of_an_older_file_is_drawn_too(tmp_path):
    nominal = offset(groove(), 1.5)
    old = replace(nominal.equidistant, reach=None, least_curvature_per_mm=None, feature=None)

    draw_nominal(replace(nominal, equidistant=old, quality=None), tmp_path / "old.png")
    draw_nominal(replace(nominal, equidistant=None), tmp_path / "lean.png")

    assert (tmp_path / "old.png").stat().st_size > 20_000
    assert (tmp_path / "lean.png").stat().st_size > 20_000


def test_a_plan_is_drawn(tmp_path):
    nominal = offset(window(), 1.5)
    places = np.random.default_rng(1).uniform(-30, 30, (500, 2))

    draw_plan(nominal, places, places[:, 0] > 20.0, [("points", "500")], tmp_path / "p.png")

    assert (tmp_path / "p.png").read_bytes().startswith(b"\x89PNG")
