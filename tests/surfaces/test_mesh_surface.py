"""Meshes as nominals: one sheet, its holes, its facets; and patches through the whole first stage."""

from __future__ import annotations

import closed_forms as cf
import numpy as np
import pytest
from scipy.spatial import Delaunay

from cmm_align import io
from cmm_align.errors import GeometryError, MalformedInputError
from cmm_align.numerics.facet_cover import cover_of_cells
from cmm_align.stages.offset import offset
from cmm_align.surfaces.mesh import TriangleMesh, direction_of_mesh, mesh_surface
from cmm_align.surfaces.nurbs import NurbsSurface

BOWL = cf.Sphere(radius_mm=80.0)
TILT = np.array([[0.8, 0.0, 0.6], [0.0, 1.0, 0.0], [-0.6, 0.0, 0.8]])


def disc(hole=0.0, radius=20.0, rings=30):
    """Vertices on rings, triangles between them but for a hole in the middle."""
    r = np.linspace(hole, radius, rings)
    points = [(a * np.cos(t), a * np.sin(t)) for a in r for t in _angles(a)]
    xy = np.array(points)
    triangles = Delaunay(xy).simplices
    middle = xy[triangles].mean(axis=1)
    return xy, triangles[np.hypot(*middle.T) > 0.97 * hole]


def _angles(radius, step=0.7):
    count = max(1, round(2.0 * np.pi * radius / step))
    return 2.0 * np.pi * np.arange(count) / count


def bowl_mesh(hole=0.0, rotation=None):
    xy, triangles = disc(hole)
    points = np.column_stack([xy, BOWL.jet(*xy.T).z])
    return TriangleMesh.of(points if rotation is None else points @ rotation.T, triangles)


def test_the_smooth_surface_of_a_mesh_lies_on_the_part_and_not_on_the_facets(rng):
    mesh = bowl_mesh()
    surface, triangles, misfit = mesh_surface(mesh.points_mm, mesh.triangles, "mesh")
    assert surface.kind == "mesh"
    x, y = 12.0 * (rng.uniform(size=(2, 2000)) - 0.5)
    smooth = np.abs(surface.jet(x, y).z - BOWL.jet(x, y).z).max()
    facet = 0.7**2 / (8.0 * 80.0)  # what a facet of this mesh is off by
    assert smooth <= 1e-3 * facet
    assert misfit <= 1e-3 * facet
    assert len(triangles) == len(mesh.triangles)


@pytest.mark.parametrize("flip", [False, True])
def test_the_triangulation_is_the_mesh_itself_and_runs_counter_clockwise(flip):
    mesh = bowl_mesh()
    given = mesh.triangles[:, ::-1] if flip else mesh.triangles
    _, triangles, _ = mesh_surface(mesh.points_mm, given, "mesh")
    a, b, c = (mesh.points_mm[triangles[:, k], :2] for k in range(3))
    assert ((b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) > (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])).all()
    assert set(map(frozenset, triangles.tolist())) == set(map(frozenset, mesh.triangles.tolist()))


def test_holes_and_the_border_are_those_of_the_mesh(rng):
    mesh = bowl_mesh(hole=6.0)
    surface, _, _ = mesh_surface(mesh.points_mm, mesh.triangles, "mesh")
    x, y = 44.0 * (rng.uniform(size=(2, 20000)) - 0.5)
    r = np.hypot(x, y)
    firm = (np.abs(r - 6.0) > 0.5) & (np.abs(r - 20.0) > 0.5)
    assert (surface.contains(x, y) == ((r > 6.0) & (r < 20.0)))[firm].all()


def test_cells_are_counted_once_for_every_facet_over_them():
    xy = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [0.0, 3.0]])
    triangles = np.array([[0, 1, 2], [0, 2, 3], [0, 1, 2]], dtype=np.int32)
    strictly, touching = cover_of_cells(xy, triangles, np.zeros(2), np.array([1.0, 1.0]), (3, 4))
    assert strictly.tolist() == [[1, 2, 2, 2], [1, 1, 2, 2], [1, 1, 1, 2]]
    assert (touching == strictly).all()


@pytest.mark.parametrize("flip", [False, True])
def test_a_tilted_mesh_is_laid_flat(flip):
    mesh = bowl_mesh(rotation=TILT @ np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]))
    if flip:
        mesh = TriangleMesh.of(mesh.points_mm, mesh.triangles[:, ::-1])
    turn = direction_of_mesh(mesh)
    points = turn.apply(mesh.points_mm)
    surface, _, _ = mesh_surface(points, mesh.triangles, "mesh")
    np.testing.assert_allclose(surface.jet(points[:, 0], points[:, 1]).z, points[:, 2], atol=1e-6)


def both(first, second):
    n = len(first.points_mm)
    return TriangleMesh.of(
        np.vstack([first.points_mm, second.points_mm]), np.vstack([first.triangles, second.triangles + n])
    )


def test_a_mesh_in_pieces_is_refused_with_their_sizes():
    lens = bowl_mesh()
    ring = bowl_mesh(hole=6.0)
    far = TriangleMesh.of(ring.points_mm + 100.0, ring.triangles)
    more, fewer = sorted([len(lens.triangles), len(ring.triangles)])[::-1]
    sizes = rf"2 pieces \({more}, {fewer} facets; one holds x = "
    with pytest.raises(GeometryError, match=sizes):
        offset(both(lens, far), 1.0)


def test_a_closed_body_is_refused():
    lens = bowl_mesh()
    up = lens.points_mm + np.array([0.0, 0.0, 5.0])
    rim = np.hypot(*lens.points_mm[:, :2].T) > 19.99
    up[rim] = lens.points_mm[rim]
    body = both(lens, TriangleMesh(up, lens.triangles[:, ::-1], "body"))
    with pytest.raises(GeometryError, match=r"facets stand upright or face the other way; one .* at x = "):
        offset(body, 1.0)


