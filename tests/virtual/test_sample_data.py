"""The recorded window is what its README says, and the truth beside it is the truth."""

from __future__ import annotations

import runpy
from pathlib import Path

import numpy as np
import pytest

from cmm_align.pose import Pose
from cmm_align.surfaces.geometry import unit_normal
from cmm_align.virtual.cmm import NOISE_MM
from cmm_align.virtual.window import PRESCRIPTION, window

ROUNDING_MM = 0.5e-5
"""The points are printed with five decimals."""
MADE_BY_COMMANDS = (".align.h5", ".map.h5", ".map.png", ".comp.h5", ".comp.xyz", ".comp.png")
FIVE_MB = 5_000_000


def recorded(sample_data: Path, name: str, key: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return measured centres in the part frame, true centres, and normals."""
    truth = np.load(sample_data / "truth.npz")
    measured = np.loadtxt(sample_data / name, delimiter=",", skiprows=2)
    pose = Pose.from_matrix(truth["machine_from_part"], "machine", "part")
    foot = truth["foot_mm"]
    normals = unit_normal(window().jet(foot[:, 0], foot[:, 1]), 1)
    height = truth["tip_radius_mm"] + truth[key]
    return pose.inverse().apply(measured), foot + height[:, None] * normals, normals


def test_both_passes_are_their_truth_and_noise_along_the_normal(sample_data: Path) -> None:
    for name, key in (("part.csv", "deviation_mm"), ("part2.csv", "deviation2_mm")):
        measured, true, normals = recorded(sample_data, name, key)
        off = measured - true
        along = (off * normals).sum(axis=1)
        across = off - along[:, None] * normals

        assert np.abs(across).max() < 2.0 * ROUNDING_MM
        assert abs(along.std() / NOISE_MM - 1.0) < 4.0 / np.sqrt(2.0 * len(along))
        assert abs(along.mean()) < 4.0 * NOISE_MM / np.sqrt(len(along))


def test_the_second_pass_is_better_by_a_factor_of_four(sample_data: Path) -> None:
    truth = np.load(sample_data / "truth.npz")

    assert np.ptp(truth["deviation_mm"]) > 4.0 * np.ptp(truth["deviation2_mm"])


def test_points_are_printed_with_five_decimals(sample_data: Path) -> None:
    lines = (sample_data / "part.csv").read_text().splitlines()

    assert lines[0] == "# cmm-align points v1; units=mm; kind=tip_centre; frame=machine"
    assert lines[1] == "x_mm,y_mm,z_mm"
    assert 5000 <= len(lines) - 2 <= 8000
    assert all(len(field.split(".")[1]) == 5 for line in lines[2:] for field in line.split(","))


def test_the_prescription_is_the_window(sample_data: Path) -> None:
    assert (sample_data / "nominal.toml").read_text() == PRESCRIPTION


def test_the_folder_is_small_and_every_file_is_explained(sample_data: Path) -> None:
    files = [
        path
        for path in sample_data.rglob("*")
        if path.is_file() and not path.name.endswith(MADE_BY_COMMANDS) and "__pycache__" not in path.parts
    ]
    readme = (sample_data / "README.md").read_text()

    assert sum(path.stat().st_size for path in files) < FIVE_MB
    for path in files:
        top = path.relative_to(sample_data).parts[0]
        assert top == "README.md" or f"`{top}" in readme, path.name


def test_the_script_that_makes_the_folder_finds_what_it_uses(
    sample_data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(sample_data))

    assert callable(runpy.run_path(str(sample_data / "make_sample_data.py"))["main"])
