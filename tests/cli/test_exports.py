"""`compensate` with a wheel and exports: what is written, told and refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from conftest import Ran
from scipy.spatial import cKDTree

from cmm_align import posts
from cmm_align.io import read_correction
from cmm_align.numerics.wheel import Wheel

Cli = Callable[..., Ran]


@pytest.fixture
def start(made: Path, tmp_path: Path) -> list[object]:
    return ["compensate", made / "part.map.h5", "--first-pass", "--no-picture", "-o", tmp_path / "a.comp.h5"]


def written(tmp_path: Path) -> list[str]:
    return sorted(path.name for path in tmp_path.iterdir())


def test_three_exports_with_a_wheel(cli: Cli, start: list[object], tmp_path: Path) -> None:
    ran = cli(
        *start,
        "--export",
        "gcode-raster",
        "--export",
        "xyzijk",
        "--export",
        "zemax",
        "--wheel-radius",
        "30mm",
        "--depth-of-cut",
        "80um",
        "--json",
    )
    assert ran.code == 0
    result = ran.result
    names = ["a.comp.raster.nc", "a.comp.ijk.xyz", "a.comp.sag.dat"]
    assert [Path(path).name for path in result["exports"]] == names
    assert written(tmp_path) == sorted([*names, "a.comp.h5"])
    assert result["wheel"]["curvature_share"] < 0.0  # the window is a dome
    assert result["wheel"]["overcut_um"] < 0.1
    assert result["least_depth_um"] == pytest.approx(80.0 - result["correction_range_um"])
    correction = read_correction(tmp_path / "a.comp.h5")
    points, _ = posts.points_and_normals(correction)
    found = posts.read_back(tmp_path / names[0], "gcode-raster", Wheel(30.0))
    # Every node is a point of the path, with others between: it comes back but for the error of its normal
    # times the radius, which moves it along the surface.
    away, _ = cKDTree(found.points_mm).query(points)
    assert len(found.points_mm) > 5 * len(points)
    assert away.max() < 0.05
    repeat = cli(*start, "--export", "zemax")
    assert repeat.code == 8
    assert "exists already" in repeat.err


@pytest.mark.parametrize(
    ("options", "code", "words"),
    [
        (["--export", "gcode-spiral"], 2, "needs the wheel"),
        (["--export", "dwell"], 2, "give --footprint-radius"),
        (["--export", "template"], 2, "go together"),
        (["--export", "xyz", "--export", "xyz"], 2, "each once"),
        (["--depth-of-cut", "5um"], 3, "in air"),
        (["--wheel-tip-radius", "5mm"], 2, "without its radius"),
        (["--text-decimals", "5"], 2, "6<=x<=12"),
        (["--wheel-radius", "30", "--wheel-tip-radius", "5", "--wheel-axis", "z"], 3, "flat face"),
    ],
)
def test_what_cannot_be_is_refused_and_nothing_is_written(
    cli: Cli, start: list[object], tmp_path: Path, options: list[str], code: int, words: str
) -> None:
    ran = cli(*start, *options)
    assert (ran.code, words in ran.err) == (code, True), ran.err
    assert written(tmp_path) == []


def test_an_unknown_placeholder_names_the_known_ones(cli: Cli, start: list[object], tmp_path: Path) -> None:
    post = tmp_path / "post.toml"
    post.write_text('schema = "cmm-align/post/1"\nline = "X{x} Y{y} Z{zed}"\n', encoding="utf-8")
    ran = cli(*start, "--export", "template", "--post", post)
    assert ran.code == 3
    assert "unknown placeholder {zed} in line" in ran.err
    assert "x, y, z, i, j, k, cx, cy, cz, n" in ran.err
    assert written(tmp_path) == ["post.toml"]


def test_the_report_names_wheel_depth_and_files(cli: Cli, start: list[object]) -> None:
    ran = cli(
        *start,
        "--wheel-radius",
        "30mm",
        "--depth-of-cut",
        "80um",
        "--export",
        "gcode-spiral",
        "--line-spacing",
        "2mm",
        "--point-spacing",
        "1mm",
    )
    assert ran.code == 0, ran.err
    for words in ("sphere, radius 30 mm", "mrad", "80 um, at least", "a.comp.spiral.nc"):
        assert words in ran.out
