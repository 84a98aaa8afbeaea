"""Meshes of every kind come back with their vertices merged; damage is named."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from cmm_align import files
from cmm_align.errors import InputError, MalformedInputError, UsageError, WrongStageError
from cmm_align.surfaces.mesh import TriangleMesh


def height(x, y):
    return 0.01 * x * x - 0.005 * y * y + 1e-3 * x * y


def net(nx=9, ny=7, step=2.0):
    """Vertices of a saddle on a grid and two triangles a cell."""
    x, y = np.meshgrid(step * (np.arange(nx) - 0.5 * (nx - 1)), step * (np.arange(ny) - 0.5 * (ny - 1)))
    k = (np.arange(ny - 1)[:, None] * nx + np.arange(nx - 1)).ravel()
    triangles = np.concatenate([np.stack([k, k + 1, k + nx + 1], 1), np.stack([k, k + nx + 1, k + nx], 1)])
    return np.column_stack([x.ravel(), y.ravel(), height(x, y).ravel()]), triangles


POINTS, TRIANGLES = net()


def normals():
    a, b, c = (POINTS[TRIANGLES[:, k]] for k in range(3))
    n = np.cross(b - a, c - a)
    return n / np.linalg.norm(n, axis=1, keepdims=True)


def binary_stl(header=b"solid by a careless program"):
    facets = np.zeros(len(TRIANGLES), [("n", "<f4", 3), ("p", "<f4", (3, 3)), ("a", "<u2")])
    facets["n"], facets["p"] = normals(), POINTS[TRIANGLES]
    return header.ljust(80, b"\0") + len(TRIANGLES).to_bytes(4, "little") + facets.tobytes()


def text_stl():
    lines = ["solid part"]
    for n, triangle in zip(normals(), TRIANGLES, strict=True):
        lines += ["  facet normal {:.6e} {:.6e} {:.6e}".format(*n), "    outer loop"]
        lines += ["      vertex {:.9e} {:.9e} {:.9e}".format(*POINTS[k]) for k in triangle]
        lines += ["    endloop", "  endfacet"]
    return "\n".join([*lines, "endsolid part", ""]).encode()


def text_ply():
    head = f"ply\nformat ascii 1.0\nelement vertex {len(POINTS)}\n"
    head += "property double x\nproperty double y\nproperty double z\n"
    head += f"element face {len(TRIANGLES)}\nproperty list uchar int vertex_indices\nend_header\n"
    body = ["{:.17g} {:.17g} {:.17g}".format(*p) for p in POINTS]
    body += ["3 {} {} {}".format(*t) for t in TRIANGLES]
    return (head + "\n".join(body) + "\n").encode()


def text_obj():
    lines = ["# a saddle", "o part"]
    lines += ["v {:.17g} {:.17g} {:.17g}".format(*p) for p in POINTS]
    lines += ["f {} {} {}".format(*(t + 1)) for t in TRIANGLES]
    return "\n".join([*lines, ""]).encode()


def same_mesh(found: TriangleMesh, tolerance: float) -> None:
    assert len(found.points_mm) == len(POINTS)
    assert len(found.triangles) == len(TRIANGLES)
    np.testing.assert_allclose(
        found.points_mm[found.triangles].reshape(-1, 9),
        POINTS[TRIANGLES].reshape(-1, 9),
        atol=tolerance,
    )


@pytest.mark.parametrize(
    ("raw", "tolerance", "library"),
    [
        (binary_stl(), 1e-6, False),
        (binary_stl(b"\0"), 1e-6, False),
        (text_stl(), 1e-8, True),
        (text_ply(), 0.0, True),
        (text_obj(), 0.0, True),
    ],
    ids=["binary STL that says solid", "binary STL", "text STL", "PLY", "OBJ"],
)
def test_a_mesh_is_known_by_its_content_and_comes_back(raw, tolerance, library, tmp_path):
    if library:
        pytest.importorskip("trimesh")
    path = tmp_path / "any.name"
    path.write_bytes(raw)
    found = files.read_nominal_any(path)
    same_mesh(found, tolerance)
    assert found.n_degenerate == 0
    inch = files.read_nominal_any(path, "inch")
    np.testing.assert_allclose(inch.points_mm, 25.4 * found.points_mm, rtol=1e-15)


def test_facets_without_area_are_left_out_and_counted():
    points = np.vstack([POINTS, POINTS[:1], [[1e6, 0.0, 0.0]]])  # a copy, and a vertex that nobody uses
    extra = [[0, 1, 1], [len(POINTS), 0, 3]]
    found = TriangleMesh.of(points, np.vstack([TRIANGLES, extra]))
    same_mesh(found, 0.0)
    assert found.n_degenerate == 2


@pytest.mark.parametrize("share", [0.3, 0.7, 0.99])
@pytest.mark.parametrize("raw", [binary_stl(), text_stl(), text_ply(), text_obj()[:-30] + b"f 1 2\nf 1 "])
def test_a_mesh_cut_off_is_refused(raw, share, tmp_path):
    pytest.importorskip("trimesh")
    path = tmp_path / "part.stl"
    path.write_bytes(raw if raw.endswith(b"f 1 ") else raw[: int(share * len(raw))])
    with pytest.raises(MalformedInputError, match=r"part\.stl: .*(incomplete|damaged|without triangles)"):
        files.read_nominal_any(path)


@pytest.mark.parametrize(
    ("points", "triangles", "message"),
    [
        (POINTS, TRIANGLES + 9, "a facet names vertex"),
        (np.where(np.arange(len(POINTS))[:, None] == 5, np.nan, POINTS), TRIANGLES, "not finite"),
        (POINTS, TRIANGLES[:0], "no facet with an area"),
        (POINTS, [[0, 0, 1]], "no facet with an area"),
        (POINTS[:, :2], TRIANGLES, "not a triangle mesh"),
    ],
)
def test_numbers_that_are_no_mesh_are_refused(points, triangles, message):
    with pytest.raises(MalformedInputError, match=message):
        TriangleMesh.of(points, triangles)


def test_without_the_library_the_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "trimesh", None)
    (tmp_path / "part.ply").write_bytes(text_ply())
    with pytest.raises(InputError, match=r"pip install 'cmm-align\[mesh\]'"):
        files.read_nominal_any(tmp_path / "part.ply")


def test_a_mesh_is_a_nominal_and_has_no_faces_to_choose(tmp_path):
    (tmp_path / "part.stl").write_bytes(binary_stl())
    with pytest.raises(WrongStageError, match="this is a mesh, a nominal, not points"):
        files.read_measured(tmp_path / "part.stl")
    with pytest.raises(UsageError, match="--face 2"):
        files.read_nominal_any(tmp_path / "part.stl", face=2)
