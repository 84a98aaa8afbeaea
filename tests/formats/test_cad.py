"""STEP and IGES faces against the closed forms of the surfaces they hold."""

from __future__ import annotations

import sys

import closed_forms as cf
import numpy as np
import pytest

from cmm_align import files
from cmm_align.errors import InputError, MalformedInputError, UnitsError, UsageError, WrongStageError
from cmm_align.surfaces.nurbs import NurbsSurface

STEP_HEAD = b"ISO-10303-21;\nHEADER;\n"


@pytest.fixture
def occ():
    """The CAD library, quiet."""
    pytest.importorskip("OCP")
    from OCP.Message import Message

    Message.DefaultMessenger_s().ChangePrinters().Clear()


def write(shape, path):
    """Write a shape as STEP or IGES, by the suffix."""
    if path.suffix == ".step":
        from OCP.STEPControl import STEPControl_StepModelType, STEPControl_Writer

        writer = STEPControl_Writer()
        writer.Transfer(shape, STEPControl_StepModelType.STEPControl_AsIs)
    else:
        from OCP.IGESControl import IGESControl_Writer

        writer = IGESControl_Writer("MM", 0)
        writer.AddShape(shape)
        writer.ComputeModel()
    assert writer.Write(str(path))
    return path


def axis_of(direction, origin=(0.0, 0.0, 0.0)):
    from OCP.gp import gp_Ax3, gp_Dir, gp_Pnt

    return gp_Ax3(gp_Pnt(*origin), gp_Dir(*direction))


def face(surface, u0, u1, v0, v1):
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace

    return BRepBuilderAPI_MakeFace(surface, u0, u1, v0, v1, 1e-7).Face()


def lens():
    """A cap of a ball of radius 50 about z, vertex at the origin, aperture 40: its pole is in the middle."""
    from OCP.Geom import Geom_SphericalSurface

    ball = Geom_SphericalSurface(axis_of((0, 0, 1), (0, 0, -50)), 50.0)
    return face(ball, 0.0, 2.0 * np.pi, np.arccos(0.4), 0.5 * np.pi)


@pytest.mark.parametrize("suffix", [".step", ".igs"])
def test_a_lens_is_its_sphere_through_the_pole(occ, suffix, tmp_path, rng):
    patch = files.read_nominal_any(write(lens(), tmp_path / f"lens{suffix}"))
    assert isinstance(patch, NurbsSurface)
    assert patch.conversion_error_mm <= 1e-12
    r, angle = 19.9 * np.sqrt(rng.uniform(size=3000)), rng.uniform(0.0, 2.0 * np.pi, 3000)
    x, y = r * np.cos(angle), r * np.sin(angle)
    jet, exact = patch.jet(x, y), cf.Sphere(radius_mm=-50.0).jet(x, y)
    printed = 1e-12 if suffix == ".step" else 1e-9  # IGES prints fewer digits
    np.testing.assert_allclose(jet.z, exact.z, atol=printed, rtol=0)
    np.testing.assert_allclose([jet.zx, jet.zy], [exact.zx, exact.zy], atol=printed, rtol=0)
    np.testing.assert_allclose(jet.zxx, exact.zxx, atol=1e-10, rtol=0)
    ring = np.array([19.99, 20.01])
    assert patch.contains(x, y).all()
    assert patch.contains(ring, 0.0 * ring).tolist() == [True, False]


def test_a_torus_is_exact(occ, tmp_path, rng):
    from OCP.Geom import Geom_ToroidalSurface
    from OCP.gp import gp_Ax3, gp_Dir, gp_Pnt

    # The axis along y, the outer top along z: u is counted from z.
    axis = gp_Ax3(gp_Pnt(0, 0, -120), gp_Dir(0, 1, 0), gp_Dir(0, 0, 1))
    part = face(Geom_ToroidalSurface(axis, 80.0, 40.0), -0.2, 0.2, -0.4, 0.4)
    patch = files.read_nominal_any(write(part, tmp_path / "torus.step"))
    x, y = rng.uniform(-15.0, 15.0, (2, 2000))
    jet, exact = patch.jet(x, y), cf.Torus().jet(x, y)
    np.testing.assert_allclose(jet.z, exact.z, atol=1e-11)
    np.testing.assert_allclose([jet.zxx, jet.zxy, jet.zyy], [exact.zxx, exact.zxy, exact.zyy], atol=1e-11)
    assert patch.conversion_error_mm <= 1e-11


