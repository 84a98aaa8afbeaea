"""Options of `compensate`, and what it refuses without writing anything."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import h5py
import pytest
from conftest import Ran

Cli = Callable[..., Ran]


@pytest.mark.parametrize(
    ("options", "code", "words"),
    [
        (["--gain", "1.5"], 2, "--force-gain"),
        (["--gain", "2.5", "--force-gain"], 2, "gain = 2.5"),
        (["--gain", "some"], 2, "or wiener"),
        (["--region", "circle:500,0,10"], 3, "lies outside the map"),
        (["--transfer", "90"], 2, "transfer"),
        (["--thickness-budget", "5um"], 3, "at most 5 um"),
    ],
)
def test_what_cannot_be_is_refused_and_nothing_written(
    cli: Cli, made: Path, tmp_path: Path, options: list[str], code: int, words: str
) -> None:
    ran = cli("compensate", made / "part.map.h5", "-o", tmp_path / "x.comp.h5", *options)

    assert ran.code == code
    assert words in " ".join(ran.err.split())
    assert not list(tmp_path.iterdir())


def test_a_map_without_normals_is_refused(cli: Cli, made: Path, tmp_path: Path) -> None:
    shutil.copy(made / "part.map.h5", tmp_path / "bare.map.h5")
    with h5py.File(tmp_path / "bare.map.h5", "a") as file:
        del file["points/normal"]
    ran = cli("compensate", tmp_path / "bare.map.h5", "--first-pass")

    assert ran.code == 3
    assert "points/normal" in ran.err
    assert [path.name for path in tmp_path.iterdir()] == ["bare.map.h5"]


def test_a_wiener_gain_with_a_known_transfer_says_its_band_and_interval(
    cli: Cli, made: Path, tmp_path: Path
) -> None:
    options = ["--gain", "wiener", "--transfer", "0.9", "--repeatability", "0.8um", "--no-picture", "--json"]
    ran = cli("compensate", made / "part.map.h5", "-o", tmp_path / "x.comp.h5", *options)
    result = ran.result
    low, high = result["predicted_rms_interval_um"]

    assert ran.code == 0
    assert result["gain_rule"] == "wiener"
    assert 1.0 < result["gain"] <= 1.2
    assert low < result["predicted_rms_um"] < high
    assert result["low_pass_bound"] in {"sampling", "wheel"}
    assert (result["transfer"], result["repeatability_um"]) == ([0.9], pytest.approx(0.8))
    with h5py.File(tmp_path / "x.comp.h5") as file:
        assert file["grid/status"].dtype == "uint8"
        assert file["grid/deviation_mm"].shape == file["grid/correction_mm"].shape
