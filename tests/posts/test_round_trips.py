"""Every export is read back from its file and rebuilt: the points lie on the surface that was commanded."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from truth_corrections import ON_ITS_SIDE, Bowl, Rippled, correction_to
from truth_maps import Quadric

from cmm_align import posts
from cmm_align.config import ExportConfig
from cmm_align.numerics.wheel import Wheel
from cmm_align.posts.template import template_of
from cmm_align.surfaces.geometry import unit_normal

NM = 1e-6
FLAT = Quadric(20.0, 15.0, c=1e-4, d=-2e-4)
STEEP = Quadric(20.0, 15.0, a=1.0, c=0.002)
"""42 to 47 degrees."""
CASES = {
    "flat": (FLAT, 1, None),
    "steep": (STEEP, 1, None),
    "-z": (Bowl(-60.0), -1, None),
    "bowl on its side": (Bowl(70.0), 1, ON_ITS_SIDE),
    "round": (Bowl(60.0, 16.0, 16.0, round=True), 1, None),
}
SPHERE = Wheel(40.0)
TORUS = Wheel(40.0, 8.0, (0.0, 1.0, 0.0))
TEMPLATE = {
    "schema": "cmm-align/post/1",
    "header": "# {name}; {points} points; {units}\n",
    "line": "{n}; {x}; {y}; {z}; {i}; {j}; {k}",
    "decimal_sign": ",",
    "footer": "END\n",
    "line_ending": "crlf",
}


@pytest.fixture(params=CASES, ids=list(CASES))
def case(request):
    surface, side, turn = CASES[request.param]
    corrected = Rippled(surface, 0.005, 20.0)
    return corrected, correction_to(corrected, surface, side=side, surface_from_part=turn)


def off_surface_mm(corrected, correction, found):
    """How far points are off the commanded surface in closed form, along its normal, and their normals."""
    turn = correction.nominal.surface_from_part
    at_home = found.frame == "surface"
    x, y, z = (found.points_mm if at_home else turn.apply(found.points_mm)).T
    jet = corrected.jet(x, y)
    n = unit_normal(jet, correction.nominal.side)
    normals = None
    if found.normals is not None:
        normals = (found.normals if at_home else turn.rotate(found.normals)) - n
    return (z - jet.z) * n[:, 2], normals


def written(tmp_path, name, correction, wheel=None, post=None, **settings) -> Path:
    path = tmp_path / f"part{posts.suffix_of(name, post)}"
    job = posts.ExportJob(
        correction, ExportConfig(**{"chord_um": 100.0} | settings), wheel=wheel, name="my part"
    )
    posts.write_export(path, name, job, post)
    return path


@pytest.mark.parametrize("name", ["xyz", "xyzijk", "zemax", "heidenhain", "template"])
def test_points_come_back_within_a_nanometre(tmp_path, case, name):
    corrected, correction = case
    post = template_of(TEMPLATE, "post.toml") if name == "template" else None
    path = written(tmp_path, name, correction, post=post)
    found = posts.read_back(path, name, post=post)
    assert len(found.points_mm) == np.isfinite(correction.commanded_z_mm).sum()
    assert found.frame == ("surface" if name == "zemax" else "part")
    off, normals = off_surface_mm(corrected, correction, found)
    assert found.accuracy_mm <= 1.0 * NM
    assert np.abs(off).max() <= found.accuracy_mm + 1e-12
    if name not in {"xyz", "zemax"}:  # 500 mm is the wheel that is provided for
        assert 500.0 * np.linalg.norm(normals, axis=1).max() <= 1.0 * NM


@pytest.mark.parametrize("wheel", [SPHERE, TORUS], ids=["sphere", "torus"])
@pytest.mark.parametrize("name", ["gcode-raster", "gcode-spiral"])
def test_the_wheel_is_taken_off_again(tmp_path, case, name, wheel):
    corrected, correction = case
    if wheel is TORUS and correction.nominal.surface_from_part.rotation[0, 0] == 0.0:
        wheel = replace(TORUS, axis=(0.0, 0.0, 1.0))
    path = written(tmp_path, name, correction, wheel)
    found = posts.read_back(path, name, wheel)
    off, normals = off_surface_mm(corrected, correction, found)
    # past the last nodes of a round aperture a spiral knows the ripple as far as a parabola does
    parabola = 0.005 * (2.0 * np.pi / 20.0 * 0.5) ** 3 if name == "gcode-spiral" else 0.0
    assert np.abs(off).max() <= found.accuracy_mm + parabola
    assert found.accuracy_mm <= 25.0 * NM
    assert np.abs(normals).max() <= 1e-3


@pytest.mark.parametrize("name", ["gcode-raster", "gcode-spiral"])
def test_lines_far_apart_with_points_close_together_come_back(tmp_path, name):
    """A coarse map: lines of 1.5 mm, points between the nodes for chords of 0.1 um."""
    bowl = Bowl(-120.0, 24.0, 18.0)
    corrected = Rippled(bowl, 0.005, 30.0)
    correction = correction_to(corrected, bowl, step_mm=1.5)
    path = written(tmp_path, name, correction, SPHERE, chord_um=0.1)
    found = posts.read_back(path, name, SPHERE)
    off, _ = off_surface_mm(corrected, correction, found)
    # between nodes: a spline of degree five, 20 steps to a wave, (k h)^6 / 100 of 5 um
    assert np.abs(off).max() <= found.accuracy_mm + 0.05 * NM
    assert found.accuracy_mm <= 25.0 * NM
