"""Curvatures, features and reach of a nominal come back from its file; files without them are read too."""

import h5py
import numpy as np
import pytest

from cmm_align import io
from cmm_align.stages.offset import offset
from cmm_align.virtual.window import window

ADDED = (
    "equidistant/reach",
    "nominal/least_curvature_per_mm",
    "nominal/most_curvature_per_mm",
    "nominal/feature",
)


@pytest.fixture(scope="module")
def made():
    return offset(window(), 1.5)


def test_the_maps_of_a_nominal_come_back_bit_for_bit(made, same, tmp_path):
    io.write(made, tmp_path / "n.h5")

    same(io.read_nominal(tmp_path / "n.h5", with_equidistant=True).equidistant, made.equidistant)
    with h5py.File(tmp_path / "n.h5") as file:
        for name in ADDED:
            assert len(file[name]) == made.quality.n_points
            assert file[name].attrs["units"]
            assert file[name].attrs["description"]
        product = file["nominal/least_curvature_per_mm"][:] * file["nominal/most_curvature_per_mm"][:]
        np.testing.assert_allclose(product, file["nominal/gaussian_curvature_per_mm2"][:], atol=1e-15)


def test_a_file_of_an_older_version_is_read_without_them(made, tmp_path):
    io.write(made, tmp_path / "n.h5")
    with h5py.File(tmp_path / "n.h5", "r+") as file:
        for name in ADDED:
            del file[name]
        for name in ("n_not_reached", "n_edge", "n_feature", "max_held_off_mm"):
            del file["surface/quality"].attrs[name]

    old = io.read_nominal(tmp_path / "n.h5", with_equidistant=True)

    assert old.equidistant.reach is None
    assert old.equidistant.most_curvature_per_mm is None
    assert old.quality.n_not_reached is None
    np.testing.assert_array_equal(old.equidistant.points_mm, made.equidistant.points_mm)