def test_an_offset_surface_is_approximate_and_says_so(occ, tmp_path, rng):
    from OCP.Geom import Geom_Ellipse, Geom_OffsetSurface, Geom_SurfaceOfLinearExtrusion
    from OCP.gp import gp_Ax2, gp_Dir, gp_Pnt

    ellipse = Geom_Ellipse(gp_Ax2(gp_Pnt(0, 0, 0), gp_Dir(0, 1, 0), gp_Dir(0, 0, 1)), 60.0, 40.0)
    tube = Geom_SurfaceOfLinearExtrusion(ellipse, gp_Dir(0, 1, 0))
    offset = Geom_OffsetSurface(tube, 5.0)
    part = face(offset, 0.3, 0.9, -10.0, 10.0)
    patch = files.read_nominal_any(write(part, tmp_path / "offset.step"))
    assert 1e-13 < patch.conversion_error_mm < 1e-6
    u, v = rng.uniform(0.3, 0.9, 200), rng.uniform(-10.0, 10.0, 200)
    truth = [offset.Value(a, b) for a, b in zip(u.tolist(), v.tolist(), strict=True)]
    away = patch.derivatives(u, v, 1).s - [(p.X(), p.Y(), p.Z()) for p in truth]
    assert np.abs(away).max() <= 2.0 * patch.conversion_error_mm


def test_a_hole_in_a_face_is_followed(occ, tmp_path):
    from OCP.BRepAlgoAPI import BRepAlgoAPI_Cut
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox, BRepPrimAPI_MakeCylinder
    from OCP.gp import gp_Ax2, gp_Dir, gp_Pnt

    box = BRepPrimAPI_MakeBox(gp_Pnt(-20, -15, -5), gp_Pnt(20, 15, 0)).Shape()
    drill = BRepPrimAPI_MakeCylinder(gp_Ax2(gp_Pnt(3, 2, -9), gp_Dir(0, 0, 1)), 4.0, 20.0).Shape()
    path = write(BRepAlgoAPI_Cut(box, drill).Shape(), tmp_path / "plate.step")
    with pytest.raises(InputError, match=r"holds 7 faces: 1 .* mm\^2, .*cylinder.*--face N") as caught:
        files.read_nominal_any(path)
    areas = [float(item.split()[-2]) for item in caught.value.what.split(": ")[1].split(", ")]
    top = [k for k, a in enumerate(areas, 1) if abs(a - (1200 - np.pi * 16)) < 1.0]
    plates = [files.read_nominal_any(path, face=k) for k in top]
    for plate in plates:
        x = np.array([3.0, 6.9, 7.1, 19.9, 20.1])
        assert plate.contains(x, np.full(5, 2.0)).tolist() == [False, False, True, True, False]
    assert sorted(round(float(p.jet(np.array([9.0]), np.zeros(1)).z[0]), 12) for p in plates) == [-5.0, 0.0]
    for wrong in (0, 8):
        with pytest.raises(UsageError, match="no such face"):
            files.read_nominal_any(path, face=wrong)
    with pytest.raises(WrongStageError, match="a CAD file, a nominal"):
        files.read_measured(path)


def test_the_unit_of_the_file_counts(occ, tmp_path):
    path = write(lens(), tmp_path / "lens.step")
    assert files.read_nominal_any(path, "mm").kind == "nurbs"
    with pytest.raises(UnitsError, match="the file states mm"):
        files.read_nominal_any(path, "inch")
    text = path.read_bytes()
    assert b".MILLI.,.METRE." in text
    scaled = text.replace(b"SI_UNIT(.MILLI.,.METRE.)", b"SI_UNIT($,.METRE.)")
    path.write_bytes(scaled)
    np.testing.assert_allclose(
        files.read_nominal_any(path, "m").bounds, np.array([-2, 2, -2, 2]) * 1e4, rtol=1e-4
    )


@pytest.mark.parametrize("raw", [STEP_HEAD, STEP_HEAD + b"DATA;\n#1=garbage", b" " * 72 + b"S      1\n"])
def test_damaged_files_are_refused(occ, raw, tmp_path):
    (tmp_path / "part.step").write_bytes(raw)
    with pytest.raises(MalformedInputError, match=r"part\.step: a damaged (STEP|IGES) file"):
        files.read_nominal_any(tmp_path / "part.step")


def test_nothing_is_written_to_the_screen(occ, tmp_path, capfd):
    files.read_nominal_any(write(lens(), tmp_path / "lens.step"))
    files.read_nominal_any(write(lens(), tmp_path / "lens.igs"))
    assert capfd.readouterr() == ("", "")


def test_without_the_library_the_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "OCP", None)
    monkeypatch.setitem(sys.modules, "OCP.Message", None)
    (tmp_path / "part.step").write_bytes(STEP_HEAD)
    with pytest.raises(InputError, match=r"pip install 'cmm-align\[cad\]'"):
        files.read_nominal_any(tmp_path / "part.step")
