"""`error-map --compare` as scripts and operators see it."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from conftest import Ran

from cmm_align import io

Cli = Callable[..., Ran]


@pytest.fixture(scope="module")
def passes(made: Path, sample_data: Path) -> Path:
    """The chain's folder, with the second pass aligned beside the first."""
    from cmm_align.cli.main import outcome_of

    shutil.copy(sample_data / "part2.csv", made)
    assert outcome_of(["align", str(made / "part2.csv"), str(made / "nominal.h5"), "-q"]) == 0
    return made


def test_two_passes_are_told_with_their_change_and_drawn(cli: Cli, passes: Path) -> None:
    plain = cli("error-map", passes / "part2.align.h5", "-o", passes / "plain.map.h5", "--json").result
    ran = cli("error-map", passes / "part2.align.h5", "--compare", passes / "part.map.h5", "--json")
    found = ran.result["compare"]

    assert ran.code == 0
    assert {name: ran.result[name] for name in plain} == plain
    assert [Path(p).name for p in ran.json["outputs"]] == [
        "part2.map.h5",
        "part2.map.png",
        "part2.compare.png",
    ]
    assert len(ran.json["inputs"]) == 2
    assert (passes / "part2.compare.png").stat().st_size > 10_000
    assert found["before"]["rms_um"] == pytest.approx(4.40, rel=0.03)
    assert found["after"]["rms_um"] == pytest.approx(plain["rms_um"], rel=1e-6)
    assert found["better_than_before"]
    assert not found["worse_than_before"]
    assert found["share_changed_percent"] > 80.0
    assert [rung["removed"] for rung in found["rungs"]][:3] == ["nothing", "rigid motion", "+ power"]
    assert [band["name"] for band in found["bands"]] == ["low orders", "middle", "fine"]
    assert found["bands"][0]["longest_mm"] is None
    assert found["words"][0].startswith("RMS 4.4")


def test_the_comparison_is_in_the_file_and_older_files_have_none(cli: Cli, passes: Path) -> None:
    output = passes / "stored.map.h5"
    cli(
        "error-map",
        passes / "part2.align.h5",
        "--compare",
        passes / "part.align.h5",
        "-o",
        output,
        "--no-picture",
    )
    stored = io.read_map(output).comparison

    assert stored is not None
    assert not (passes / "stored.compare.png").exists()
    with h5py.File(output) as file:
        np.testing.assert_array_equal(file["comparison/after_mm"][()], stored.after_mm)
        assert file["comparison/u_mm"].attrs["units"] == "mm"
        assert json.loads(file["comparison/change"].attrs["words"]) == list(stored.change.words)
    assert io.read_map(passes / "part.map.h5").comparison is None


def test_map_and_alignment_of_the_earlier_measurement_say_the_same(cli: Cli, passes: Path) -> None:
    start = [
        "error-map",
        passes / "part2.align.h5",
        "-o",
        passes / "same.map.h5",
        "--no-picture",
        "--overwrite",
        "--json",
    ]
    by_map = cli(*start, "--compare", passes / "part.map.h5").result["compare"]
    by_alignment = cli(*start, "--compare", passes / "part.align.h5").result["compare"]

    assert {**by_map, "earlier": ""} == {**by_alignment, "earlier": ""}


def test_worse_is_a_warning(cli: Cli, passes: Path) -> None:
    ran = cli(
        "error-map", passes / "part.align.h5", "--compare", passes / "part2.align.h5",
        "-o", passes / "worse.map.h5", "--no-picture",
    )  # fmt: skip

    assert ran.code == 0
    assert "WORSE than before, outside the noise" in ran.err
    assert "WORSE than before" in " ".join(ran.out.split())
    assert ran.out.isascii()


def test_an_older_map_is_compared_with(cli: Cli, passes: Path, tmp_path: Path) -> None:
    older = tmp_path / "older.map.h5"
    shutil.copy(passes / "part.map.h5", older)
    with h5py.File(older, "r+") as file:
        file.attrs["schema_version"] = 1
        for name in ("judged", "status"):
            del file["points"][name]
        del file["low_orders"]
    ran = cli(
        "error-map",
        passes / "part2.align.h5",
        "--compare",
        older,
        "--no-picture",
        "-o",
        tmp_path / "o.map.h5",
        "--json",
    )

    assert ran.code == 0
    assert ran.result["compare"]["better_than_before"]


def test_a_filtered_earlier_map_is_compared_by_its_points_and_that_is_said(cli: Cli, passes: Path) -> None:
    smooth = passes / "smooth.map.h5"
    cli("error-map", passes / "part.align.h5", "--low-pass", "20mm", "-o", smooth, "--no-picture")
    ran = cli(
        "error-map", passes / "part2.align.h5", "--compare", smooth, "-o", passes / "f.map.h5",
        "--no-picture", "--json",
    )  # fmt: skip

    assert ran.code == 0
    assert any("compared are its points, unfiltered" in text for text in ran.json["warnings"])


@pytest.mark.parametrize(
    ("earlier", "more", "code", "said"),
    [
        ("part2.align.h5", [], 2, "the measurement itself"),
        ("part2.map.h5", [], 3, "the same measurement"),
        ("part.map.h5", ["--low-pass", "10mm"], 2, "--compare with a cutoff"),
        ("nominal.h5", [], 3, "it is a nominal"),
        ("part.csv", [], 3, "it is a point file"),
        ("part.comp.h5", [], 3, "correction"),
        ("missing.h5", [], 3, "cannot read it"),
    ],
)
def test_what_is_no_earlier_measurement_is_refused_and_nothing_written(
    cli: Cli, passes: Path, tmp_path: Path, earlier: str, more: list[str], code: int, said: str
) -> None:
    if earlier == "part2.map.h5":
        cli("error-map", passes / "part2.align.h5", "-o", passes / earlier, "--no-picture", "--overwrite")
    ran = cli(
        "error-map",
        passes / "part2.align.h5",
        "--compare",
        passes / earlier,
        *more,
        "-o",
        tmp_path / "x.map.h5",
    )

    assert ran.code == code
    assert said in ran.err
    assert len(ran.err.strip().splitlines()) <= 4
    assert list(tmp_path.iterdir()) == []


def test_a_map_of_another_part_is_refused_naming_both(cli: Cli, passes: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.map.h5"
    shutil.copy(passes / "part.map.h5", other)
    with h5py.File(other, "r+") as file:
        place = next(name for name in ("nominal_surface", "surface") if name in file)
        file[place].attrs["digest"] = "e" * 64
    ran = cli("error-map", passes / "part2.align.h5", "--compare", other, "-o", tmp_path / "x.map.h5")

    assert ran.code == 3
    assert "another part" in ran.err
    assert "other.map.h5" in ran.err
    assert "part2.align.h5" in ran.err
    assert not (tmp_path / "x.map.h5").exists()
