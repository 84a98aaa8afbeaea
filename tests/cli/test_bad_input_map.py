"""Bad input of error-map: the exit code, one line that says what and where, and nothing left behind."""

from __future__ import annotations

import importlib.util
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from conftest import Ran

Cli = Callable[..., Ran]

LIMITS = ("7.135 mm (sampling: 4 spacings)", "99.88 mm (the part)")

FOREIGN = {"dat": bytes.fromhex("881b036f") + bytes(900)}  # a measurement of an interferometer

REFUSED = {
    "no point in the region": (["--report-region", "circle:200,0,5"], 3, ("none of the", "they lie from")),
    "no region": (["--report-region", "disk:0,0,5"], 2, ("no region", "circle:X,Y,R")),
    "a region of no size": (["--report-region", "circle:0,0,-5"], 2, ("circle:0,0,-5",)),
    "a region file that is not there": (["--report-region", "no.toml"], 3, ("no.toml",)),
    "a margin wider than the part": (["--report-region", "aperture:-80mm"], 2, ("leaves nothing",)),
    "a region with too few points": (["--report-region", "circle:0,0,0.8"], 3, ("expected points",)),
    "low pass under the sampling": (["--low-pass", "0.01mm"], 2, LIMITS),
    "low pass over the part": (["--low-pass", "900mm"], 2, LIMITS),
    "high pass over the part": (["--high-pass", "900mm"], 2, LIMITS),
    "a filter without a cutoff": (["--filter", "spline"], 2, ("--low-pass",)),
    "too fine a spacing": (["--spacing", "1um"], 2, ("at most 512 nodes",)),
    "too coarse a spacing": (["--spacing", "900mm"], 3, ("no node",)),
    "unknown export": (["--export", "step"], 2, ("step", "csv", "x3p", "zygo")),
}


@pytest.fixture
def aligned(made: Path, tmp_path: Path) -> Path:
    shutil.copy(made / "part.align.h5", tmp_path)
    return tmp_path / "part.align.h5"


@pytest.mark.parametrize("name", REFUSED)
def test_it_is_refused_in_one_line_and_nothing_is_left(cli: Cli, aligned: Path, name: str) -> None:
    arguments, code, words = REFUSED[name]
    ran = cli("error-map", aligned, *arguments)

    assert ran.code == code, ran.err
    assert ran.out == ""
    assert len(ran.err.splitlines()) == 1, ran.err
    for word in words:
        assert word in ran.err
    assert list(aligned.parent.iterdir()) == [aligned]


@pytest.mark.parametrize("suffix", ["h5", "csv", "x3p", "dat"])
def test_an_output_that_exists_is_refused_before_anything_is_written(
    cli: Cli, aligned: Path, suffix: str
) -> None:
    kept = aligned.parent / f"part.map.{suffix}"
    kept.write_bytes(FOREIGN.get(suffix, b"mine"))
    arguments = ["error-map", aligned, "--export", "csv", "--export", "x3p", "--export", "zygo"]

    for more in ((), ("--overwrite",)):
        ran = cli(*arguments, *more)
        assert ran.code == 8
        assert len(ran.err.splitlines()) == 1
        assert kept.name in ran.err
        assert kept.read_bytes() == FOREIGN.get(suffix, b"mine")
        assert sorted(aligned.parent.iterdir()) == sorted([aligned, kept])


def test_exports_lie_beside_the_map_and_are_replaced_on_request(cli: Cli, aligned: Path) -> None:
    arguments = ["error-map", aligned, "--spacing", "2mm", "--no-picture", "--json"]
    arguments += ["--export", "zygo", "--export", "csv", "--export", "csv"]
    ran = cli(*arguments)

    assert ran.code == 0, ran.err
    assert [Path(path).name for path in ran.result["exports"]] == ["part.map.csv", "part.map.dat"]
    assert {path.name for path in aligned.parent.iterdir()} == {
        "part.align.h5",
        "part.map.h5",
        "part.map.csv",
        "part.map.dat",
    }
    assert cli(*arguments, "--overwrite").code == 0
    assert cli("align", aligned.parent / "part.map.csv", aligned).code == 3  # no measurement


def test_the_numbers_come_out_where_an_export_cannot_be_written(
    cli: Cli, aligned: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name, *more: None if name == "x3pio" else real(name, *more)
    )
    ran = cli("error-map", aligned, "--export", "x3p", "--export", "csv", "--no-picture", "--json")

    assert ran.code == 2
    assert ran.result["rms_um"] > 0.0
    assert "pip install 'cmm-align[x3p]'" in ran.json["warnings"][0]
    assert {path.name for path in aligned.parent.iterdir()} == {
        "part.align.h5",
        "part.map.h5",
        "part.map.csv",
    }
