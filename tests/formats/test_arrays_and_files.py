"""NumPy arrays, prescriptions, and the one door for any file."""

from __future__ import annotations

import h5py
import numpy as np
import pytest

from cmm_align import files
from cmm_align.errors import (
    CmmAlignError,
    MalformedInputError,
    MissingFileError,
    OutputExistsError,
    UnitsError,
    WrongStageError,
)
from cmm_align.formats import read_points
from cmm_align.model import PointKind, PointSet

POINTS = np.random.default_rng(0).normal(size=(50, 3))

PRESCRIPTION = """
schema = "cmm-align/prescription/1"
units = "mm"
[aperture]
shape = "rectangle"
width = 20.0
height = 10.0
[[term]]
kind = "conic"
radius = 90.0
conic = -0.6
"""


@pytest.mark.parametrize("dtype", ["f8", ">f8", "f4", "i4", "u1"])
@pytest.mark.parametrize("shape", [(12, 3), (3, 4, 3)])
def test_npy_arrays_of_any_number_type_are_read(shape, dtype, tmp_path):
    array = np.arange(36).reshape(shape).astype(dtype)
    np.save(tmp_path / "p.npy", array)
    np.testing.assert_array_equal(read_points(tmp_path / "p.npy").points_mm, np.arange(36.0).reshape(-1, 3))


def test_npy_in_fortran_order_is_read(tmp_path):
    np.save(tmp_path / "p.npy", np.asfortranarray(POINTS))
    np.testing.assert_array_equal(read_points(tmp_path / "p.npy", "mm").points_mm, POINTS)


@pytest.mark.parametrize(
    "array",
    [
        np.zeros((4, 2)),
        np.zeros(3),
        np.array([[1, 2, "x"]]),
        np.zeros((2, 3), complex),
        np.full((2, 3), np.nan),
        np.array([[{}, 2, 3]], dtype=object),
    ],
)
def test_npy_arrays_that_are_not_points_are_refused(array, tmp_path):
    np.save(tmp_path / "p.npy", array, allow_pickle=True)
    with pytest.raises(MalformedInputError, match=r"p\.npy"):
        read_points(tmp_path / "p.npy")


def test_npy_cut_off_anywhere_is_refused(tmp_path):
    path = tmp_path / "p.npy"
    np.save(path, POINTS)
    whole = path.read_bytes()
    for length in range(0, len(whole), 37):
        path.write_bytes(whole[:length])
        with pytest.raises(MalformedInputError):
            read_points(path)


@pytest.mark.parametrize("units", ["mm", "um", "inch"])
@pytest.mark.parametrize("kind", [PointKind.TIP_CENTRE, PointKind.CONTACT])
def test_points_written_as_text_come_back(units, kind, tmp_path):
    points = PointSet.of(
        POINTS, kind=kind, frame="part", ids=np.arange(50)[::-1], sigma_mm=np.full(50, 1e-3), source="x"
    )
    files.write_points(tmp_path / "p.csv", points, units=units, decimals=9, with_ids=True)
    back = files.read_measured(tmp_path / "p.csv")
    np.testing.assert_allclose(back.points_mm, POINTS, atol=0.51e-9 * 25.4, rtol=1e-15)
    assert (back.kind, back.frame) == (kind, "part")
    assert back.ids.tolist() == points.ids.tolist()
    np.testing.assert_allclose(back.sigma_mm, 1e-3, rtol=1e-3)
    with pytest.raises(OutputExistsError):
        files.write_points(tmp_path / "p.csv", points)


def test_points_with_normals_are_rounded_to_the_last_digit(tmp_path):
    points = PointSet.of([[1 / 3, -2 / 3, 1e4]])
    files.write_points(tmp_path / "p.csv", points, normals=np.array([[0.0, 0.6, 0.8]]), decimals=4)
    assert (tmp_path / "p.csv").read_text().splitlines() == [
        "# cmm-align points v1; units=mm; kind=unstated; frame=machine",
        "x_mm,y_mm,z_mm,i,j,k",
        "0.3333,-0.6667,10000.0000,0.000000000,0.600000000,0.800000000",
    ]
    assert read_points(tmp_path / "p.csv").points_mm.tolist() == [[0.3333, -0.6667, 1e4]]


def test_a_prescription_is_a_nominal_and_not_a_measurement(tmp_path):
    path = tmp_path / "any.name"
    path.write_text(PRESCRIPTION)
    assert files.read_nominal_any(path).kind == "prescription"
    assert files.read(path, "mm").toml_text == PRESCRIPTION
    with pytest.raises(WrongStageError, match="a prescription"):
        files.read_measured(path)
    with pytest.raises(UnitsError):
        files.read_nominal_any(path, "um")


@pytest.mark.parametrize(
    ("kind", "reader"),
    [
        ("nominal", files.read_measured),
        ("commanded", files.read_measured),
        ("tip_centre", files.read_nominal_any),
        ("commanded", files.read_nominal_any),
    ],
)
def test_points_of_the_other_kind_are_refused(kind, reader, tmp_path):
    files.write_points(tmp_path / "p.csv", PointSet.of(POINTS, kind=PointKind(kind)))
    with pytest.raises(WrongStageError, match=f"these are {kind} points"):
        reader(tmp_path / "p.csv")


def test_hdf5_is_known_by_content(tmp_path):
    with h5py.File(tmp_path / "p.csv", "w") as file:
        file["xyz"] = POINTS
    for reader in (files.read, files.read_measured, files.read_nominal_any):
        np.testing.assert_array_equal(reader(tmp_path / "p.csv").points_mm, POINTS)


@pytest.mark.parametrize("reader", [files.read, files.read_measured, files.read_nominal_any])
def test_empty_missing_and_folders_are_input_errors(reader, tmp_path):
    (tmp_path / "a.h5").write_bytes(b"")
    (tmp_path / "a.csv").write_bytes(b"")
    for name, error in [
        ("a.h5", MalformedInputError),
        ("a.csv", MalformedInputError),
        ("b", MissingFileError),
        (".", MissingFileError),
    ]:
        with pytest.raises(error) as caught:
            reader(tmp_path / name)
        assert isinstance(caught.value, CmmAlignError)
        assert caught.value.exit_code == 3
