"""What is written comes back bit for bit, with its history, and plain h5py can read it."""

from __future__ import annotations

import copy
from dataclasses import replace

import h5py
import numpy as np
import pytest

from cmm_align import io
from cmm_align.io.schema import STAGES
from cmm_align.model import Nominal


def test_every_noun_comes_back_equal_and_is_not_changed(noun, steps, same, tmp_path):
    before = copy.deepcopy(noun)
    io.write(noun, tmp_path / "a.h5", steps)
    same(noun, before)
    same(io.read(tmp_path / "a.h5"), noun)
    assert io.read_steps(tmp_path / "a.h5") == steps
    assert [p.name for p in tmp_path.iterdir()] == ["a.h5"]


def test_arrays_that_come_back_are_read_only(alignment, tmp_path):
    io.write(alignment, tmp_path / "a.h5")
    back = io.read_alignment(tmp_path / "a.h5")
    with pytest.raises(ValueError, match="read-only"):
        back.deviation_mm[0] = 0.0


def test_a_nominal_comes_without_its_net_unless_asked(nominal, same, tmp_path):
    io.write(nominal, tmp_path / "n.h5")
    lean = io.read_nominal(tmp_path / "n.h5")
    assert lean.equidistant is None
    same(lean.equidistant_surface, nominal.equidistant_surface)
    same(lean.surface, nominal.surface)
    same(io.read_nominal(tmp_path / "n.h5", with_equidistant=True), nominal)


def test_every_dataset_has_units_a_description_and_a_checksum(noun, steps, tmp_path):
    io.write(noun, tmp_path / "a.h5", steps)
    seen = []

    def look(name, item):
        if isinstance(item, h5py.Dataset):
            seen.append(name)
            assert item.attrs["units"], name
            assert item.attrs["description"], name
            assert item.shape == () or item.fletcher32, name

    with h5py.File(tmp_path / "a.h5") as file:
        file.visititems(look)
        assert file.attrs["complete"]
        assert file.attrs["schema_version"] == 2
        assert file.attrs["created_by"].startswith("cmm-align ")
    assert seen


def test_the_promised_names_are_there(nouns, tmp_path):
    promised = {
        "nominal": ["equidistant/points_mm", "equidistant/triangles", "equidistant/regular",
                    "nominal/points_mm", "nominal/normals", "nominal/slope",
                    "nominal/gaussian_curvature_per_mm2"],
        "alignment": ["pose/part_from_machine", "pose/covariance", "points/tip_centre_machine_mm",
                      "points/tip_centre_part_mm", "points/contact_part_mm", "points/normal",
                      "points/deviation_mm", "points/used", "points/id"],
        "map": ["grid/x_mm", "grid/y_mm", "grid/deviation_mm", "grid/sag_deviation_mm", "grid/sigma_mm",
                "points/deviation_mm"],
        "correction": ["grid/x_mm", "grid/y_mm", "grid/correction_mm", "grid/commanded_z_mm",
                       "grid/commanded_normal"],
    }  # fmt: skip
    for name, noun in nouns.items():
        io.write(noun, tmp_path / f"{name}.h5")
        with h5py.File(tmp_path / f"{name}.h5") as file:
            assert [d for d in promised[name] if d not in file] == []
            assert file.attrs["schema"] == f"cmm-align/{name}"


def test_the_same_noun_gives_the_same_bytes(noun, steps, tmp_path):
    io.write(noun, tmp_path / "a.h5", steps)
    io.write(noun, tmp_path / "b.h5", steps)
    assert (tmp_path / "a.h5").read_bytes() == (tmp_path / "b.h5").read_bytes()


def test_describe_tells_stage_history_and_datasets(noun, steps, tmp_path):
    io.write(noun, tmp_path / "a.h5", steps)
    told = io.describe(tmp_path / "a.h5")
    assert told["schema"] in STAGES
    assert told["steps"] == steps
    assert all(d["units"] and d["description"] for d in told["datasets"])
    key = "surface/tip_radius_mm" if isinstance(noun, Nominal) else "nominal_surface/tip_radius_mm"
    assert told["numbers"][key] == 1.5


def test_a_numpy_scalar_in_a_report_survives(alignment, same, tmp_path):
    report = replace(alignment.report, two_path_difference_nm=np.float64(0.5), iterations=np.int64(3))
    io.write(replace(alignment, report=report), tmp_path / "a.h5")
    assert io.read_alignment(tmp_path / "a.h5").report.iterations == 3


def test_an_alignment_of_version_1_is_still_read(alignment, tmp_path):
    """Version 1 knew used points only, and a shorter report."""
    io.write(alignment, tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5", "r+") as file:
        file.attrs["schema_version"] = 1
        for name in ("judged", "status", "sigma_mm"):
            del file["points"][name]
        for name in ("steps", "n_edge", "n_apart", "weights", "scale", "locked"):
            del file["report"].attrs[name]
    back = io.read_alignment(tmp_path / "a.h5")
    np.testing.assert_array_equal(back.judged, alignment.used)
    np.testing.assert_array_equal(back.status == 0, alignment.used)
    assert back.sigma_mm is None
    assert (back.report.steps, back.report.weights, back.report.scale) == ((), "equal", 1.0)