def test_two_sheets_above_one_another_are_refused():
    """Two bowls that share one facet's corner only: hanging together, facing the same way."""
    lens = bowl_mesh()
    corner = lens.triangles[0, 0]
    upper = lens.points_mm + np.array([0.0, 0.0, 0.5])
    upper[corner] = lens.points_mm[corner]
    with pytest.raises(GeometryError, match=r"2 facets lie above one another at x = .*; expected one sheet"):
        offset(both(lens, TriangleMesh(upper, lens.triangles, "upper")), 1.0)


def test_vertical_walls_are_refused():
    x, y = np.meshgrid(np.linspace(-10.0, 10.0, 21), np.linspace(-10.0, 10.0, 21))
    ridge = np.where(np.abs(x) < 3.5, 4.0, 0.0)
    straight = np.select([x > 3.5, x < -3.5], [x - 1.0, x + 1.0], x)
    triangles = Delaunay(np.column_stack([x.ravel(), y.ravel()])).simplices
    points = np.column_stack([straight.ravel(), y.ravel(), ridge.ravel()])
    with pytest.raises(
        GeometryError, match=r"seen along z, 80 of 800 facets .* is a vertical wall at x = -?3, y = "
    ):
        offset(TriangleMesh.of(points, triangles), 1.0)


def test_a_mesh_of_a_few_vertices_is_refused():
    with pytest.raises(GeometryError, match="a mesh of 3 vertices; expected at least 36"):
        offset(TriangleMesh.of(np.eye(3), [[0, 1, 2]]), 1.0)


FLAT = np.eye(3)


def patch(turned=FLAT):
    """A parabolic bowl as a biquadratic patch with an outline and a hole."""
    u, v = np.meshgrid([0.0, 0.5, 1.0], [0.0, 0.5, 1.0], indexing="ij")
    blossom = np.array([1.0, -1.0, 1.0])  # Bernstein values of (2 t - 1)^2
    z = 2.0 * (blossom[:, None] + blossom[None, :])
    net = np.dstack([40.0 * u - 20.0, 40.0 * v - 20.0, z]) @ turned.T
    t = np.linspace(0.0, 2.0 * np.pi, 300, endpoint=False)
    ring = np.stack([np.cos(t), np.sin(t)], axis=1)
    knots = [0.0] * 3 + [1.0] * 3
    return NurbsSurface.of((2, 2), knots, knots, net, None, [0.5 + 0.45 * ring, 0.5 + 0.1 * ring])


@pytest.mark.parametrize("turned", [np.eye(3), TILT])
def test_a_patch_goes_through_the_first_stage_and_its_file(turned, tmp_path, rng):
    """z = (x^2 + y^2) / 200: the equidistant surface of a paraboloid is known."""
    nominal = offset(patch(turned), 1.5)
    net = nominal.equidistant
    points = net.nominal_points_mm @ turned
    np.testing.assert_allclose(points[:, 2], (points[:, 0] ** 2 + points[:, 1] ** 2) / 200.0, atol=1e-12)
    r = np.hypot(points[:, 0], points[:, 1])
    assert (r > 3.99).all()
    assert (r < 18.01).all()
    slope = np.column_stack([-points[:, 0] / 100.0, -points[:, 1] / 100.0, np.ones(len(points))])
    normal = slope / np.linalg.norm(slope, axis=1, keepdims=True)
    np.testing.assert_allclose(net.normals @ turned, normal, atol=1e-12)
    assert nominal.kind == "nurbs"
    assert nominal.quality.surface_error_pv_nm == 0.0

    io.write(nominal, tmp_path / "nominal.h5")
    back = io.read_nominal(tmp_path / "nominal.h5")
    x, y = rng.uniform(-12.0, 12.0, (2, 100))
    for a, b in zip(back.surface.jet(x, y), nominal.surface.jet(x, y), strict=True):
        np.testing.assert_array_equal(a, b)
    assert (back.surface.contains(x, y) == nominal.surface.contains(x, y)).all()
    assert back.digest == nominal.digest


def test_the_digest_knows_every_number_of_a_patch():
    first, second = patch(), patch()
    assert first.digest() == second.digest()
    moved = NurbsSurface.of(
        (2, 2), first.knots_u, first.knots_v, first.control_mm + 1e-15, None, first.loops_uv
    )
    assert moved.digest() != first.digest()


def test_a_damaged_patch_in_a_file_is_refused(tmp_path):
    import h5py

    io.write(offset(patch(), 1.5), tmp_path / "nominal.h5")
    with h5py.File(tmp_path / "nominal.h5", "r+") as file:
        file["surface/loop_sizes"][0] = 1
    with pytest.raises(MalformedInputError, match=r"nominal\.h5:/surface/loop_sizes"):
        io.read_nominal(tmp_path / "nominal.h5")


def test_a_mesh_goes_through_the_first_stage_and_its_file(tmp_path):
    mesh = bowl_mesh(hole=5.0)
    nominal = offset(mesh, 2.0)
    np.testing.assert_array_equal(np.sort(nominal.equidistant.triangles, 1), np.sort(mesh.triangles, 1))
    assert nominal.kind == "mesh"
    assert 0.0 < nominal.quality.surface_error_pv_nm < 10.0
    centre = np.linalg.norm(nominal.equidistant.points_mm - BOWL.centre, axis=1)
    np.testing.assert_allclose(centre, 78.0, atol=1e-5)
    io.write(nominal, tmp_path / "nominal.h5")
    assert io.read_nominal(tmp_path / "nominal.h5").digest == nominal.digest
