"""HDF5 that is damaged, of the wrong stage, or hostile: refused with file and dataset."""

from __future__ import annotations

import h5py
import numpy as np
import pytest

from cmm_align import io
from cmm_align.errors import MalformedInputError, MissingFileError, UnitsError, WrongStageError
from cmm_align.io.safe_hdf5 import opened, read_array

READERS = {
    "nominal": io.read_nominal,
    "alignment": io.read_alignment,
    "map": io.read_map,
    "correction": io.read_correction,
}


@pytest.fixture
def good(alignment, steps, tmp_path):
    io.write(alignment, tmp_path / "a.h5", steps)
    return tmp_path / "a.h5"


def refused(path, match):
    with pytest.raises(MalformedInputError, match=match) as caught:
        io.read(path)
    assert str(path) in caught.value.where
    assert "\n" not in str(caught.value)


def test_a_file_cut_off_anywhere_is_refused(good):
    whole = good.read_bytes()
    for length in [0, 1, 4, 8, 50, 96, *range(500, len(whole), len(whole) // 20), len(whole) - 1]:
        good.write_bytes(whole[:length])
        with pytest.raises(MalformedInputError, match=r"empty|incomplete|damaged|missing"):
            io.read(good)


def test_a_flipped_bit_in_the_data_is_found(good):
    with h5py.File(good) as file:
        chunk = file["points/normal"].id.get_chunk_info(0)
    raw = bytearray(good.read_bytes())
    raw[chunk.byte_offset + chunk.size // 2] ^= 1
    good.write_bytes(raw)
    refused(good, "damaged")


def test_other_files_are_refused(tmp_path):
    (tmp_path / "a.h5").write_text("1,2,3\n")
    refused(tmp_path / "a.h5", "not an HDF5 file")
    with h5py.File(tmp_path / "b.h5", "w") as file:
        file["x"] = 1
    refused(tmp_path / "b.h5", "not a file of cmm-align")
    for name in ("missing.h5", "."):
        with pytest.raises(MissingFileError):
            io.read(tmp_path / name)


def test_every_missing_dataset_is_named(good, alignment):
    names = []
    with h5py.File(good) as file:
        file.visititems(lambda name, item: names.append(name) if isinstance(item, h5py.Dataset) else None)
    assert len(names) == 15
    names.remove("points/sigma_mm")  # may be absent
    for name in names:
        io.write(alignment, good, overwrite=True)
        with h5py.File(good, "r+") as file:
            del file[name]
        refused(good, "missing")


@pytest.mark.parametrize("group", ["/report", "/nominal_surface", "/nominal_surface/quality"])
def test_every_missing_attribute_is_named(group, good, alignment):
    with h5py.File(good) as file:
        names = list(file[group].attrs)
    for name in names:
        if name in {"min_concave_at_mm", "free_scale"}:  # may be absent
            continue
        io.write(alignment, good, overwrite=True)
        with h5py.File(good, "r+") as file:
            del file[group].attrs[name]
        refused(good, "missing")


@pytest.mark.parametrize(
    ("change", "match"),
    [
        (lambda f: f.attrs.__delitem__("complete"), "not complete"),
        (lambda f: f.attrs.__setitem__("complete", False), "not complete"),
        (lambda f: f.attrs.__setitem__("schema_version", 3), "version 3 is newer"),
        (lambda f: f.attrs.__setitem__("schema", "cmm-align/other"), "schema 'cmm-align/other'"),
        (
            lambda f: f["report"].attrs.__setitem__("iterations", "many"),
            "'many'; expected a value of type int",
        ),
        (lambda f: f["report"].attrs.__setitem__("pose_sigma", "{"), "not JSON"),
        (lambda f: f["report"].attrs.__setitem__("pose_sigma", '["a"]'), "expected a value of type"),
        (lambda f: f["nominal_surface"].attrs.__setitem__("side", 0), "side 0"),
        (lambda f: f["nominal_surface"].attrs.__setitem__("degree", 4), "degree 4"),
        (lambda f: f["nominal_surface"].attrs.__setitem__("form", "mesh"), "form 'mesh'"),
    ],
)
def test_a_wrong_attribute_is_refused(change, match, good):
    with h5py.File(good, "r+") as file:
        change(file)
    refused(good, match)


@pytest.mark.parametrize(
    ("name", "value", "match"),
    [
        ("points/normal", np.zeros((400, 2)), r"shape \(400, 2\); expected \(400, 3\)"),
        ("points/normal", np.zeros(400), r"shape \(400,\)"),
        ("points/deviation_mm", np.zeros(399), r"expected \(400\)"),
        ("points/id", np.zeros(400), "type float64; expected integer"),
        ("points/normal", np.full((400, 3), b"a"), "type |S1; expected float"),
        ("points/tip_centre_machine_mm", np.full((400, 3), np.nan), r"not finite at \[0, 0\]"),
        ("pose/part_from_machine", np.diag([1.0, 1, 2, 1]), "not a 4x4|missing|not a rigid motion"),
    ],
)
def test_a_wrong_dataset_is_refused(name, value, match, good):
    with h5py.File(good, "r+") as file:
        attributes = dict(file[name].attrs)
        del file[name]
        file[name] = value
        file[name].attrs.update(attributes)
    with pytest.raises(Exception, match=match) as caught:
        io.read(good)
    assert caught.value.exit_code == 3
    assert caught.value.where == f"{good}:/{name}"


def _external_dataset(f):
    f["points"].create_dataset("normal", (400, 3), "f8", external=[(f.filename, 0, 9600)])


def _virtual(f):
    layout = h5py.VirtualLayout((400, 3), "f8")
    layout[:] = h5py.VirtualSource("other.h5", "x", (400, 3))
    f["points"].create_virtual_dataset("normal", layout)


def _bomb(f):
    f["points"].create_dataset("normal", (10**9, 300), "f8", chunks=(100, 100), compression="gzip")


def _nothing_stored(f):
    f["points"].create_dataset("normal", (400, 3), "f8", chunks=(400, 3))


def _filter(f):
    f["points"].create_dataset("normal", data=np.zeros((400, 3), "i4"), scaleoffset=0)


@pytest.mark.parametrize(
    ("hostile", "match"),
    [
        (
            lambda f: f["points"].__setitem__("normal", h5py.ExternalLink("o.h5", "/x")),
            "soft or external link",
        ),
        (
            lambda f: f["points"].__setitem__("normal", h5py.SoftLink("/points/deviation_mm")),
            "soft or external",
        ),
        (_external_dataset, "outside the file"),
        (_virtual, "outside the file"),
        (_bomb, "declares 300000000000 values"),
        (_nothing_stored, "stores 0 bytes"),
        (_filter, "needs filter 6"),
        (lambda f: f["points"].create_group("normal"), "missing"),
    ],
)
def test_data_from_elsewhere_and_bombs_are_refused(hostile, match, good):
    with h5py.File(good, "r+") as file:
        del file["points/normal"]
        hostile(file)
    refused(good, match)


def test_a_link_in_the_middle_of_a_path_is_refused(good, tmp_path):
    with h5py.File(tmp_path / "o.h5", "w") as other, h5py.File(good, "r+") as file:
        file.copy("points", other)
        del file["points"]
        file["points"] = h5py.ExternalLink("o.h5", "/points")
    refused(good, "soft or external link")


def test_every_wrong_stage_is_named_with_what_to_do(nouns, tmp_path):
    for name, noun in nouns.items():
        path = tmp_path / f"{name}.h5"
        io.write(noun, path)
        for wanted, reader in READERS.items():
            if wanted == name:
                reader(path)
                continue
            with pytest.raises(WrongStageError) as caught:
                reader(path)
            assert caught.value.where == str(path)
            assert wanted.replace("map", "deviation map") in caught.value.expected
            assert "cmm-align" in caught.value.remedy
        with pytest.raises(WrongStageError, match="not points"):
            io.read_points_hdf5(path)


@pytest.mark.parametrize("name", ["points_mm", "points", "xyz"])
def test_points_of_any_hdf5_file_are_read(name, tmp_path):
    with h5py.File(tmp_path / "p.h5", "w") as file:
        file[name] = np.arange(12, dtype="f4").reshape(4, 3)
        file[name].attrs["units"] = "um"
        file.attrs["kind"] = "tip_centre"
    points = io.read_points_hdf5(tmp_path / "p.h5")
    np.testing.assert_allclose(points.points_mm, np.arange(12).reshape(4, 3) * 1e-3)
    assert points.kind == "tip_centre"
    with pytest.raises(UnitsError):
        io.read_points_hdf5(tmp_path / "p.h5", "inch")


def test_points_that_are_not_points_are_refused(tmp_path):
    with h5py.File(tmp_path / "p.h5", "w") as file:
        file["points"] = [[1.0, 2.0]]
    with pytest.raises(MalformedInputError, match=r"p\.h5:/points: shape"):
        io.read_points_hdf5(tmp_path / "p.h5")
    with h5py.File(tmp_path / "p.h5", "w") as file:
        file["data"] = [[1.0, 2.0, 3.0]]
    with pytest.raises(MalformedInputError, match="no dataset of points"):
        io.read_points_hdf5(tmp_path / "p.h5")


def test_an_array_of_zeros_is_stored_and_read(tmp_path):
    with h5py.File(tmp_path / "p.h5", "w") as file:
        file["points"] = np.zeros((2, 3))
    with opened(tmp_path / "p.h5") as file:
        assert read_array(file, "/points", (None, 3)).tolist() == [[0.0] * 3] * 2


@pytest.mark.parametrize("name", ["ids", "id"])
def test_what_belongs_to_the_points_is_read_beside_them(name, tmp_path):
    with h5py.File(tmp_path / "p.h5", "w") as file:
        file["points_mm"] = np.eye(3)
        file[name] = np.array([7, 3, 2**60 + 1])
        file["sigma_mm"] = np.array([1e-3, 2e-3, 3e-3])
        file["weight"] = np.array([0.0, 1.0, 2.0], dtype="f4")
    points = io.read_points_hdf5(tmp_path / "p.h5")
    assert points.ids.tolist() == [7, 3, 2**60 + 1]
    assert points.sigma_mm.tolist() == [1e-3, 2e-3, 3e-3]
    assert points.weight.tolist() == [0.0, 1.0, 2.0]


@pytest.mark.parametrize(
    ("name", "values", "words"),
    [
        ("ids", [1, 2], r"p\.h5:/ids: shape"),
        ("ids", [1.5, 2.0, 3.0], r"p\.h5:/ids: type float64"),
        ("sigma_mm", [1.0, 0.0, 1.0], "sigma 0 of point 2"),
        ("sigma_mm", [1.0, np.nan, 1.0], r"p\.h5:/sigma_mm"),
        ("weight", [1.0, -1.0, 1.0], "weight -1 of point 2"),
    ],
)
def test_what_belongs_to_the_points_is_checked(name, values, words, tmp_path):
    with h5py.File(tmp_path / "p.h5", "w") as file:
        file["points_mm"] = np.eye(3)
        file[name] = values
    with pytest.raises(MalformedInputError, match=words):
        io.read_points_hdf5(tmp_path / "p.h5")
